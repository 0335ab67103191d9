"""campaign --until verdict in batch: from the start to a verdict, blind; killed in the middle, the same end."""

import json
import shutil
from dataclasses import replace

import pytest

from sandbot_bringup.plan import read_plan, to_yaml, trials_of, with_block
from sandbot_bringup.tools import unseal
from sandbot_bringup.until import START
from sandbot_record import read
from sandbot_record.trials.csv_table import read_csv

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

PLAN = """
name: thinking
seed: 8
gait: UNIFORM
images: none
phi: [0.58, 0.61, 0.633]
omega_rad_s: [8, 16, 24]
replicates: 4
"""
WORLD = """
effects:
  stance_overlap: {eta: 0.2}
"""


def looks(folder):
    return [json.loads(line) for line in (folder / "looks.jsonl").read_text().splitlines()]


@pytest.fixture(scope="module")
def run(tmp_path_factory, slow_cameras, batch_campaign):
    base = tmp_path_factory.mktemp("until")
    (base / "plan.yaml").write_text(f"{PLAN}cameras: {slow_cameras}\n")
    (base / "world.yaml").write_text(WORLD)
    out, world = base / "run", base / "world.yaml"
    assert batch_campaign(base / "plan.yaml", "--out", out, "--until", "verdict", "--world", world) == 0
    return out


def test_it_stops_at_the_right_verdict_before_the_grid_is_run(run):
    last = looks(run)[-1]
    assert (last["status"], last["effects"]) == ("identified", ["stance_overlap"])
    assert last["stop"]
    assert not last["next"]
    assert len(read_csv(run / "trials.csv")) == last["trials"] < 4 * 9


def test_every_trial_says_why_it_was_run(run):
    for trial in trials_of(read_plan(run / "campaign.yaml")):
        [(_, message)] = read(run / "trials" / trial.trial_id, "/trial")
        assert json.loads(message.decode().data)["because"] == trial.because != ""


def test_the_truth_stays_sealed(run):
    assert "eta" not in (run / "looks.jsonl").read_text()
    assert unseal.main([str(run)]) == 0


@pytest.mark.whole
def test_killed_at_its_second_look_it_comes_to_the_same_end(run, tmp_path, batch_campaign):
    """What a kill -9 leaves: bags of some trials, a torn look, a plan that has not grown."""
    torn = tmp_path / "torn"
    shutil.copytree(run, torn)
    first, second, *_ = (run / "looks.jsonl").read_text().splitlines(keepends=True)
    plan = read_plan(torn / "campaign.yaml")
    begun = replace(plan, extra_trials=tuple(one for one in plan.extra_trials if one["because"] == START))
    then = with_block(begun, json.loads(first)["next"])
    (torn / "campaign.yaml").write_text(to_yaml(then))
    kept = {trial.trial_id for trial in trials_of(then)[:-2]}
    assert 0 < len(kept) < len(trials_of(plan))
    for bag in (torn / "trials").iterdir():
        if bag.name not in kept:
            shutil.rmtree(bag)
    (torn / "looks.jsonl").write_text(first + second[:100])
    (torn / "trials.csv").unlink()
    assert batch_campaign(torn) == 0
    assert looks(torn) == looks(run)
    assert (torn / "campaign.yaml").read_text() == (run / "campaign.yaml").read_text()
