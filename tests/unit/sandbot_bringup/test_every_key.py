"""Nothing in config/ is shown and ignored: every value of every YAML file there, changed alone, changes a result or is
refused, and every file there has its test here."""

import dataclasses
from functools import cache

import numpy as np
import pytest
from changed_keys import at, changed, elements, leaves, names, same

from sandbot_bringup.config import config_folder, files_of
from sandbot_bringup.node_table import read_table, selected
from sandbot_bringup.plan import Plan, plan_of, trials_of
from sandbot_bringup.provenance import trial_message
from sandbot_bringup.trial_bag import TrialBag
from sandbot_clock.gait import leg_angles
from sandbot_common import topics
from sandbot_common.accuracy import SECTION, accuracy_from_mapping
from sandbot_common.errors import InputError
from sandbot_common.robot import SANDBOT, read_robot, robot_from_mapping
from sandbot_common.yaml_text import dump_yaml, read_yaml
from sandbot_lab.cameras import LabCamera
from sandbot_lab.direct import direct_trials
from sandbot_lab.robot import simulate
from sandbot_lab.world import World, world_from_mapping
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.criteria import DEFAULT
from sandbot_model.discovery.nuisances_about import nuisances_for
from sandbot_model.fitting.fit import fit
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.model import model_of
from sandbot_model.physics.walking import Inputs, KCurve, Walker
from sandbot_record.bags.reader import Bag
from sandbot_record.trials.table import Row, from_rows
from sandbot_tracking.calibration import cameras_from_mapping
from sandbot_tracking.live import LiveView
from sandbot_tracking.offline import OfflineTracker

pytestmark = pytest.mark.slow  # together seconds

CONFIG = config_folder()
ROBOTS = ("robot.yaml", "sgcs_robot.yaml")
WORLDS = ("pilot_world.yaml", "outside_world.yaml", "sgcs_world.yaml", "li09_world.yaml")
PLANS = ("demo.yaml", "li09.yaml", "li09_demo.yaml", "pilot.yaml", "pilot_next.yaml", "sgcs.yaml")
CAMERAS = read_yaml(CONFIG / "cameras.yaml")
FEELS_THE_ROBOT = ("finite_depth", "leg_slip", "exact_leg_arc", "cohesion", "bed_slope")
"""Effects in which all of a robot shows; on ground so weak that the tip of the leg is inside it."""
ON_TRACKING = {"leg_mount_rad", "axle_distance_m", "leg_order"}
"""Keys that say how the robot is seen or driven: the analysis of a table does not need them."""


def every_value(*files):
    """File and path of every value in some files, one test each."""
    paths = [(file, path) for file in files for path in leaves(read_yaml(CONFIG / file))]
    return pytest.mark.parametrize(("file", "path"), paths, ids=names((file, *path) for file, path in paths))


def test_every_file_is_tested():
    tested = {*ROBOTS, *WORLDS, *PLANS, "cameras.yaml", "nodes.yaml"}
    assert {path.name for path in CONFIG.glob("*.yaml")} == tested


def walked(robot):
    """What the lab makes of a robot: its path, and its markers in the picture."""
    world = World(effects={name: {} for name in FEELS_THE_ROBOT}, robot=robot, k_knots_n_per_m=(122.0, 128.0, 135.0))
    t_s = np.arange(0.0, 1.5, 0.005)
    gait = Plan("p", (0.6,), (8.0,), gait="UNIFORM").clock_gait
    trace = simulate(world, 0.6, t_s, *leg_angles(gait, 8.0, t_s, robot.legs_per_tripod), 1)
    markers = LabCamera("lateral", CAMERAS["lateral"], 1, robot).markers(*(np.zeros(1),) * 3)
    return trace.x_m, trace.z_m, *markers


def predicted(robot):
    """What the model makes of it."""
    walker = Walker(tuple(effect for effect in CATALOGUE if effect.identifier in FEELS_THE_ROBOT), robot)
    curve = KCurve(np.array([0.58, 0.633]), np.array([100.0, 120.0]))
    inputs = Inputs(curve(np.asarray(0.62)), 8.0, 0.4, 0.62, k_of_phi=curve)
    params = [{one.name: one.start for one in effect.parameters} for effect in walker.effects]
    return (walker.predict(inputs, params).observables,)


def names_recorded(robot, path):
    """The names of the legs in the bag of a trial."""
    bag = TrialBag(1, robot.leg_order)
    bag.legs(topics.LEG_STATES, np.zeros(1), *(np.zeros((1, len(robot.leg_order))),) * 3)
    bag.write(path, {}, {})
    (message,) = Bag.open(path).messages([topics.LEG_STATES.name])
    return tuple(message.decode().name)


@every_value(*ROBOTS)
def test_a_robot_is_obeyed_by_the_lab_and_the_model(file, path, tmp_path):
    content = read_yaml(CONFIG / file)
    otherwise = changed(content, path)
    if path == ("legs_per_tripod",):
        with pytest.raises(InputError, match="leg_order: 6 names for two tripods of 4"):
            robot_from_mapping(otherwise, file)
        otherwise["leg_order"] = [*content["leg_order"], "spare_left", "spare_right"]
    as_it_is, otherwise = (robot_from_mapping(one, file) for one in (content, otherwise))
    if path == ("leg_order",):
        assert names_recorded(as_it_is, tmp_path / "a") != names_recorded(otherwise, tmp_path / "b")
    else:
        assert not same(walked(as_it_is), walked(otherwise))
    assert same(predicted(as_it_is), predicted(otherwise)) == (path[0] in ON_TRACKING)
    assert same(walked(as_it_is), walked(robot_from_mapping(content, file)))


@pytest.mark.parametrize("file", ROBOTS)
def test_robot_files_name_every_key(file):
    content = read_yaml(CONFIG / file)
    assert list(content) == list(vars(robot_from_mapping(content, file)))


def measured(content, file):
    """Trials in a world, by the gait and the robot that its campaign has; φ between all knots."""
    slow = file.startswith(("sgcs", "li09"))
    world = world_from_mapping(content, file)
    if slow:
        world = world.walked_by(read_robot(CONFIG / "sgcs_robot.yaml"))
    omega = (4.0, 10.0, 20.0, 24.0) if slow else (8.0, 16.0, 20.0, 24.0, 30.0)
    rows = direct_trials(world, (0.585, 0.603, 0.625), omega, "SGCS" if slow else "UNIFORM", 1, 3)
    columns = ("phi", "speed_m_s", "lift_m", "peak_speed_m_s", "first_step_m")
    return [np.array([row[name] for row in rows]) for name in columns]


@cache
def usually_measured(file):
    """In the world as the file has it."""
    return measured(read_yaml(CONFIG / file), file)


@every_value(*WORLDS)
def test_a_world_changes_what_is_measured_or_is_refused(file, path):
    content = read_yaml(CONFIG / file)
    otherwise = changed(content, path, {"motor_saturation": {}} if path == ("effects",) else None)
    if path == ("schema",):
        with pytest.raises(InputError, match="schema"):
            measured(otherwise, file)
    else:
        assert not same(usually_measured(file), measured(otherwise, file))


@pytest.mark.parametrize("file", WORLDS)
def test_a_world_left_as_it_is_changes_nothing(file):
    """Control of the test before."""
    assert same(usually_measured(file), measured(read_yaml(CONFIG / file), file))


def run(content):
    """What a plan makes happen: every trial as it is announced, its gait, its files."""
    plan = plan_of(content, "plan.yaml")
    files = files_of(plan, CONFIG, CONFIG / "no campaign yet")
    return [trial_message(plan, one, SANDBOT, 0) for one in trials_of(plan)], plan.clock_gait, files


@cache
def usual_run(file):
    """Of the plan as the file has it."""
    return run(read_yaml(CONFIG / file))


@every_value(*PLANS)
def test_a_plan_changes_the_campaign_or_is_refused(file, path):
    content = read_yaml(CONFIG / file)
    named = {("gait",): "HGCS", ("robot",): "robot.yaml"}
    if path in named:
        with pytest.raises(InputError, match=f"{path[0]}: |no such file"):
            run(changed(content, path))
    assert run(changed(content, path, named.get(path))) != usual_run(file)


@pytest.mark.parametrize("file", PLANS)
def test_a_plan_left_as_it_is_changes_nothing(file):
    """Control of the test before."""
    assert run(read_yaml(CONFIG / file)) == usual_run(file)


class Rolling:
    """A robot that rolls along and rises."""

    t_s = np.array([0.0, 1.0])
    x_m = np.array([0.2, 0.6])
    z_m = np.array([0.03, 0.05])
    pitch_rad = np.zeros(2)
    leg_angle_rad = np.zeros((2, 6))


def film(content, name):
    """The lab's first frames of one camera; the LED goes on with the second."""
    camera = LabCamera(name, content[name], 1)
    return [camera.film(Rolling, n / camera.calibration.frame_rate_hz, n > 0) for n in range(4)]


@cache
def frames():
    """Of both cameras, as they are."""
    return {name: film(CAMERAS, name) for name in ("dorsal", "lateral")}


def tracked(content):
    """What the tracking makes of those frames: when they were, where everything is, how well the LED ties clocks."""
    cameras = cameras_from_mapping(content, "cameras.yaml")
    views = {name: LiveView(camera) for name, camera in cameras.items()}
    tracker = OfflineTracker(cameras)
    clocks = []
    for n, (above, beside) in enumerate(zip(*frames().values(), strict=True)):
        tracker.update(n / cameras["dorsal"].frame_rate_hz, above, beside)
        for view, frame in zip(views.values(), (above, beside), strict=True):
            view.look(10_000_000 * n, 10_000_000 * n, 0, frame)
    for view in views.values():
        view.led(10_000_000)
        view.look(50_000_000, 50_000_000, 50_000_000, frames()["dorsal"][0])
        clocks.append(np.array([view.clock.edges, view.clock.half_width_ns or -1, view.times.period_s]))
    marks = tracker.landmarks()
    return marks.t_s, marks.com, marks.front_axle, marks.rear_axle, *clocks


@cache
def usually_tracked():
    """The same of the cameras as they are."""
    return tracked(CAMERAS)


OF_CAMERAS = list(elements(CAMERAS, (path for path in leaves(CAMERAS) if path[0] != SECTION)))
FURTHER = {"distortion": (5.0, 5.0, 0.05, 0.05, 5.0), "led_region": (200,) * 4}
"""By how much their elements are changed, so that it shows in the picture and the robot stays in it."""


@pytest.mark.parametrize("path", OF_CAMERAS, ids=names(OF_CAMERAS))
def test_a_camera_is_obeyed_by_the_lab_and_the_tracking_or_refused(path):
    further = at(CAMERAS, path) + FURTHER[path[1]][path[2]] if path[1] in FURTHER else None
    otherwise = changed(CAMERAS, path, further)
    if path[1] == "rotation" or path[-1] == "normal":
        with pytest.raises(InputError, match=path[1]):
            film(otherwise, path[0])
    else:
        assert not same(frames()[path[0]], film(otherwise, path[0]))
    if path[1] in ("rotation", "width", "height") or path[-1] == "normal":
        with pytest.raises(InputError, match="calibrated for" if path[1] in ("width", "height") else path[1]):
            tracked(otherwise)
    else:
        assert not same(usually_tracked(), tracked(otherwise))


def test_a_camera_left_as_it_is_changes_nothing():
    """Control of the test before."""
    assert same(film(CAMERAS, "dorsal"), frames()["dorsal"])
    assert same(usually_tracked(), tracked(CAMERAS))


def test_markers_that_move_in_another_plane_are_not_drawn_but_tracked():
    """A plane that has a meaning, but not for the lab's robot."""
    otherwise = changed(CAMERAS, ("dorsal", "plane", "normal"), "y")
    with pytest.raises(InputError, match="camera dorsal: plane: the robot's markers move across z"):
        film(otherwise, "dorsal")
    assert not same(usually_tracked(), tracked(otherwise))


@pytest.mark.parametrize("key", CAMERAS[SECTION])
def test_an_accuracy_changes_standard_errors(key):
    """Errors that replicates share where there are some, the usual scatter where there are none; or a prior."""

    def sem(content):
        accuracy = accuracy_from_mapping(content[SECTION], "cameras.yaml")
        rows = [Row(f"{phi} {n}", phi, 0.001, 8.0, "UNIFORM", n) for phi in (0.59, 0.61, 0.63) for n in range(2)]
        rows = [
            dataclasses.replace(one, speed_m_s=0.1 + d, lift_m=0.02 + d, peak_speed_m_s=0.3 + d, first_step_m=0.05 + d)
            for one in rows
            for d in [0.002 * one.replicate]
        ]
        several, single = (cells_of(from_rows(some, accuracy=accuracy)) for some in (rows, rows[::2]))
        if key in ("lift_zero_m", "speed_scale"):
            return [nuisances_for(fit(model_of("simple", (), {}), several), DEFAULT).sd]
        return [several.sem, single.sem]

    assert not same(sem(CAMERAS), sem(changed(CAMERAS, (SECTION, key))))
    assert same(sem(CAMERAS), sem({SECTION: {}}))


def launched(content, folder):
    """What a node table starts and offers: with the lab and without, with page and scene and without."""
    (folder / "nodes.yaml").write_text(dump_yaml(content), encoding="utf-8")
    table = read_table(folder / "nodes.yaml")
    grounds = ({"lab": "true", "world": "w.yaml"}, {"lab": "false"})
    choices = [{**ground, "console": seen, "scene": seen} for ground in grounds for seen in ("true", "false")]
    choices.append({"lab": "false"} | {f"{one}_driver": "serial" for one in ("bed", "leg", "camera")})
    started = [[dataclasses.astuple(node) for node in selected(table, one)] for one in choices]
    return table.arguments, started, selected(table, {})


@every_value("nodes.yaml")
def test_a_node_table_changes_what_is_launched_or_is_refused(file, path, tmp_path):
    content = read_yaml(CONFIG / file)
    chosen = path[-1] == "default" and "choices" in content["arguments"][path[1]]
    if path[-1] in ("only_if", "wanted", "choices") or chosen:
        with pytest.raises(InputError, match=r"nodes\.yaml: (arguments|nodes\[)"):
            launched(changed(content, path), tmp_path)
    else:
        assert launched(changed(content, path), tmp_path) != launched(content, tmp_path)
    assert launched(content, tmp_path) == launched(content, tmp_path)


@pytest.mark.parametrize("file", ["demo.yaml"])
@pytest.mark.parametrize(
    ("cameras", "words"),
    [
        ({**CAMERAS, "lateral": {**CAMERAS["lateral"], "frame_rate_hz": 50.0}}, "one for both is needed"),
        ({"dorsal": CAMERAS["dorsal"]}, "dorsal and lateral are needed"),
        ({**CAMERAS, "third": CAMERAS["dorsal"]}, "no camera is called 'third'"),
    ],
)
def test_cameras_that_a_trial_can_not_obey_are_refused(file, cameras, words, tmp_path):
    (tmp_path / "mine.yaml").write_text(dump_yaml(cameras), encoding="utf-8")
    plan = plan_of({**read_yaml(CONFIG / file), "cameras": "mine.yaml"}, file)
    with pytest.raises(InputError, match=words):
        files_of(plan, tmp_path, tmp_path / "out")


def test_the_frame_rate_decides_which_peaks_are_resolved():
    rows = [Row(str(n), 0.6, 0.001, 30.0, "SGCS", n, 0.1, 0.01, 0.01, 0.3, 0.02) for n in range(3)]
    at = {rate: cells_of(from_rows(rows, None, rate)).observables for rate in (np.nan, 100.0, 1000.0)}
    assert at[np.nan] == at[100.0]
    assert "peak_speed" not in at[100.0]
    assert "peak_speed" in at[1000.0]
