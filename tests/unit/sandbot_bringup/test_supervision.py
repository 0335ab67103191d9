import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_bringup.supervision import LOOP, Listening, Sign, Supervisor, pace_fault
from sandbot_common.config import config_file
from sandbot_common.health import ending, has_ended
from sandbot_common.lease import Lease
from sandbot_record.trials.camera_reports import camera_fault
from sandbot_tracking.calibration import read_cameras
from sandbot_tracking.live import LiveTracker

CAMERAS = read_cameras(config_file("cameras.yaml"))
CLOCK, TRACKER = Sign("clock", "/leg_setpoints", 0.5), Sign("tracker", "/speed", 2.0)


def test_who_falls_silent_is_named_and_nobody_else():
    supervisor = Supervisor()
    supervisor.watch(CLOCK, TRACKER, now_s=10.0)
    for t_s in (10.1, 10.4, 10.8):
        supervisor.heard("clock", "/leg_setpoints", t_s)
        assert supervisor.silent(t_s + 0.4) == ""
    assert supervisor.silent(11.4) == "clock is silent: nothing from it on /leg_setpoints for 0.5 s"
    supervisor.heard("clock", "/diagnostics", 11.4)  # a sign of another kind is not this one
    assert supervisor.silent(11.4).startswith("clock")
    supervisor.watch(TRACKER, now_s=11.4)
    assert supervisor.silent(11.9) == ""
    assert supervisor.silent(12.1).startswith("tracker")  # watched since 10.0, not since the last watch


def test_anything_heard_of_a_node_is_its_sign_of_life():
    supervisor = Supervisor()
    supervisor.watch(Sign("tracker", "", 1.0), now_s=0.0)
    supervisor.heard("tracker", "/speed", 0.9)
    supervisor.heard("clock", "/diagnostics", 1.5)
    assert supervisor.silent(1.8) == ""
    assert supervisor.silent(2.0) == "tracker is silent: nothing from it for 1 s"


def test_time_for_which_the_machine_kept_a_node_waiting_is_not_its_silence():
    supervisor, limit_s = Supervisor(), 1.0
    supervisor.watch(Sign("lab", LOOP, limit_s), Sign("bed", LOOP, limit_s), now_s=0.0)
    for who in ("lab", "bed"):
        supervisor.heard(who, LOOP, 0.5)
    supervisor.starved("lab", 3.0)
    assert supervisor.silent(1.6) == "bed is stuck: no sign of its loop for 1 s"
    supervisor.heard("bed", LOOP, 4.0)
    assert supervisor.silent(4.4) == ""
    assert supervisor.silent(4.6).startswith("lab is stuck")  # had a second of the CPU and said nothing
    supervisor.heard("lab", LOOP, 4.7)
    assert supervisor.silent(4.8) == ""
    assert supervisor.age_s("lab", LOOP, 5.8) == pytest.approx(1.1)  # what was withheld before counts no more
    assert supervisor.heard_since("lab", LOOP, 4.6)
    assert not supervisor.heard_since("lab", LOOP, 4.7)
    assert not supervisor.heard_since("clock", LOOP, 0.0)


@given(st.lists(st.floats(0.0, 5.0), max_size=50))
def test_time_of_which_nothing_was_heard_for_want_of_a_cpu_is_no_silence(steps):
    listening, quiet = Listening(0.04), Listening(0.04)
    now_s = 7.0
    listening.look(now_s)
    quiet.look(now_s)
    for step_s in steps:
        now_s += step_s
        listening.look(now_s)
        while quiet.now_s < listening.now_s - 1e-9:  # looks as often as it means to: the time of the wall
            quiet.look(quiet._looked_s + 0.02)
    assert listening.now_s <= min(now_s - 7.0, 0.04 * len(steps)) + 1e-9
    assert quiet.now_s == pytest.approx(quiet._looked_s - 7.0)


@given(
    st.floats(0.01, 10.0), st.lists(st.floats(0.0, 100.0), min_size=1, max_size=20).map(sorted), st.floats(0.0, 50.0)
)
def test_a_lease_lasts_its_limit_from_the_last_renewal_and_never_before_the_first(limit_s, renewals, later_s):
    lease = Lease(limit_s)
    assert lease.late(renewals[0])
    for now_s in renewals:
        lease.renew(now_s)
        assert not lease.late(now_s)
    assert lease.late(renewals[-1] + later_s) is (renewals[-1] + later_s - renewals[-1] > limit_s)


def test_time_that_is_not_a_number_is_late():
    lease = Lease(1.0, 0.0)
    assert lease.late(float("nan"))


def pace(frames, period_ms=10.0, camera="dorsal"):
    told = {"frames": frames, "period_ms": f"{period_ms:.3f}", "calibrated_ms": "10.000"}
    return {f"{camera}_{what}": str(value) for what, value in told.items()}


def test_cameras_must_run_and_at_the_rate_of_their_calibration():
    assert pace_fault(pace(3), pace(50)) == ""
    assert pace_fault({}, pace(50, 12.0)) == ""
    assert pace_fault({}, {}) == ""  # no camera is calibrated: none is asked for
    assert pace_fault(pace(50), pace(50)) == "the dorsal camera sends no new frames"
    both = pace_fault(pace(3), pace(50) | pace(50, 20.0, "lateral"))
    assert both == "the lateral camera takes 50 frames a second, cameras.yaml says 100"


@pytest.mark.parametrize("odd", ["", "abc", "nan", "0", "1.5", "-3", "1" * 5000])
def test_what_a_tracker_says_that_is_no_number_ends_no_campaign(odd):
    before, after = pace(3), pace(50) | {"lost_frames": "0"}
    clocks = {"dorsal_clock": "by the LED", "lateral_clock": "by the LED"}
    for name in after:
        assert isinstance(pace_fault(before, after | clocks | {name: odd}), str)


def test_cameras_whose_clocks_the_led_has_told_must_be_in_step():
    known = {"dorsal_clock": "by the LED", "lateral_clock": "by the LED"}
    before = pace(3) | pace(3, camera="lateral") | {"lost_frames": "2"}
    after = pace(53) | pace(53, camera="lateral")
    assert pace_fault(before, after | known | {"lost_frames": "20"}) == ""
    assert pace_fault(before, after | {"lost_frames": "102", "dorsal_clock": "as stamped"}) == ""
    said = pace_fault(before, after | known | {"lost_frames": "52"})
    assert said.startswith("the cameras are out of step, 50 views without a partner for 50 dorsal frames: restart")


class Filming:
    """A tracker whose two cameras, of 100 frames a second, film noise and the LED."""

    def __init__(self, period_ms=10):
        self.live = LiveTracker(CAMERAS)
        self.rng, self.t_ns, self.period_ns = np.random.default_rng(1), 0, period_ms * 1_000_000

    def run(self, lit):
        """Its own figures, as they arrive, after a frame for each of ``lit``: whether the LED is on."""
        for on in lit:
            self.t_ns += self.period_ns
            for name, view in self.live.views.items():
                x, y, width, height = CAMERAS[name].led_region
                pixels = self.rng.integers(0, 3, view.shape, np.uint8)
                pixels[y : y + height, x : x + width] += 200 * on
                view.look(self.t_ns, self.t_ns, self.t_ns, pixels)
        return {name: str(value) for name, value in self.live.figures.items()}

    def flash(self):
        """A trial starts; every camera sees it."""
        for view in self.live.views.values():
            view.led(self.t_ns + self.period_ns)
        return self.run([True] * 5 + [False] * 25)


def test_what_the_tracker_says_of_itself_is_what_is_checked():
    filming = Filming()
    before, after = filming.run([False] * 30), filming.flash()
    assert pace_fault(before, after) == camera_fault(before, after) == ""
    again = filming.flash()
    assert pace_fault(after, again) == camera_fault(after, again) == ""
    unseen = filming.run([False] * 30)
    assert camera_fault(again, unseen) == "the dorsal camera did not see the LED, so its clock is uncertain"
    assert pace_fault(unseen, unseen) == "the dorsal camera sends no new frames"
    filming.live.lost_frames += 25
    assert "out of step, 25 views without a partner for 30" in pace_fault(unseen, filming.run([False] * 30))
    for view in filming.live.views.values():
        view.clock.jumps += 1
    assert "clock jumped, or disagrees" in camera_fault(unseen, filming.run([]))
    slow = Filming(period_ms=20).run([False] * 30)
    assert pace_fault({}, slow) == "the dorsal camera takes 50 frames a second, cameras.yaml says 100"


def test_only_the_words_of_an_end_are_an_end():
    assert has_ended(ending("SIGTERM"))
    assert not has_ended("the run has ended: it was 30 s long")


def test_who_was_away_is_the_reason_of_a_silence_for_a_while():
    listening = Listening(0.04)
    for now_s in (0.0, 0.02, 0.1):
        listening.look(now_s)
    assert listening.held_up == ""
    listening.look(3.1)
    assert listening.held_up == "the campaign was held up for 3 s"
    for number in range(1, 200):
        listening.look(3.1 + 0.02 * number)
    assert listening.held_up == ""
