"""A camera's clock found by the LED, and what its stamps tell, against clocks that are known to be off."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_common.config import config_file
from sandbot_tracking.calibration import read_cameras
from sandbot_tracking.camera_clock import NANO, CameraClock
from sandbot_tracking.frame_times import FrameTimes
from sandbot_tracking.live import LiveView

PERIOD, EXPOSURE, LED_ON = 0.01, 0.002, 0.05
T0 = 1_700_000_000 * NANO


class Bench:
    """A camera whose clock shows robot time minus ``offset_s``, filming an LED that flashes."""

    def __init__(self, offset_s, flashes_s, *, phase=0.3, seed=0, lost=0.0, seconds=3.0):
        self.clock = CameraClock(PERIOD, EXPOSURE)
        self.offset_s, self.flashes_s = offset_s, flashes_s
        rng = np.random.default_rng(seed)
        times = (np.arange(round(seconds / PERIOD)) + phase) * PERIOD
        self.times = times[rng.uniform(size=times.size) >= lost]

    def run(self, told=None, robot=True, offset_s=None, late_s=0.005):
        """Every frame ``late_s`` after its exposure; the flashes told (all of them), 20 ms late."""
        told = list(self.flashes_s if told is None else told)
        for t in self.times:
            while told and t + late_s > told[0] + 0.025:
                self.clock.led(T0 + round(told.pop(0) * NANO))
            lit = any(one <= t + EXPOSURE / 4 < one + LED_ON for one in self.flashes_s)
            now = T0 + round((t + late_s) * NANO)
            off = self.offset_s if offset_s is None else offset_s(t)
            self.clock.stamped(T0 + round((t - off) * NANO), now)
            self.clock.frame(T0 + round((t - off) * NANO), now, now if robot else None, lit)
        return self.clock


@pytest.mark.parametrize(("offset_s", "unplaced"), [(1.5, True), (0.0, False)])
def test_frames_that_no_edge_places_tell_how_far_they_are_behind(offset_s, unplaced):
    clock = Bench(offset_s, []).run()
    assert clock.placed != unplaced
    assert clock.behind_ns * 1e-9 == pytest.approx(offset_s + 0.005, abs=1e-3)


@pytest.mark.parametrize(("flashes_s", "placed"), [([2.0], True), ([], False)])
def test_frames_that_arrive_late_are_placed_once_the_edge_is_in_the_film(flashes_s, placed):
    clock = Bench(0.0, flashes_s).run(late_s=1.5)
    assert clock.placed == placed
    assert clock.edges == len(flashes_s)
    assert clock.offset_ns == 0


@given(st.floats(-5, 5), st.floats(0, 1), st.integers(0, 2**32 - 1), st.floats(0, 0.3))
def test_the_offset_is_found_to_what_it_says_of_itself(offset, phase, seed, lost):
    bench = Bench(offset, [1.0037, 2.021], phase=phase, seed=seed, lost=lost)
    clock = bench.run()
    if clock.edges == 0:
        # By chance every lit frame was lost, or the last dark one long before; then nothing is claimed.
        assert clock.half_width_ns is None
        return
    assert clock.placed
    assert clock.half_width_ns >= 0
    if abs(offset) > 0.02:
        slack = 1.01 * clock.half_width_ns * 1e-9 + PERIOD
        assert clock.offset_ns * 1e-9 == pytest.approx(offset, abs=slack)
    if lost == 0.0:
        assert clock.edges == 2
        assert clock.jumps == clock.missed == clock.unannounced == 0
        assert clock.offset_ns * 1e-9 == pytest.approx(offset, abs=PERIOD / 2 + EXPOSURE)


@given(st.floats(0, 1))
def test_a_second_edge_narrows_what_the_first_left(phase):
    once = Bench(2.5, [1.0037], phase=phase).run()
    twice = Bench(2.5, [1.0037, 2.0087], phase=phase).run()
    assert twice.half_width_ns <= once.half_width_ns + 1_000_000
    other = Bench(2.5, [1.0037, 2.0087], phase=0.3).run()
    assert other.half_width_ns < 0.7 * (PERIOD + EXPOSURE) / 2 * NANO


def test_stamps_that_agree_with_the_robot_are_left_alone():
    clock = Bench(0.0, [1.0]).run()
    assert (clock.offset_ns, clock.edges, clock.warning) == (0, 1, "")


def test_a_clock_that_is_far_off_is_held_until_the_led():
    clock = Bench(5.0, []).run()
    assert not clock.placed
    assert "off by about 5.0 s" in clock.warning
    assert Bench(5.0, [1.0]).run().placed
    assert Bench(0.1, []).run().placed


def test_a_clock_a_little_off_is_mended_and_what_came_before_is_said():
    clock = Bench(0.2, [1.0]).run()
    assert clock.offset_ns * 1e-6 == pytest.approx(200, abs=7)
    assert "was off by 0.2" in clock.warning
    assert "misplaced" in clock.warning
    again = Bench(0.2, [1.0, 2.0]).run()
    assert again.warning == ""


def test_edges_that_disagree_are_told():
    bench = Bench(0.0, [1.0, 2.0])
    clock = bench.run(offset_s=lambda t: 3.0 + 0.1 * np.clip(t - 1.1, 0.0, 0.8) / 0.8)  # unseen in any two frames
    assert clock.jumps == 1
    assert "LED edges disagree: the clock jumped by" in clock.warning
    assert clock.offset_ns * 1e-9 == pytest.approx(3.1, abs=0.008)
    # Negative control: drift of 50 ppm is no jump.
    assert Bench(0.0, [1.0, 2.0]).run(offset_s=lambda t: 3.0 + 5e-5 * t).jumps == 0


def test_a_clock_that_is_set_is_not_believed_until_the_next_edge():
    clock = Bench(0.0, [1.0]).run(offset_s=lambda t: 3.0 if t < 2.0 else -4.0)
    assert not clock.placed
    assert clock.half_width_ns is None
    clock = Bench(0.0, [1.0, 2.5]).run(offset_s=lambda t: 3.0 if t < 2.0 else -4.0)
    assert clock.offset_ns * 1e-9 == pytest.approx(-4.0, abs=0.008)


@pytest.mark.parametrize(
    ("set_s", "edges", "warning"), [(0.0, 2, ""), (2.5, 1, "clock is off by about -2.5 s: held until the LED is seen")]
)
def test_frames_that_a_busy_host_heard_late_are_no_clock_that_was_set(set_s, edges, warning):
    """A trial's last frames come 2.7 s late; the next one's at once and from the flash on, as the virtual lab films."""
    clock = CameraClock(PERIOD, EXPOSURE)
    for begin, flash_s, late_s, set_by in ((0.0, 0.1, 2.7, 0.0), (15.0, 0.0, 0.0, set_s)):
        clock.led(T0 + round((begin + flash_s) * NANO))
        for t in PERIOD * np.arange(200):
            heard = T0 + round((begin + t + 0.005 + 0.5 * late_s * t) * NANO)
            clock.frame(T0 + round((begin + t + set_by) * NANO), heard, heard, flash_s <= t < flash_s + LED_ON)
    assert (clock.edges, clock.warning) == (edges, warning)


def test_a_flash_that_only_one_side_tells_is_counted():
    clock = Bench(0.0, [1.0], seconds=15.0).run(told=[])
    assert (clock.unannounced, clock.edges) == (1, 0)
    clock = Bench(0.0, [], seconds=15.0).run(told=[1.0])
    assert (clock.missed, clock.edges, clock.warning) == (1, 0, "LED was not seen")


def test_a_camera_that_begins_with_the_flash_misses_nothing():
    clock = CameraClock(PERIOD, EXPOSURE)
    clock.led(T0)
    for n in range(1200):
        t = T0 + n * 10_000_000
        clock.frame(t, t, t, n < 5)
    assert (clock.missed, clock.offset_ns, clock.placed, clock.warning) == (0, 0, True, "")


def test_a_camera_without_a_robot_is_taken_as_stamped_in_the_end():
    assert not Bench(0.0, [], seconds=3.0).run(robot=False).placed
    assert Bench(0.0, [], seconds=12.0).run(robot=False).placed


@given(
    st.integers(0, 2**32 - 1),
    st.floats(0, 0.1),
    st.lists(st.integers(30, 270), max_size=40, unique=True),
    st.lists(st.integers(30, 270), max_size=20, unique=True),
)
@pytest.mark.slow
def test_what_is_dropped_and_doubled_is_counted(seed, jitter, dropped, doubled):
    rng = np.random.default_rng(seed)
    stamps = ((np.arange(300) + jitter * rng.uniform(-1, 1, 300)) * PERIOD * NANO).astype(int)
    times = FrameTimes(0.02)
    for n, stamp in enumerate(stamps):
        if n not in dropped:
            assert times.add(int(stamp))
            if n in doubled:
                assert not times.add(int(stamp))
    assert times.dropped == len(dropped)
    assert times.doubled == len(set(doubled) - set(dropped))
    assert times.late == 0
    assert times.period_s == pytest.approx(PERIOD, rel=0.06)


@given(st.integers(0, 2**32 - 1), st.lists(st.integers(15, 140), max_size=20, unique=True))
def test_frames_that_change_places_are_late_but_not_dropped(seed, swapped):
    order = list(range(300))
    for n in swapped:
        order[2 * n], order[2 * n + 1] = order[2 * n + 1], order[2 * n]
    times = FrameTimes(PERIOD)
    for n in order:
        assert times.add(n * 10_000_000)
    assert times.late == len(swapped)
    assert times.dropped == 0


def test_jitter_is_measured_and_a_pause_is_no_loss():
    rng = np.random.default_rng(1)
    times = FrameTimes(PERIOD)
    for n in range(400):
        times.add(int((n * PERIOD + 0.0005 * rng.standard_normal() + (20 if n > 200 else 0)) * NANO))
    assert times.dropped == 0
    assert times.jitter_s == pytest.approx(0.0005, rel=0.25)
    even = FrameTimes(PERIOD)
    for n in range(100):
        even.add(n * 10_000_000)
    assert even.jitter_s == 0.0


@pytest.mark.parametrize("led", [False, True])
def test_a_clock_that_is_off_is_placed_by_arrival_only_where_no_led_will_tell(led):
    clock = CameraClock(PERIOD, EXPOSURE, led=led)
    for n in range(40):
        t = T0 + n * 10_000_000
        arrival = t + (5 + n % 7) * 1_000_000
        clock.frame(t - 3_000_000_000, arrival, arrival, False)
    assert clock.placed is not led
    assert clock.offset_ns == (0 if led else 3_005_000_000)
    assert ("held until the LED" if led else "placed by when frames arrive") in clock.warning


@pytest.mark.parametrize(("every", "frames", "period_s"), [(1, 60, 0.01), (2, 30, 0.02)])
def test_a_picture_sent_again_with_a_new_stamp_is_no_frame_but_one_at_rest_is(rng, every, frames, period_s):
    """Of a robot at rest only the noise differs; a driver that keeps the nominal rate repeats every second picture."""
    view = LiveView(read_cameras(config_file("cameras.yaml"))["dorsal"])
    scene = np.full(view.shape, 60, np.uint8)
    for n in range(60):
        if n % every == 0:
            noisy = scene + rng.integers(0, 2, view.shape, np.uint8)
        stamp = T0 + n * 10_000_000
        assert view.look(stamp, stamp, stamp, noisy) is (n % every == 0)
    assert (view.times.frames, view.times.repeated) == (frames, 60 - frames)
    assert view.times.period_s == pytest.approx(period_s)
    assert view.frozen == every - 1


@pytest.mark.parametrize(("by_s", "lost"), [(-0.5, 0.3), (-0.1, 0.3), (-0.02, 0.0), (0.1, 0.3), (0.5, 0.3)])
def test_a_clock_that_jumps_in_mid_trial_is_counted_at_once_and_not_again_at_the_next_flash(by_s, lost):
    """Its film gave an ok row with a speed 17 % too high, or a lift 37 % too low."""
    clock = Bench(0.0, [1.0], lost=lost).run(offset_s=lambda t: -by_s * (t > 2.0))
    assert (clock.edges, clock.jumps) == (1, 1)
    assert clock.warning.startswith("stamps jumped")
    assert clock.half_width_ns is None
    clock = Bench(0.0, [1.0, 2.5]).run(offset_s=lambda t: -by_s * (t > 2.0))
    assert (clock.edges, clock.jumps) == (2, 1)
    assert clock.offset_ns == pytest.approx(-by_s * NANO, abs=PERIOD * NANO)


def test_frames_that_wait_are_lost_or_out_of_order_are_no_jump():
    clock, rng = CameraClock(PERIOD, EXPOSURE), np.random.default_rng(1)
    stamps = T0 + np.arange(1000) * round(PERIOD * NANO)
    stamps[300], stamps[600:612] = stamps[295], stamps[599]  # one too old, then the same one over and over
    waits = rng.exponential(0.2, stamps.size) * NANO
    now = np.maximum.accumulate(T0 + np.arange(1000) * round(PERIOD * NANO) + waits.astype(np.int64))
    now[:50] += NANO // 2  # as the reader began
    for stamp, received, lost in zip(stamps.tolist(), now.tolist(), rng.random(stamps.size) < 0.2, strict=True):
        if not lost:
            clock.stamped(stamp, received)
            clock.frame(stamp, received, received, lit=False)
    assert clock.jumps == 0
