"""Faults of a camera in the middle of a trial: its row is right, or says what is wrong; never a wrong number."""

from dataclasses import replace

import numpy as np
import pytest

from sandbot_bringup.config import config_folder
from sandbot_bringup.plan import Plan, trials_of
from sandbot_bringup.provenance import trial_message, trial_metadata
from sandbot_bringup.trial_bag import TrialBag
from sandbot_clock.gait import leg_angles
from sandbot_common import messages, topics
from sandbot_common.files import read_yaml
from sandbot_common.robot import SANDBOT
from sandbot_lab.cameras import LabCamera
from sandbot_lab.robot import simulate
from sandbot_lab.stage import LED_ON_S
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

    def __init__(self):
        count = round(PLAN.duration_s(TRIAL.omega_rad_s) * 200) + 1
        self.t_s = np.arange(count) / 200
        self.angles, self.rates = leg_angles(PLAN.clock_gait, TRIAL.omega_rad_s, self.t_s, 3)
        self.trace = simulate(null_world(), TRIAL.phi, self.t_s, self.angles, self.rates, seed=TRIAL.seed)
        views = {name: LabCamera(name, SECTIONS[name], TRIAL.seed, SANDBOT) for name in CAMERAS}
        self.frame_s = np.arange(-STANDING_S, self.t_s[-1] + AFTER_S, 1 / CAMERAS["dorsal"].frame_rate_hz)
        self.films = {
            name: [view.film(self.trace, t_s, 0.0 <= t_s < LED_ON_S) for t_s in self.frame_s]
            for name, view in views.items()
        }

    def row(self, folder, change):
        """The row of the table where each frame (camera, number, stamp [s], pixels) came as ``change`` says, or not."""
        tracker, bag = LiveTracker(CAMERAS), TrialBag(START_NS)
        bag.announce(trial_message(PLAN, TRIAL, SANDBOT, START_NS))
        bag.legs_start(1.0)
        zero_ns = START_NS + NANO
        bag.add(topics.BED_PHI, START_NS + 1, messages.float64(TRIAL.phi))
        torque = np.zeros_like(self.angles)
        for topic in (topics.LEG_SETPOINTS, topics.LEG_STATES):
            bag.legs(topic, self.t_s, self.angles, self.rates, torque)
        for name, camera in CAMERAS.items():
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
                if come is not None:
                    stamp_s, pixels = come
                    for at_ns, sample in tracker.frame(name, zero_ns + round(stamp_s * NANO), pixels, now_ns):
                        bag.sample(replace(sample, t_s=(at_ns - zero_ns) / NANO))
        path = folder / "bag"
        bag.write(path, trial_metadata(PLAN, TRIAL, SANDBOT, START_NS, "live", "ok"), {})
        return row_from_bag(path)


@pytest.fixture(scope="module")
def trial():
    return Trial()


@pytest.fixture(scope="module")
def row(trial, tmp_path_factory):
    """The row where nothing goes wrong."""
    return trial.row(tmp_path_factory.mktemp("sound"), lambda _, __, t_s, pixels: (t_s, pixels))


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
