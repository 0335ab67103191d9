"""A robot with longer legs and twice the mass, filmed at 200 frames/s: from its files through video and bags to the
verdict. One campaign: 2 φ × 4 ω × 2 replicates, rendered and tracked."""

import json

import numpy as np
import pytest

from sandbot_bringup.config import config_folder
from sandbot_common.robot import SANDBOT, Robot, to_mapping
from sandbot_common.yaml_text import dump_yaml, read_yaml
from sandbot_model.data.conditions import cells_of
from sandbot_model.tools import discover as command
from sandbot_record import read_trials
from sandbot_record.bags.reader import FIELD_STAMP, Bag

pytestmark = [pytest.mark.slow, pytest.mark.whole, pytest.mark.timeout(600)]  # test_another_robot goes without film

BIG = Robot(leg_radius_m=0.05, mass_per_leg_kg=2 * SANDBOT.mass_per_leg_kg)
ETA, DELTA_T_S, RATE_HZ = 0.15, 0.4, 200.0
PLAN = {
    "name": "big",
    "seed": 7,
    "gait": "UNIFORM",
    "phi": [0.580, 0.633],
    "omega_rad_s": [6.0, 9.0, 12.0, 16.0],
    "replicates": 2,
    "periods": 3.0,
    "images": "none",
    "robot": "robot.yaml",
    "cameras": "cameras.yaml",
}
WORLD = {
    "schema": "sandbot.world/1",
    "k_knots_n_per_m": [209.0, 252.0, 271.0],
    "delta_t_s": DELTA_T_S,
    "effects": {"stance_overlap": {"eta": ETA}},
}


def cameras():
    """The project's, with a wider view: this robot goes further."""
    content = read_yaml(config_folder() / "cameras.yaml")
    for name in ("dorsal", "lateral"):
        content[name] |= {"frame_rate_hz": RATE_HZ, "fx": 750.0, "fy": 750.0}
        content[name]["position_m"][0] = 0.8
    return content


@pytest.fixture(scope="module")
def filmed(tmp_path_factory, batch_campaign):
    folder = tmp_path_factory.mktemp("big")
    for name, content in (("plan", PLAN), ("world", WORLD), ("robot", to_mapping(BIG)), ("cameras", cameras())):
        (folder / f"{name}.yaml").write_text(dump_yaml(content))
    assert batch_campaign(folder / "plan.yaml", "--out", folder / "out", "--world", folder / "world.yaml") == 0
    return folder / "out"


def told_in_the_bags(campaign_folder):
    """Robot and frame rate that the analysis is to use, read from one bag by hand."""
    bag = Bag.open(next((campaign_folder / "trials").iterdir()))
    stamps = bag.columns("/landmarks/com", *FIELD_STAMP).stamp_ns
    return json.loads(next(iter(bag.messages(["/trial"]))).decode().data)["robot"], stamps


def test_the_analysis_uses_the_robot_and_the_frame_rate_of_the_bags(filmed):
    trials = read_trials(filmed)
    robot, stamps_ns = told_in_the_bags(filmed)
    assert to_mapping(trials.robot) == robot == to_mapping(BIG)
    assert trials.frame_rate_hz == RATE_HZ == pytest.approx(1e9 / np.median(np.diff(stamps_ns)))
    assert cells_of(trials).robot == BIG
    assert trials.usable.all()


def test_the_hidden_effect_is_named_with_its_parameters(filmed, tmp_path, capsys):
    out = tmp_path / "found.json"
    assert command.main([str(filmed), "--max-effects", "1", "--workers", "1", "--json", str(out)]) == 0
    found = json.loads(out.read_text())
    assert (found["verdict"]["status"], found["verdict"]["effects"]) == ("identified", ["stance_overlap"])
    assert "robot: as in the bags" in capsys.readouterr().out
    for name, truth in (("stance_overlap.eta", ETA), ("delta_t_s", DELTA_T_S)):
        value = found["steps"][-1]["parameters"][name]
        assert abs(value["value"] - truth) < 3 * value["stderr"]


def test_with_sandbots_file_nothing_is_identified_and_the_file_is_blamed(filmed, tmp_path, capsys):
    """Control."""
    out = tmp_path / "found.json"
    own = config_folder() / "robot.yaml"
    assert command.main([str(filmed), "--robot", str(own), "--workers", "1", "--json", str(out)]) == 0
    assert json.loads(out.read_text())["verdict"]["effects"] == []
    said = " ".join(capsys.readouterr().out.split())
    assert "in place of the data's own (leg_radius_m 0.0355 and 0.05, mass_per_leg_kg 0.767 and 1.534)" in said
    assert "robot.yaml may be wrong, so nothing is identified: peak speeds are 1.4" in said
