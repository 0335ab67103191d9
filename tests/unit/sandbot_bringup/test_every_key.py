"""Nothing in config/ is shown and ignored: every key of robot and world files, changed alone, changes a result or is
refused."""

import copy
import math

import numpy as np
import pytest

from sandbot_bringup.config import config_folder, files_of
from sandbot_bringup.plan import Plan, plan_of, read_plan, trials_of
from sandbot_bringup.provenance import trial_message
from sandbot_clock.gait import leg_angles
from sandbot_common.errors import InputError
from sandbot_common.files import dump_yaml, read_yaml
from sandbot_common.robot import robot_from_mapping
from sandbot_lab.cameras import LabCamera
from sandbot_lab.direct import direct_trials
from sandbot_lab.robot import simulate
from sandbot_lab.world import World, world_from_mapping
from sandbot_model.data.conditions import cells_of
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.walking import Inputs, KCurve, Walker
from sandbot_record.trials.table import Row, from_rows

CONFIG = config_folder()
CAMERAS = read_yaml(CONFIG / "cameras.yaml")
PHI, OMEGA = (0.585, 0.603, 0.625), (8.0, 16.0, 20.0, 24.0, 30.0)
ON_TRACKING = {"leg_mount_rad", "axle_distance_m"}
"""Keys that say how the robot is seen: the analysis of a table does not need them."""


def leaves(content, path=()):
    """Paths of all values in nested mappings; a list is one value."""
    if not isinstance(content, dict) or not content:
        return [path]
    return [leaf for key, value in content.items() for leaf in leaves(value, (*path, key))]


def changed(content, path):
    """A copy with the value at ``path`` a little different."""
    copied = copy.deepcopy(content)
    inside = copied
    for key in path[:-1]:
        inside = inside[key]
    inside[path[-1]] = other(inside[path[-1]])
    return copied


def other(value):
    match value:
        case bool():
            return not value
        case int() | float():
            return type(value)(value * 1.1) if value * 1.1 != value and type(value)(value * 1.1) != value else value + 1
        case list():
            return [value[0] * 1.01, *value[1:]]
        case dict():
            return {"motor_saturation": {}}
        case str():
            return f"{value}x"
    raise AssertionError(value)


def same(one, another):
    return all(np.array_equal(left, right) for left, right in zip(one, another, strict=True))


def walked(robot):
    """What the lab makes of a robot: its path on ground that feels all of it, and its markers in the picture."""
    effects = {"finite_depth": {}, "leg_slip": {}, "exact_leg_arc": {}, "cohesion": {}}
    world = World(effects=effects, robot=robot, k_knots_n_per_m=(136.0, 142.0, 150.0))
    t_s = np.arange(0.0, 1.5, 0.005)
    setpoints = leg_angles(Plan("p", (0.6,), (8.0,), gait="UNIFORM").clock_gait, 8.0, t_s)
    trace = simulate(world, 0.6, t_s, *setpoints, 1)
    markers = LabCamera("lateral", CAMERAS["lateral"], 1, robot).markers(*(np.zeros(1),) * 3)
    return trace.x_m, trace.z_m, *markers


def predicted(robot):
    """What the model makes of it, with effects that feel all of it."""
    wanted = ("finite_depth", "leg_slip", "exact_leg_arc", "cohesion")
    walker = Walker(tuple(effect for effect in CATALOGUE if effect.identifier in wanted), robot)
    curve = KCurve(np.array([0.58, 0.633]), np.array([300.0, 360.0]))
    inputs = Inputs(curve(np.asarray(0.62)), 8.0, 0.4, 0.62, k_of_phi=curve)
    params = [{one.name: one.start for one in effect.parameters} for effect in walker.effects]
    return (walker.predict(inputs, params).observables,)


@pytest.mark.parametrize("file", ["robot.yaml", "sgcs_robot.yaml"])
@pytest.mark.parametrize("key", sorted(set(read_yaml(CONFIG / "robot.yaml")) - {"arc_excess_rad"}))
def test_every_key_of_a_robot_is_obeyed_by_the_lab_and_the_model(file, key):
    content = read_yaml(CONFIG / file)
    as_it_is, otherwise = (robot_from_mapping(one, file) for one in (content, changed(content, (key,))))
    assert not same(walked(as_it_is), walked(otherwise))
    assert same(predicted(as_it_is), predicted(otherwise)) == (key in ON_TRACKING)
    assert same(walked(as_it_is), walked(robot_from_mapping(content, file)))


def test_robot_files_name_every_key():
    for file in ("robot.yaml", "sgcs_robot.yaml"):
        content = read_yaml(CONFIG / file)
        assert list(content) == list(vars(robot_from_mapping(content, file)))


def measured(content):
    rows = direct_trials(
        world_from_mapping(content, "w.yaml"), (0.585, 0.603, 0.625), (8.0, 16.0, 20.0, 24.0, 30.0), "UNIFORM", 1, 3
    )
    return [np.array([row[name] for row in rows]) for name in ("phi", "speed_m_s", "lift_m", "peak_speed_m_s")] + [
        np.array([row["first_step_m"] for row in rows])
    ]


@pytest.mark.parametrize(
    ("file", "path"),
    [(file, path) for file in ("pilot_world.yaml", "outside_world.yaml") for path in leaves(read_yaml(CONFIG / file))],
)
def test_every_key_of_a_world_changes_what_is_measured_or_is_refused(file, path):
    content = read_yaml(CONFIG / file)
    otherwise = changed(content, path)
    if path == ("schema",):
        with pytest.raises(InputError, match="schema"):
            measured(otherwise)
    else:
        assert not same(measured(content), measured(otherwise))


def run(content, folder):
    """What a plan makes happen: every trial as it is announced, its gait, its files."""
    plan = plan_of(content, "plan.yaml")
    files = files_of(plan, CONFIG, folder)
    robot = robot_from_mapping({}, "r")
    return [trial_message(plan, one, robot, 0) for one in trials_of(plan)], plan.clock_gait, files


@pytest.mark.parametrize(
    ("file", "key"),
    [
        (file, key)
        for file in ("demo.yaml", "li09.yaml", "pilot.yaml", "pilot_next.yaml", "sgcs.yaml")
        for key in read_yaml(CONFIG / file)
    ],
)
def test_every_key_of_a_plan_changes_the_campaign_or_is_refused(file, key, tmp_path):
    content = read_yaml(CONFIG / file)
    otherwise = changed(content, (key,))
    if key in ("gait", "robot"):
        with pytest.raises(InputError, match=f"{key}: |no such file"):
            run(otherwise, tmp_path)
    else:
        assert run(otherwise, tmp_path) != run(content, tmp_path)
    assert read_plan(CONFIG / file) == plan_of(content, file)


@pytest.mark.parametrize("file", ["demo.yaml"])
@pytest.mark.parametrize(
    ("cameras", "words"),
    [
        ({**CAMERAS, "lateral": {**CAMERAS["lateral"], "frame_rate_hz": 50.0}}, "one for both is needed"),
        ({"dorsal": CAMERAS["dorsal"]}, "dorsal and lateral are needed"),
        ({**CAMERAS, "third": CAMERAS["dorsal"]}, "and no others"),
    ],
)
def test_cameras_that_a_trial_can_not_obey_are_refused(file, cameras, words, tmp_path):
    (tmp_path / "mine.yaml").write_text(dump_yaml(cameras), encoding="utf-8")
    plan = plan_of({**read_yaml(CONFIG / file), "cameras": "mine.yaml"}, file)
    with pytest.raises(InputError, match=words):
        files_of(plan, tmp_path, tmp_path / "out")


def test_the_frame_rate_decides_which_peaks_are_resolved():
    rows = [Row(str(n), 0.6, 0.001, 30.0, "SGCS", n, 0.1, 0.01, 0.01, 0.3, 0.02) for n in range(3)]
    at = {rate: cells_of(from_rows(rows, None, rate)).observables for rate in (math.nan, 100.0, 1000.0)}
    assert at[math.nan] == at[100.0]
    assert "peak_speed" not in at[100.0]
    assert "peak_speed" in at[1000.0]
