import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_bed.protocol import PreparationFailed, ProtocolParameters, PulseProtocol, Stage, prepare
from sandbot_common.errors import InputError

P = ProtocolParameters()
DT = 0.02
BLOWING = {Stage.FLUIDISE, Stage.RAMP_DOWN, Stage.PULSE}
ORDER = [Stage.FLUIDISE, Stage.RAMP_DOWN, Stage.SETTLE, Stage.PULSE]


class Bed:
    """Packs towards φ = 0.633 with blown time in pulses; long air makes it loose again."""

    def __init__(self, noise_m=5e-5, pulses=25.0, loose=0.580, seed=0):
        self.rng, self.noise_m, self.pulses, self.loose = np.random.default_rng(seed), noise_m, pulses, loose
        self.phi, self.level, self.blown_s, self.levels = 0.61, 0.0, 0.0, []

    def set_blower(self, level):
        self.levels.append(level)
        if level == 0 and self.blown_s > 0:
            packed = 0.633 - (0.633 - self.phi) * math.exp(-self.blown_s / 0.1 / self.pulses)
            self.phi = self.loose if self.blown_s > 1 else packed
            self.blown_s = 0.0
        self.level = level

    def advance(self, dt_s):
        self.blown_s += dt_s if self.level > 0 else 0

    def read_height_m(self):
        return 79.75 / (1100 * 1.25 * self.phi) + self.noise_m * self.rng.standard_normal()


def until(stage, protocol, read=lambda: 0.1):
    """Step until ``stage``; the instant it was entered at."""
    for n in range(100_000):
        if protocol.step(n * DT, read()).stage is stage:
            return n * DT
    raise AssertionError(f"never reached {stage}")


@pytest.mark.parametrize("target", [0.580, 0.590, 0.611, 0.632])
def test_reaches_the_target_and_knows_it(target):
    bed = Bed()
    done = prepare(P, bed, target, bed.advance, DT)
    assert abs(done.phi - target) <= P.tolerance
    assert done.phi == pytest.approx(bed.phi, abs=2e-4)
    assert 0 < done.phi_sd < 0.003
    assert bed.levels[-1] == 0


def test_more_pulses_for_a_closer_packing():
    beds = [Bed(), Bed()]
    few, many = (prepare(P, bed, target, bed.advance, DT) for bed, target in zip(beds, (0.59, 0.62), strict=True))
    assert 0 < few.pulses < many.pulses


def test_stages_follow_each_other_without_gaps():
    bed, seen = Bed(), []
    done = prepare(P, bed, 0.59, bed.advance, DT, lambda t_s, command: seen.append((t_s, command.stage)))
    assert [span.stage for span in done.stages[:3]] == ORDER[:3]
    assert sum(span.stage is Stage.PULSE for span in done.stages) == done.pulses
    assert all(a.end_s == b.start_s for a, b in zip(done.stages, done.stages[1:], strict=False))
    assert done.stages[0].end_s == pytest.approx(P.fluidise_s)
    assert seen[-1] == (done.duration_s, Stage.READY)


def test_air_falls_evenly_through_the_ramp_so_that_the_bed_settles_level():
    bed, ramp = Bed(), []
    parameters = replace(P, fluidise_level=0.8)
    done = prepare(parameters, bed, 0.59, bed.advance, DT, lambda t_s, command: ramp.append((t_s, command)))
    span = next(span for span in done.stages if span.stage is Stage.RAMP_DOWN)
    assert span.end_s - span.start_s == pytest.approx(P.ramp_s)
    levels = [command.blower for _, command in ramp if command.stage is Stage.RAMP_DOWN]
    times = [t_s for t_s, command in ramp if command.stage is Stage.RAMP_DOWN]
    remaining = 1 - (np.array(times) - span.start_s) / P.ramp_s
    assert levels == pytest.approx(0.8 * remaining, abs=1e-9)


def test_pulses_shorten_near_the_target():
    # 5 usual pulses pack 63 % of the way: a whole one would step over a window of ±0.001.
    bed, whole = Bed(pulses=5.0), Bed(pulses=5.0)
    assert prepare(P, bed, 0.611, bed.advance, DT).phi == pytest.approx(0.611, abs=P.tolerance)
    with pytest.raises(PreparationFailed, match="overshot 6 times"):
        prepare(replace(P, pulse_min_s=P.pulse_on_s), whole, 0.611, whole.advance, DT)


def test_overshoot_refluidises_then_fails():
    bed = Bed(loose=0.6)
    with pytest.raises(PreparationFailed, match=r"overshot 3 times: φ is 0\.6") as caught:
        prepare(replace(P, max_refluidised=2), bed, 0.59, bed.advance, DT)
    assert caught.value.command.refluidised == 2
    assert bed.levels[-1] == 0


@pytest.mark.parametrize("target", [0.5, 0.578, 0.635, math.nan, math.inf])
def test_refuses_a_target_out_of_reach(target):
    with pytest.raises(InputError, match=r"can't be reached; this bed goes from 0\.5800"):
        PulseProtocol().prepare(target)


def test_refuses_to_begin_twice():
    protocol = PulseProtocol()
    protocol.prepare(0.6)
    with pytest.raises(InputError, match="abort first"):
        protocol.prepare(0.6)


@pytest.mark.parametrize("dt_s", [0.0, -1.0, 0.2, math.nan])
def test_refuses_steps_too_coarse_for_a_pulse(dt_s):
    bed = Bed()
    with pytest.raises(InputError, match=r"pulse_on_s .* is shorter than a step of this bed"):
        prepare(P, bed, 0.6, bed.advance, dt_s)
    assert not bed.levels


@pytest.mark.parametrize("stage", ORDER)
def test_abort_turns_the_air_off_from_anywhere(stage):
    protocol = PulseProtocol()
    protocol.prepare(0.6)
    until(stage, protocol)
    command = protocol.abort("enough")
    assert (command.stage, command.blower, command.reason) == (Stage.IDLE, 0.0, "enough")
    assert protocol.step(1e6, 0.1).blower == 0


@pytest.mark.parametrize("stage", ORDER)
def test_every_stage_times_out(stage):
    protocol = PulseProtocol()
    protocol.prepare(0.6)
    now_s = until(stage, protocol)
    command = protocol.step(now_s + 60, 0.1)
    assert (command.stage, command.blower) == (Stage.FAILED, 0.0)
    assert command.reason.startswith(f"{stage} timed out: 60 s")


def test_settle_times_out_where_the_height_is_too_noisy():
    bed = Bed(noise_m=0.01)
    with pytest.raises(PreparationFailed, match="settle timed out"):
        prepare(P, bed, 0.6, bed.advance, DT)


def test_a_height_of_the_fluidised_bed_that_comes_late_is_forgotten():
    """A sensor that was held up for most of a second repeats what it saw before the rest."""
    protocol = PulseProtocol()
    protocol.prepare(0.6)
    rested_s = until(Stage.SETTLE, protocol) + P.settle_s
    rng = np.random.default_rng(0)
    late_s, step_s = 0.2, 0.01
    for now_s in np.arange(rested_s - P.settle_s + step_s, rested_s + P.overrun_s, step_s):
        above_m = 0.005 if now_s < rested_s - P.average_s + late_s else 0.0
        command = protocol.step(now_s, 0.1 + above_m + 1e-4 * rng.standard_normal())
        if command.stage is not Stage.SETTLE:
            break
    assert command.stage is Stage.PULSE, command.reason
    assert command.phi == pytest.approx(P.phi_loose, abs=P.tolerance)


@pytest.mark.parametrize("stage", ORDER)
@pytest.mark.parametrize(("height_m", "reason"), [(math.nan, "no height"), (math.inf, "outside"), (0.01, "outside")])
def test_bad_heights_fail_with_the_air_off(stage, height_m, reason):
    protocol = PulseProtocol(replace(P, pulse_on_s=2.0, pulse_min_s=2.0))
    protocol.prepare(0.6)
    now_s = until(stage, protocol)
    commands = [protocol.step(now_s + n * DT, height_m) for n in range(1, 60)]
    assert commands[3].stage is not Stage.FAILED  # a short gap is forgiven
    assert (commands[-1].stage, commands[-1].blower) == (Stage.FAILED, 0.0)
    assert reason in commands[-1].reason


def test_a_short_gap_is_never_averaged():
    bed = Bed(noise_m=0.0)
    read, n = bed.read_height_m, iter(range(10**6))
    bed.read_height_m = lambda: math.nan if next(n) % 5 == 0 else read()
    assert prepare(P, bed, 0.6, bed.advance, DT).phi == pytest.approx(bed.phi, rel=1e-9)


def test_a_stuck_height_fails():
    protocol = PulseProtocol()
    protocol.prepare(0.6)
    until(Stage.FAILED, protocol, read=lambda: 0.1)
    assert protocol.command.reason == "height has read exactly 0.1 m through 5 pulses"
    assert protocol.command.blower == 0


def test_a_bed_that_never_gets_there_fails():
    bed = Bed(pulses=1e6)
    with pytest.raises(PreparationFailed, match="target not reached after 20 pulses"):
        prepare(replace(P, max_pulses=20), bed, 0.6, bed.advance, DT)


def test_a_blower_that_does_not_answer_is_found_out_before_five_hundred_pulses():
    bed = Bed()
    bed.set_blower = bed.levels.append  # the sensor lives on, noise and all
    with pytest.raises(PreparationFailed, match=r"φ has stayed 0\.6\d+ through 40 pulses: is the blower on"):
        prepare(P, bed, 0.62, bed.advance, DT)
    assert bed.levels[-1] == 0
    assert max(bed.levels) > 0


@pytest.mark.parametrize("target", [0.6, 0.633])
def test_a_slow_bed_is_not_taken_for_one_without_air(target):
    bed = Bed(pulses=60.0)
    assert prepare(P, bed, target, bed.advance, DT).pulses > 20


def test_time_never_runs_backwards():
    protocol = PulseProtocol()
    protocol.prepare(0.6)
    protocol.step(10.0, 0.1)
    assert protocol.step(9.0, 0.1).stage is Stage.FAILED


def test_a_driver_that_breaks_leaves_the_air_off():
    bed = Bed()

    def broken(dt_s):
        raise OSError("unplugged")

    with pytest.raises(OSError, match="unplugged"):
        prepare(P, bed, 0.6, broken, DT)
    assert bed.levels == [1.0, 0.0]


HEIGHTS = st.one_of(st.floats(0.09, 0.101), st.floats(allow_nan=True, allow_infinity=True))


@given(
    st.floats(0.58, 0.633), st.lists(st.tuples(st.floats(0, 3), HEIGHTS, st.sampled_from("ssssssssap")), max_size=150)
)
def test_air_is_on_only_where_it_may_be(target, events):
    protocol, now_s = PulseProtocol(), 0.0
    for wait_s, height_m, what in events:
        now_s += wait_s
        if what == "a":
            assert protocol.abort().blower == 0
        elif what == "p" and not protocol.command.stage.busy:
            protocol.prepare(target)
        command = protocol.step(now_s, height_m)
        assert 0 <= command.blower <= 1
        assert command.blower == 0 or command.stage in BLOWING


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"pulse_min_s": 1.0}, "pulse_min_s"),
        ({"average_s": 1.5}, "average_s"),
        ({"phi_close": 0.5}, "phi_close"),
        ({"height_loose_m": 0.3}, "height_loose_m"),
    ],
)
def test_parameters_that_contradict_each_other_are_refused(changes, what):
    with pytest.raises(InputError, match=what):
        replace(P, **changes)
