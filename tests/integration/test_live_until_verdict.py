"""A campaign until a verdict through the real nodes; killed in the middle, resumed, it comes to its end."""

import json
import os
import signal
import time

import pytest
import yaml

from sandbot_bringup.plan import read_plan, trials_of
from sandbot_record import read

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.whole, pytest.mark.timeout(3600)]

BED = {"fluidise_s": 0.7, "ramp_s": 0.3, "settle_s": 0.6, "pulse_off_s": 0.5, "average_s": 0.4}
"""A bed prepared in seconds, its height read often enough for 0.0002 in φ."""
PLAN = {
    "name": "thinking", "seed": 7, "gait": "UNIFORM", "images": "none", "bed": BED,
    "phi": [0.58, 0.6, 0.62], "omega_rad_s": [8.0, 14.0, 20.0], "replicates": 4, "until": "verdict",
}  # fmt: skip
WORLD = {"effects": {"stance_overlap": {"eta": 0.2}}}
PATIENCE_S = 1500


def finished(folder):
    """Trials that have a bag."""
    return len([path for path in folder.glob("trials/*") if not path.name.startswith(".")])


def test_it_is_killed_and_resumed_and_names_what_the_lab_hides(tmp_path, start):
    plan, world, out = tmp_path / "plan.yaml", tmp_path / "world.yaml", tmp_path / "run"
    plan.write_text(yaml.safe_dump(PLAN))
    world.write_text(yaml.safe_dump(WORLD))
    beds = [f"bed.{name}:={value}" for name, value in BED.items()]
    start("ros2", "launch", "sandbot_bringup", "trackway.launch.py", f"world:={world}", *beds)
    campaign = ("ros2", "run", "sandbot_bringup", "campaign", plan, "--out", out, "--silence", 5)
    killed = start(*campaign)
    deadline = time.monotonic() + PATIENCE_S
    while finished(out) < 4:
        assert time.monotonic() < deadline, "\n".join(killed.lines)
        assert not killed.ended, "\n".join(killed.lines)
        time.sleep(0.1)
    os.killpg(killed.pid, signal.SIGKILL)
    killed.wait(60)
    before = finished(out)
    resumed = start(*campaign, "--redo", "failed")
    assert resumed.wait(PATIENCE_S) == 0, "\n".join(resumed.lines)

    looks = [json.loads(line) for line in (out / "looks.jsonl").read_text().splitlines()]
    assert (looks[-1]["status"], looks[-1]["effects"]) == ("identified", ["stance_overlap"])
    assert looks[-1]["stop"]
    assert any(line.startswith("look 1: ") for line in resumed.lines)
    grown = read_plan(out / "campaign.yaml")
    for trial in trials_of(grown):
        [(_, message)] = read(out / "trials" / trial.trial_id, "/trial")
        assert json.loads(message.decode().data)["because"] == trial.because
    assert 4 <= before < finished(out) == len(trials_of(grown))
    print(f"\n{len(trials_of(grown))} trials, {len(looks)} looks", *(one["text"] for one in looks), sep="\n")
