"""The pulse protocol (Li09, methods): fluidise, ramp the air down, then pack by short pulses until φ is reached.

    idle ── prepare ──► fluidise ─► ramp_down ─► settle ─► ready
                           ▲                      │  ▲ │
                           └───── overshoot ──────┘  └─┴─► pulse           abort: idle; anything wrong: failed

A pure state machine: ``step(now_s, height_m)`` says what the blower does next. It has no clock, no sleep and no
hardware, so the live node and the batch campaign share it. Air is on in fluidise, ramp_down and pulse only.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from sandbot_bed.hardware import BedHardware
from sandbot_bed.volume_fraction import Measured, volume_fraction
from sandbot_common.errors import InputError
from sandbot_common.parameters import parameter


@dataclass(frozen=True)
class ProtocolParameters:
    """The bed and how it is prepared; by default a 2.5 m × 0.5 m bed of poppy seed, 0.1 m high when loose.

    Raises InputError if values contradict each other.
    """

    fluidise_s: float = parameter(5.0, unit="s", doc="time at full air", low=0.1, high=600)
    ramp_s: float = parameter(5.0, unit="s", doc="time in which the air is ramped down", low=0.1, high=600)
    settle_s: float = parameter(2.0, unit="s", doc="rest before φ is read after the ramp", low=0.05, high=600)
    pulse_on_s: float = parameter(0.1, unit="s", doc="longest air pulse", low=0.01, high=10)
    pulse_off_s: float = parameter(1.0, unit="s", doc="rest before φ is read after a pulse", low=0.05, high=60)
    pulse_min_s: float = parameter(0.02, unit="s", doc="shortest air pulse, close to the target", low=0.001, high=10)
    fluidise_level: float = parameter(1.0, doc="blower level that fluidises", low=0.01, high=1)
    pulse_level: float = parameter(1.0, doc="blower level of a pulse", low=0.01, high=1)
    tolerance: float = parameter(0.001, doc="largest |φ − target| accepted", low=1e-5, high=0.05)
    average_s: float = parameter(0.5, unit="s", doc="last part of a rest in which heights are averaged", low=0, high=60)
    min_readings: int = parameter(5, doc="fewest heights averaged", low=2, high=10000)
    max_pulses: int = parameter(500, doc="pulses after which a preparation fails", low=1, high=100000)
    max_refluidised: int = parameter(5, doc="overshoots after which a preparation fails", low=0, high=1000)
    overrun_s: float = parameter(2.0, unit="s", doc="longest time over plan in any stage", low=0.01, high=600)
    bad_reading_s: float = parameter(0.5, unit="s", doc="longest time without a good height", low=0.0, high=60)
    stuck_pulses: int = parameter(5, doc="pulses without any change in any reading: stuck", low=2, high=1000)
    idle_pulses: int = parameter(
        40, doc="pulses in which φ rises by less than a quarter of the tolerance", low=2, high=1000
    )
    height_low_m: float = parameter(0.05, unit="m", doc="lowest plausible height", low=0.001, high=10)
    height_high_m: float = parameter(0.2, unit="m", doc="highest plausible height", low=0.001, high=10)
    height_loose_m: float = parameter(0.1, unit="m", doc="height of the loose bed", low=0.001, high=10)
    phi_close: float = parameter(0.633, doc="highest volume fraction pulses reach", low=0.3, high=0.74)
    mass_kg: float = parameter(79.75, unit="kg", doc="mass of the grains", low=0.001, high=1e5)
    rho_grain_kg_m3: float = parameter(1100.0, unit="kg/m3", doc="density of a grain", low=10, high=3e4)
    area_m2: float = parameter(1.25, unit="m2", doc="floor area of the bed", low=1e-4, high=1e3)
    mass_sd_kg: float = parameter(0.05, unit="kg", doc="uncertainty of mass_kg", low=0, high=1e4)
    rho_grain_sd_kg_m3: float = parameter(2.0, unit="kg/m3", doc="uncertainty of rho_grain_kg_m3", low=0, high=3e3)
    area_sd_m2: float = parameter(0.0014, unit="m2", doc="uncertainty of area_m2", low=0, high=100)
    height_sd_m: float = parameter(5e-5, unit="m", doc="calibration uncertainty of the height", low=0, high=0.1)

    def __post_init__(self) -> None:
        if not self.height_low_m < self.height_loose_m < self.height_high_m:
            raise InputError(
                f"bed: height_loose_m {self.height_loose_m} is not between height_low_m {self.height_low_m} "
                f"and height_high_m {self.height_high_m}"
            )
        if not self.phi_loose < self.phi_close:
            raise InputError(
                f"bed: phi_close {self.phi_close} is not above the loose bed's {self.phi_loose:.4f} "
                "(from mass_kg, rho_grain_kg_m3, area_m2 and height_loose_m)"
            )
        if self.pulse_min_s > self.pulse_on_s:
            raise InputError(f"bed: pulse_min_s {self.pulse_min_s} is longer than pulse_on_s {self.pulse_on_s}")
        if self.average_s > min(self.settle_s, self.pulse_off_s):
            raise InputError(f"bed: average_s {self.average_s} is longer than the rest before φ is read")

    @property
    def phi_loose(self) -> float:
        """The volume fraction of the loose bed."""
        return self.phi(Measured(self.height_loose_m)).value

    def phi(self, height_m: Measured) -> Measured:
        """φ and σ_φ at a height; the sensor's calibration uncertainty is added to the height's own in quadrature."""
        height = Measured(height_m.value, math.hypot(height_m.sd, self.height_sd_m))
        mass = Measured(self.mass_kg, self.mass_sd_kg)
        density = Measured(self.rho_grain_kg_m3, self.rho_grain_sd_kg_m3)
        return volume_fraction(mass, density, Measured(self.area_m2, self.area_sd_m2), height)

    def check_target(self, target_phi: float) -> None:
        """Raises InputError if pulses can't reach ``target_phi``."""
        low, high = self.phi_loose - self.tolerance, self.phi_close + self.tolerance
        if not low <= target_phi <= high:
            raise InputError(
                f"bed: target_phi {target_phi} can't be reached; this bed goes from {self.phi_loose:.4f} (loose) "
                f"to {self.phi_close:.4f} (close)"
            )

    def check_step(self, dt_s: float) -> None:
        """Raises InputError if steps of ``dt_s`` are too coarse for a pulse."""
        if not 0 < dt_s <= self.pulse_on_s:
            raise InputError(f"bed: pulse_on_s {self.pulse_on_s:g} s is shorter than a step of this bed, {dt_s:g} s")


class Stage(StrEnum):
    """The stage of a preparation."""

    IDLE = "idle"
    FLUIDISE = "fluidise"
    RAMP_DOWN = "ramp_down"
    SETTLE = "settle"
    PULSE = "pulse"
    READY = "ready"
    FAILED = "failed"

    @property
    def busy(self) -> bool:
        """Whether a preparation is under way."""
        return self not in (Stage.IDLE, Stage.READY, Stage.FAILED)


@dataclass(frozen=True)
class Command:
    """What the blower is to do now, and what is known; φ and σ_φ are NaN until they have been measured."""

    preparation: int = 0
    """Number of this preparation, from 1; 0 before the first."""
    stage: Stage = Stage.IDLE
    blower: float = 0.0
    target_phi: float = math.nan
    pulses: int = 0
    refluidised: int = 0
    phi: float = math.nan
    phi_sd: float = math.nan
    height_m: float = math.nan
    reason: str = ""


class PulseProtocol:
    """The state machine. ``prepare`` and ``abort`` take effect at once, time passes only in ``step``."""

    def __init__(self, parameters: ProtocolParameters | None = None) -> None:
        self.parameters = parameters or ProtocolParameters()
        self.command = Command()
        self._now_s = self._entered_s = self._good_s = math.nan  # NaN: not known before the first step
        self._planned_s = 0.0
        self._readings: list[tuple[float, float]] = []  # (s since the stage began, m)
        self._reset_pulses()

    def prepare(self, target_phi: float) -> None:
        """Begin at the next step. Raises InputError if busy or if ``target_phi`` can't be reached."""
        if self.command.stage.busy:
            raise InputError(f"bed: busy ({self.command.stage}); abort first")
        self.parameters.check_target(target_phi)
        self.command = Command(self.command.preparation + 1, target_phi=target_phi)
        self._now_s = self._good_s = math.nan
        self._reset_pulses()
        self._enter(Stage.FLUIDISE, self.parameters.fluidise_s, self.parameters.fluidise_level)

    def abort(self, reason: str = "aborted") -> Command:
        """Air off, from any stage; a preparation under way ends in idle with the reason."""
        if self.command.stage.busy:
            self.command = replace(self.command, stage=Stage.IDLE, reason=reason)
        self.command = replace(self.command, blower=0.0)
        return self.command

    def fail(self, reason: str) -> Command:
        """Air off and failed, for an external reason such as moving legs."""
        self.command = replace(self.command, stage=Stage.FAILED, blower=0.0, reason=reason)
        return self.command

    def step(self, now_s: float, height_m: float) -> Command:
        """What to do at ``now_s`` (any origin, never backwards) with this height reading (NaN: none)."""
        self.command = replace(self.command, height_m=height_m)
        if not self.command.stage.busy:
            return self.command
        if not math.isfinite(now_s) or now_s < self._now_s:
            return self.fail(f"time went from {self._now_s} s to {now_s} s")
        self._now_s = now_s
        if math.isnan(self._entered_s):
            self._entered_s = now_s
        if math.isnan(self._good_s):
            self._good_s = now_s
        if reason := self._bad_reading(height_m) or self._timed_out():
            return self.fail(reason)
        stages = {
            Stage.FLUIDISE: self._fluidise,
            Stage.RAMP_DOWN: self._ramp_down,
            Stage.SETTLE: self._settle,
            Stage.PULSE: self._pulse,
        }
        stages[self.command.stage]()
        return self.command

    def _bad_reading(self, height_m: float) -> str:
        # Why the readings can't be trusted any more; a short gap is tolerated, but never averaged.
        p = self.parameters
        if p.height_low_m <= height_m <= p.height_high_m:
            self._good_s = self._now_s
            return ""
        if self._now_s - self._good_s < p.bad_reading_s:
            return ""
        if math.isnan(height_m):
            return f"no height reading for {p.bad_reading_s:g} s"
        return f"height reading {height_m} m is outside [{p.height_low_m:g}, {p.height_high_m:g}] m"

    def _timed_out(self) -> str:
        limit_s = self._planned_s + self.parameters.overrun_s
        if self._elapsed_s <= limit_s:
            return ""
        return f"{self.command.stage} timed out: {self._elapsed_s:.3g} s, at most {limit_s:.3g} s"

    @property
    def _elapsed_s(self) -> float:
        return self._now_s - self._entered_s

    @property
    def _done(self) -> bool:
        # Times are sums of float steps, so allow a nanosecond.
        return self._elapsed_s >= self._planned_s - 1e-9

    def _enter(self, stage: Stage, planned_s: float, blower: float) -> None:
        self.command = replace(self.command, stage=stage, blower=blower)
        self._entered_s, self._planned_s = self._now_s, planned_s
        self._readings = []

    def _fluidise(self) -> None:
        if self._done:
            self._enter(Stage.RAMP_DOWN, self.parameters.ramp_s, self.parameters.fluidise_level)

    def _ramp_down(self) -> None:
        remaining = 1 - self._elapsed_s / self._planned_s
        self.command = replace(self.command, blower=self.parameters.fluidise_level * max(0.0, remaining))
        if self._done:
            self._enter(Stage.SETTLE, self.parameters.settle_s, 0.0)

    def _pulse(self) -> None:
        if self._done:
            self._last_pulse_s = self._elapsed_s
            self._enter(Stage.SETTLE, self.parameters.pulse_off_s, 0.0)

    def _settle(self) -> None:
        p = self.parameters
        averaging = self._elapsed_s >= self._planned_s - p.average_s - 1e-9
        if averaging and self._good_s == self._now_s:
            self._readings.append((self._elapsed_s, self.command.height_m))
        if not self._done:
            return
        # A prolonged rest discards its first half, in which grains or the sensor were still settling.
        since_s = self._elapsed_s / 2 - 1e-9
        heights = np.array([height_m for at_s, height_m in self._readings if at_s >= since_s])
        if len(heights) < p.min_readings:
            return
        mean = Measured(float(heights.mean()), float(heights.std(ddof=1)) / math.sqrt(len(heights)))
        # Too noisy for the tolerance, or not yet at rest: go on averaging until the stage times out.
        half = len(heights) // 2
        moved = abs(heights[:half].mean() - heights[half:].mean()) / (2 * mean.value)
        if p.phi(mean).value * max(mean.relative_sd, moved) > p.tolerance / 2:
            return
        self._measured(mean, stuck_at_m=heights[0] if np.all(heights == heights[0]) else math.nan)

    def _measured(self, height_m: Measured, stuck_at_m: float) -> None:
        before = self.command.phi
        phi = self.parameters.phi(height_m)
        self.command = replace(self.command, phi=phi.value, phi_sd=phi.sd, height_m=height_m.value)
        gap = self.command.target_phi - phi.value
        if abs(gap) <= self.parameters.tolerance:
            self._enter(Stage.READY, 0.0, 0.0)
        elif gap < 0:
            self._overshot()
        elif self._stuck(stuck_at_m):
            self.fail(f"height has read exactly {stuck_at_m} m through {self.parameters.stuck_pulses} pulses")
        elif self._idle(phi.value):
            self.fail(f"φ has stayed {phi.value:.4f} through {self.parameters.idle_pulses} pulses: is the blower on?")
        elif self.command.pulses >= self.parameters.max_pulses:
            self.fail(f"target not reached after {self.command.pulses} pulses: φ is {phi.value:.4f}")
        else:
            self.command = replace(self.command, pulses=self.command.pulses + 1)
            gain_per_s = (phi.value - before) / self._last_pulse_s
            self._enter(Stage.PULSE, self._pulse_length_s(gap, gain_per_s), self.parameters.pulse_level)

    def _overshot(self) -> None:
        p, command = self.parameters, self.command
        if command.refluidised >= p.max_refluidised:
            self.fail(f"overshot {command.refluidised + 1} times: φ is {command.phi:.4f}, not {command.target_phi:.4f}")
            return
        self.command = replace(command, refluidised=command.refluidised + 1)
        self._reset_pulses()
        self._enter(Stage.FLUIDISE, p.fluidise_s, p.fluidise_level)

    def _reset_pulses(self) -> None:
        self._last_pulse_s, self._same_pulses, self._same_m = math.nan, 0, math.nan
        self._phis: list[float] = []

    def _idle(self, phi: float) -> bool:
        # With a dead blower nothing packs, although the sensor still works.
        self._phis.append(phi)
        before = self._phis[-1 - self.parameters.idle_pulses :][0]
        return len(self._phis) > self.parameters.idle_pulses and phi - before < self.parameters.tolerance / 4

    def _stuck(self, at_m: float) -> bool:
        # A working sensor has noise, and pulses pack the bed: if readings stay identical over several, it is stuck.
        self._same_pulses = self._same_pulses + 1 if at_m == self._same_m else 0
        self._same_m = at_m
        return self._same_pulses >= self.parameters.stuck_pulses

    def _pulse_length_s(self, gap: float, gain_per_s: float) -> float:
        # A full pulse far from the target; near it, only as long as the last pulse's gain calls for, not to overshoot.
        p = self.parameters
        if not gain_per_s > 0:  # first pulse (NaN), or a gain lost in noise
            return p.pulse_on_s
        return min(p.pulse_on_s, max(p.pulse_min_s, gap / gain_per_s))


class PreparationFailed(InputError):
    """The bed could not be brought to the target; ``command`` is the last state."""

    def __init__(self, command: Command) -> None:
        super().__init__(f"bed: target_phi {command.target_phi:g}: {command.reason}")
        self.command = command

    def __reduce__(self) -> tuple[type["PreparationFailed"], tuple[Command]]:
        """Pickle by the command, not the message: an exception that can't be unpickled breaks the whole worker pool."""
        return type(self), (self.command,)


@dataclass(frozen=True)
class Span:
    """One stage of a preparation [s from its start]."""

    stage: Stage
    start_s: float
    end_s: float


@dataclass(frozen=True)
class Preparation:
    """How a bed was prepared: φ, σ_φ, pulses given, time taken, and the stages in order."""

    phi: float
    phi_sd: float
    pulses: int
    duration_s: float
    stages: tuple[Span, ...]


def prepare(
    params: ProtocolParameters,
    hardware: BedHardware,
    target_phi: float,
    advance: Callable[[float], None],
    dt_s: float,
    observe: Callable[[float, Command], None] | None = None,
) -> Preparation:
    """Run the protocol to its end, calling ``advance(dt_s)`` (simulated time or a sleep) between steps.

    ``observe(t_s, command)`` is called at every step, for a bag. The air is off afterwards in any case. Raises
    InputError if the target is out of reach or dt_s too coarse for the pulses, PreparationFailed (an InputError) if the
    bed fails.
    """
    params.check_step(dt_s)
    protocol = PulseProtocol(params)
    protocol.prepare(target_phi)
    spans: list[Span] = []
    n = 0
    try:
        while protocol.command.stage.busy:
            t_s, stage = n * dt_s, protocol.command.stage
            command = protocol.step(t_s, hardware.read_height_m())
            hardware.set_blower(command.blower)
            if observe is not None:
                observe(t_s, command)
            if command.stage is not stage:
                spans.append(Span(stage, spans[-1].end_s if spans else 0.0, t_s))
            if command.stage.busy:
                advance(dt_s)
                n += 1
    finally:
        hardware.set_blower(0.0)
    command = protocol.command
    if command.stage is not Stage.READY:
        raise PreparationFailed(command)
    return Preparation(command.phi, command.phi_sd, command.pulses, n * dt_s, tuple(spans))
