"""robot.yaml: what is written is read back; a key that would be ignored or misread is refused in one line."""

import json
import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_common.errors import InputError
from sandbot_common.parameters import specs
from sandbot_common.robot import SANDBOT, Robot, difference, read_robot, robot_from_mapping, to_mapping


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"leg_radus_m": 0.05}, "unknown key 'leg_radus_m', did you mean 'leg_radius_m'?"),
        ({"leg_radius": 0.05}, "say leg_radius_m: every key names its unit"),
        ({"gravity": 9.81}, "say gravity_m_s2"),
        ({"leg_radius_mm": 50}, "say leg_radius_m (values divided by 1000)"),
        ({"axle_height_cm": 2.5}, "say axle_height_m (values divided by 100)"),
        ({"leg_mount_deg": 30}, "say leg_mount_rad (values times π/180)"),
        ({"mass_per_leg_g": 767}, "say mass_per_leg_kg (values divided by 1000)"),
        ({"leg_radius_m": 35.5}, "leg_radius_m: 35.5 is outside [0.005, 0.5] m"),
        ({"leg_radius_m": "big"}, "'big' is not a number"),
        ({"mass_per_leg_kg": math.nan}, "nan is not a finite number"),
        ({"leg_mount_rad": 30}, "leg_mount_rad: 30 is outside"),
        ({"axle_height_m": 0.08}, "axle_height_m: 0.08 is not below 0.071"),
        ({"leg_radius_m": 0.01}, "axle_height_m: 0.025 is not below 0.02"),
        ({"stiffness_depth_m": 0.2}, "stiffness_depth_m: 0.2 is not below 0.1"),
        ({"legs_per_tripod": 2}, "leg_order: 6 names for two tripods of 2 (legs_per_tripod); 4 are needed"),
        ({"legs_per_tripod": 5}, "legs_per_tripod: 5 is outside [1, 4]"),
        ({"leg_order": ["a", "b"]}, "leg_order: 2 names for two tripods of 3"),
        ({"leg_order": ["a", "b", "c", "d", "e", "a"]}, "each leg needs a name of its own"),
        ({"leg_order": "abcdef"}, "leg_order: 'abcdef' is not a list"),
        (["leg_radius_m"], "expected a mapping"),
    ],
)
def test_what_cannot_be_a_robot_is_refused_with_the_remedy(content, words):
    with pytest.raises(InputError) as refusal:
        robot_from_mapping(content, "mine.yaml")
    assert str(refusal.value).startswith("mine.yaml: ")
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)


@given(
    st.floats(0.03, 0.5),
    st.floats(0.0, 0.059),
    st.floats(0.005, 100.0),
    st.floats(-math.pi, math.pi),
    st.integers(1, 4),
)
def test_round_trip(radius, height, mass, mount, tripod):
    legs = {"legs_per_tripod": tripod, "leg_order": tuple(f"joint_{leg}" for leg in range(2 * tripod))}
    robot = Robot(leg_radius_m=radius, axle_height_m=height, mass_per_leg_kg=mass, leg_mount_rad=mount, **legs)
    assert robot_from_mapping(json.loads(json.dumps(to_mapping(robot))), "r") == robot
    assert (difference(robot, SANDBOT) == "") == (robot == SANDBOT)


def test_what_the_file_leaves_out_is_sandbots(tmp_path):
    (tmp_path / "robot.yaml").write_text("leg_radius_m: 0.05\n", encoding="utf-8")
    assert read_robot(tmp_path / "robot.yaml") == Robot(leg_radius_m=0.05)
    assert difference(Robot(leg_radius_m=0.05), SANDBOT) == "leg_radius_m 0.05 and 0.0355"
    two = Robot(legs_per_tripod=1, leg_order=("left", "right"))
    assert difference(two, SANDBOT).startswith("legs_per_tripod 1 and 3, leg_order [left, right] and [front_left, ")


@pytest.mark.parametrize("mass", [-1.0, math.nan, math.inf, "heavy"])
def test_a_robot_made_in_python_is_checked_too(mass):
    with pytest.raises(InputError, match=r"^robot: mass_per_leg_kg: "):
        replace(SANDBOT, mass_per_leg_kg=mass)
    assert replace(SANDBOT, mass_per_leg_kg=1).mass_per_leg_kg == 1


def test_every_measure_tells_its_unit():
    measures = [spec for spec in specs(Robot) if spec.type is float]
    assert len(measures) == len(specs(Robot)) - 2
    assert all(spec.name.endswith(("_m", "_kg", "_rad", "_m_s2")) and spec.unit for spec in measures)
