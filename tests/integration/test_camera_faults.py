"""Faults of a camera in the middle of a trial: its row is right, or says what is wrong; never a wrong number."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from sandbot_bringup.config import config_folder
from sandbot_bringup.plan import Plan, trials_of
from sandbot_bringup.provenance import trial_message, trial_metadata
from sandbot_bringup.trial_bag import TrialBag
from sandbot_clock.gait import leg_angles
from sandbot_common import messages, topics
from sandbot_common.robot import SANDBOT
from sandbot_common.yaml_text import read_yaml
from sandbot_lab.cameras import LabCamera
from sandbot_lab.film import Film
from sandbot_lab.live_trial import LED_ON_S
from sandbot_lab.robot import simulate
from sandbot_lab.world import null_world
from sandbot_record.trials.from_bags import row_from_bag
from sandbot_tracking.calibration import cameras_from_mapping
from sandbot_tracking.live import LiveTracker

pytestmark = pytest.mark.slow

START_NS, NANO = 1_700_000_000_000_000_000, 1_000_000_000
PLAN = Plan(name="one", phi=(0.605,), omega_rad_s=(12.0,), replicates=1, gait="UNIFORM", periods=5.0)
(TRIAL,) = trials_of(PLAN)
SECTIONS = read_yaml(config_folder() / "cameras.yaml")
CAMERAS = cameras_from_mapping(SECTIONS, "cameras")
STANDING_S, AFTER_S = 0.3, 0.3


class Trial:
    """A trial of the lab as it was filmed: times of the frames [s] and both views."""

    def __init__(self, film=None, sections=SECTIONS):
        self.cameras = cameras_from_mapping(sections, "cameras")
        count = round(PLAN.duration_s(TRIAL.omega_rad_s) * 200) + 1
        self.t_s = np.arange(count) / 200
        self.angles, self.rates = leg_angles(PLAN.clock_gait, TRIAL.omega_rad_s, self.t_s, 3)
        self.trace = simulate(null_world(), TRIAL.phi, self.t_s, self.angles, self.rates, seed=TRIAL.seed)
        views = {name: LabCamera(name, sections[name], TRIAL.seed, SANDBOT, film) for name in CAMERAS}
        rate_hz = CAMERAS["dorsal"].frame_rate_hz
        numbers = range(-round(STANDING_S * rate_hz), round((self.t_s[-1] + AFTER_S) * rate_hz))
        self.frame_s = np.array([views["dorsal"].instant_s(number) for number in numbers])
        self.come = {name: [view.comes(number) for number in numbers] for name, view in views.items()}
        self.films = {
            name: [view.film(self.trace, t_s, 0.0 <= t_s < LED_ON_S) for t_s in self.frame_s]
            for name, view in views.items()
        }

    def row(self, folder, change=lambda _, __, t_s, pixels: (t_s, pixels)):
        """The row of the table where each frame (camera, number, stamp [s], pixels) came as ``change`` says, or not."""
        tracker, bag = LiveTracker(self.cameras), TrialBag(START_NS)
        bag.announce(trial_message(PLAN, TRIAL, SANDBOT, START_NS))
        bag.legs_start(1.0)
        zero_ns = START_NS + NANO
        bag.add(topics.BED_PHI, START_NS + 1, messages.float64(TRIAL.phi))
        torque = np.zeros_like(self.angles)
        for topic in (topics.LEG_SETPOINTS, topics.LEG_STATES):
            bag.legs(topic, self.t_s, self.angles, self.rates, torque)
        for name, camera in self.cameras.items():
            bag.camera(name, -STANDING_S, camera)
        told = False
        for number, t_s in enumerate(self.frame_s):
            now_ns = zero_ns + round(t_s * NANO)
            if t_s >= 0 and not told:
                told, _ = True, tracker.led(zero_ns)
            moment = max(int(np.searchsorted(self.t_s, t_s, side="right")) - 1, 0)
            tracker.legs(now_ns, self.angles[moment], now_ns)
            for name in CAMERAS:
                come = change(name, number, t_s, self.films[name][number])
                for _ in range(self.come[name][number] if come is not None else 0):
                    stamp_s, pixels = come
                    for at_ns, sample in tracker.frame(name, zero_ns + round(stamp_s * NANO), pixels, now_ns):
                        bag.sample(replace(sample, t_s=(at_ns - zero_ns) / NANO))
        self.moved = tracker.moved
        path = folder / "bag"
        bag.write(path, trial_metadata(PLAN, TRIAL, SANDBOT, START_NS, "live", "ok"), {})
        return row_from_bag(path)


@pytest.fixture(scope="module")
def trial():
    return Trial()


@pytest.fixture(scope="module")
def row(trial, tmp_path_factory):
    """The row where nothing goes wrong."""
    return trial.row(tmp_path_factory.mktemp("sound"))


def dropped(name, number, t_s, pixels):
    lost = np.random.default_rng([number, len(name)]).random() < 0.3
    return None if lost and not 0.0 <= t_s < LED_ON_S else (t_s, pixels)


def stamped_off(seconds, *cameras):
    return lambda name, _, t_s, pixels: (t_s + seconds * (name in cameras), pixels)


def without_led(name, number, t_s, pixels):
    left, top, width, height = (int(one) for one in CAMERAS[name].led_region)
    dark = pixels.copy()
    dark[top : top + height, left : left + width] = 50
    return t_s, dark


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(dropped, id="30 % of the frames dropped"),
        pytest.param(stamped_off(5.0, "dorsal", "lateral"), id="both clocks 5 s ahead"),
        pytest.param(stamped_off(-5.0, "lateral"), id="one clock 5 s behind"),
        pytest.param(without_led, id="no LED in view"),
    ],
)
def test_what_can_be_mended_gives_the_same_row(trial, row, tmp_path, change):
    other = trial.row(tmp_path, change)
    assert (row.status, other.status) == ("ok", "ok")
    assert other.speed_m_s == pytest.approx(row.speed_m_s, rel=0.01)
    assert other.lift_m == pytest.approx(row.lift_m, abs=2e-4)


@pytest.mark.parametrize("by_s", [-2.0, -0.3, 3.0])
def test_a_single_stamp_that_is_wrong_costs_a_frame(trial, row, tmp_path, by_s):
    wrong = len(trial.frame_s) // 2
    other = trial.row(tmp_path, lambda name, number, t_s, pixels: (t_s + by_s * (number == wrong), pixels))
    assert other.status == "ok"
    assert other.speed_m_s == pytest.approx(row.speed_m_s, rel=0.01)


@pytest.mark.parametrize("since_s", [-STANDING_S, 0.8])
def test_pictures_sent_twice_with_advancing_stamps_give_the_same_row(trial, row, tmp_path, since_s):
    """A camera at half the rate behind a driver that keeps the nominal one."""

    def twice(name, number, t_s, pixels):
        return t_s, trial.films[name][number - number % 2] if t_s >= since_s else pixels

    other = trial.row(tmp_path, twice)
    assert other.status == "ok"
    assert other.speed_m_s == pytest.approx(row.speed_m_s, rel=0.01)
    assert other.lift_m == pytest.approx(row.lift_m, abs=2e-4)
    assert other.peak_speed_m_s == pytest.approx(row.peak_speed_m_s, rel=0.03)


@pytest.mark.parametrize("cameras", [("dorsal", "lateral"), ("lateral",)])
def test_a_clock_that_runs_fast_after_the_led_gives_no_lift(trial, row, tmp_path, cameras):
    """The LED gives one offset; the rate is told by the steps, which must last as long as those of the legs."""
    other = trial.row(tmp_path, lambda name, _, t_s, pixels: (t_s * (1 + 0.01 * (t_s > 0 and name in cameras)), pixels))
    assert np.isnan(other.lift_m)
    assert np.isnan(other.peak_speed_m_s) or other.peak_speed_m_s == pytest.approx(row.peak_speed_m_s, rel=0.02)
    assert other.speed_m_s == pytest.approx(row.speed_m_s, rel=0.01)


def hidden(camera, since_s, for_s):
    """A hand before the camera."""
    dark = np.full((CAMERAS[camera].height, CAMERAS[camera].width), 50, np.uint8)
    return lambda name, _, t_s, pixels: (
        t_s, dark if name == camera and since_s <= t_s < since_s + for_s else pixels
    )  # fmt: skip


def frozen(trial, camera, since_s):
    """The driver sends the frame of that moment again and again, with new stamps."""
    at = int(np.searchsorted(trial.frame_s, since_s))
    return lambda name, number, t_s, pixels: (
        t_s, trial.films[name][at] if name == camera and number > at else pixels
    )  # fmt: skip


@pytest.mark.parametrize(
    ("fault", "status"),
    [
        (lambda _: hidden("dorsal", 0.8, 0.3), "tracking lost: no centre of mass for 0.3"),
        (lambda _: hidden("lateral", 0.8, 0.3), "tracking lost: no centre of mass for 0.3"),
        (lambda trial: frozen(trial, "dorsal", 0.8), "tracking lost: no centre of mass"),
        (lambda trial: frozen(trial, "lateral", 0.8), "tracking lost: no centre of mass"),
    ],
)
def test_what_cannot_is_said(trial, tmp_path, fault, status):
    assert trial.row(tmp_path, fault(trial)).status.startswith(status)


@pytest.mark.parametrize(
    "film",
    [
        pytest.param(
            Film(0.8, uneven=0.3, flicker=0.1, glints=20, jpeg_quality=85, dropped=0.05, doubled=0.05, jitter_s=0.001),
            id="a little of all",
        ),
        *(
            pytest.param(film, id=str(name), marks=pytest.mark.whole)
            for name, film in {
                "defocus": Film(defocus_px=1.5),
                "uneven light": Film(uneven=0.5),
                "flicker": Film(flicker=0.2),
                "glints": Film(glints=60),
                "JPEG": Film(jpeg_quality=60),
                "dropped": Film(dropped=0.2),
                "doubled": Film(doubled=0.3),
                "variable frame rate": Film(jitter_s=0.003),
                "a thin cable": Film(cable_px=1.5),
            }.items()
        ),
    ],
)
def test_a_bad_film_gives_the_same_row(row, tmp_path, film):
    other = Trial(film).row(tmp_path)
    assert other.status == "ok"
    assert other.speed_m_s == pytest.approx(row.speed_m_s, rel=0.01)
    assert other.lift_m == pytest.approx(row.lift_m, abs=2e-4)


@pytest.mark.parametrize(
    "film",
    [
        pytest.param(Film(cable_px=60.0), id="a marker goes behind something"),
        *(
            pytest.param(film, id=str(name), marks=pytest.mark.whole)
            for name, film in {
                "no focus at all": Film(defocus_px=12.0),
                "next to no frames": Film(dropped=0.9),
                "a dark room": Film(uneven=1.0, flicker=1.0, flicker_hz=1.0),
            }.items()
        ),
    ],
)
def test_a_film_too_bad_is_told_and_gives_no_number_of_its_own(row, tmp_path, film):
    other = Trial(film).row(tmp_path)
    assert other.status != "ok"
    assert np.isnan(other.speed_m_s) or other.speed_m_s == pytest.approx(row.speed_m_s, rel=0.1)


def posed(name, turn, lens=(0.0,) * 5, sideways=False):
    """The section of a camera that looks where it looked from elsewhere: turned about the middle of its view.

    ``turn`` [rad]: about the axes of the camera. ``sideways``: it lies on its side, with a picture as high as wide.
    """
    section = dict(SECTIONS[name], distortion=list(lens))
    axes, place = np.array(section["rotation"]), np.array(section["position_m"])
    along = axes[2]
    normal = "xyz".index(section["plane"]["normal"])
    middle = place + along * (section["plane"]["offset_m"] - place[normal]) / along[normal]
    turned = cv2.Rodrigues(np.array(turn, float))[0] @ axes
    if sideways:
        turned = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) @ turned
        section |= {
            key: section[other] for key, other in {"width": "height", "height": "width", "cx": "cy", "cy": "cx"}.items()
        }
    position = middle - turned[2] * np.linalg.norm(middle - place)
    return section | {"rotation": turned.tolist(), "position_m": position.tolist()}


def of_both(dorsal, lateral):
    return {name: posed(name, **how) for name, how in (("dorsal", dorsal), ("lateral", lateral))}


LENS = (-0.15, 0.04, 0.0005, -0.0005, 0.0)
TILTED = of_both({"turn": (0.06, 0.12, 0.05), "lens": LENS}, {"turn": (-0.05, 0.1, 0.03), "lens": LENS})


@pytest.mark.parametrize(
    "sections",
    [
        pytest.param(TILTED, id="tilted, through a lens that bends"),
        pytest.param(
            of_both({"turn": (0, 0, 0), "sideways": True}, {"turn": (0, 0.05, 0), "sideways": True}),
            id="on their sides",
            marks=pytest.mark.whole,
        ),
    ],
)
def test_cameras_that_do_not_look_straight_give_the_same_row(row, tmp_path, sections):
    other = Trial(sections=sections).row(tmp_path)
    assert other.status == "ok"
    assert other.speed_m_s == pytest.approx(row.speed_m_s, rel=0.01)
    assert other.lift_m == pytest.approx(row.lift_m, abs=2e-4)


def test_a_tilted_camera_taken_for_a_straight_one_gives_another_lift(row, tmp_path):
    tilted = Trial(sections=TILTED)
    tilted.cameras = CAMERAS
    assert abs(tilted.row(tmp_path).lift_m - row.lift_m) > 4e-4


@pytest.mark.parametrize("view", CAMERAS)
def test_a_camera_that_is_knocked_in_the_walk_is_named(trial, row, tmp_path, view):
    """Its row is ok by what the frames show: 10 px make the speed 6 % too high."""
    middle = len(trial.frame_s) // 2

    def knocked(name, number, t_s, pixels):
        return t_s, np.roll(pixels, 10, axis=1) if name == view and number >= middle else pixels

    other = trial.row(tmp_path / "knocked", knocked)
    moved = f"{view}: the camera has moved by "
    assert trial.moved.startswith(moved)
    assert float(trial.moved.removeprefix(moved).split(" px")[0]) == pytest.approx(10.0, abs=0.5)
    if view == "dorsal":
        assert other.speed_m_s > 1.05 * row.speed_m_s
    trial.row(tmp_path / "still")
    assert trial.moved == ""
