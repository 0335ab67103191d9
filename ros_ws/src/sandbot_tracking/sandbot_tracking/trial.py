"""A trial's observables from landmarks and leg angles: mean speed, lift, peak speed, first step.

Definitions: docs/architecture.md. Phase is taken from the measured leg angles, as legs may turn slower than commanded.
A *step* ends at a *handover*, where both tripods are at the same angle from straight down, one after it and the other
before it. From one handover to the next the mean of all unwrapped angles grows by exactly π, whatever the gait.

Steady steps are folded onto one phase axis (fold.py), each between its own two rest positions, so that small
differences in length do not smear the curve. ``peak_speed_m_s`` is then the steepest slope and ``lift_m`` the highest
point of the folded curve.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sandbot_common.arrays import Floats
from sandbot_common.errors import InputError
from sandbot_common.robot import SANDBOT, Robot
from sandbot_tracking.fold import NotMeasured, check_enough
from sandbot_tracking.folded_peak import peak_height, peak_slope

SWIMMING_SLACK = 0.8
"""Smallest plausible ratio of peak to mean speed: 1 for a swimmer, less the error of the peak."""

STARTS_IN_STEP = np.pi / 4
"""Largest distance [rad] of the legs' start from the beginning of a step for a first step to be defined."""

OUT_OF_STEP = "the legs start {:.2f} rad from its begin"

NO_LIFT_M, FAR_ABOVE = 1e-4, 4.0
"""A body that rises less than NO_LIFT_M is not carried by its legs, and its peak is below FAR_ABOVE times the mean."""


@dataclass(frozen=True)
class TrialSummary:
    """The observables of one trial; NaN if not measurable, with the reason in ``reason``."""

    speed_m_s: float
    """Mean forward speed over whole steady periods."""
    speed_sd_m_s: float
    """Standard error of that mean, from the scatter of the periods."""
    lift_m: float
    """Rise of the axles above rest at the top of a step, median over steady steps."""
    peak_speed_m_s: float
    """Largest v_x(t) of the steady cycle."""
    first_step_m: float
    """Advance from the standing start to the end of the first step."""
    frames: int
    """Frames since the start."""
    gaps: int
    """Those of them in which a landmark is missing."""
    cycles: int
    """Whole steady periods used."""
    reason: str
    """Why something is NaN; empty if nothing is."""

    @classmethod
    def of_nothing(cls, frames: int, gaps: int, reason: str) -> "TrialSummary":
        """A trial of which nothing is measurable."""
        return cls(*(np.nan,) * 5, frames, gaps, 0, reason)

    def __str__(self) -> str:
        """One line, in cm/s and mm."""
        numbers = (
            f"speed {self.speed_m_s * 100:.2f} ± {self.speed_sd_m_s * 100:.2f} cm/s, "
            f"peak {self.peak_speed_m_s * 100:.2f} cm/s, lift {self.lift_m * 1000:.2f} mm, "
            f"first step {self.first_step_m * 1000:.2f} mm, {self.cycles} steady periods, {self.gaps} gaps"
        )
        return f"{numbers}; {self.reason}" if self.reason else numbers


@dataclass(frozen=True)
class _Steps:
    """The trial cut into steps: step i runs from edges[i] to edges[i + 1], its rest positions at x_m."""

    edges: Floats
    x_m: Floats


def summarise(
    t_s: ArrayLike,
    com_x_m: ArrayLike,
    front_z_m: ArrayLike,
    rear_z_m: ArrayLike,
    leg_t_s: ArrayLike,
    leg_angle: ArrayLike,
    *,
    start_s: float = 0.0,
    robot: Robot = SANDBOT,
) -> TrialSummary:
    """The observables of a trial whose clock started at ``start_s``.

    t_s, com_x_m, front_z_m, rear_z_m: (n,), metres in the trackway frame, NaN where a landmark is missing;
    leg_t_s (m,) and leg_angle (m, legs) [rad], wrapped or not, of the shafts. ``robot`` gives the angle to add to them
    (``leg_mount_rad``), and the axle height if it was not seen at rest.
    Raises InputError if shapes do not match or time does not increase.
    """
    t, x, front, rear = (np.asarray(values, dtype=float) for values in (t_s, com_x_m, front_z_m, rear_z_m))
    z = (front + rear) / 2
    _check(t, (x, front, rear))
    moving = t >= start_s
    frames, gaps = int(moving.sum()), int((moving & ~np.isfinite(x + z)).sum())
    if t.size < 2:
        return TrialSummary.of_nothing(frames, gaps, "no frames")
    try:
        edges, early = handovers(leg_t_s, np.asarray(leg_angle, dtype=float) + robot.leg_mount_rad, start_s)
    except NotMeasured as why:
        return TrialSummary.of_nothing(frames, gaps, str(why))

    reasons: list[str] = []
    first = _first_step(t, x, edges, early, reasons)
    speed, speed_sd, cycles = _mean_speed(t, x, edges, reasons)
    peak = lift = np.nan
    if cycles:
        steps = steady_steps(t, x, edges, cycles)
        rest = _rest_height(t, z, start_s, steps, robot.axle_height_m)
        try:
            lift = peak_height(t, z - rest, steps.edges)
        except NotMeasured as why:
            reasons.append(f"lift: {why}")
        try:
            peak = _plausible(peak_slope(t, x, steps.edges, steps.x_m), speed, lift)
        except NotMeasured as why:
            reasons.append(f"peak speed: {why}")
    return TrialSummary(speed, speed_sd, lift, peak, first, frames, gaps, cycles, "; ".join(reasons))


def never_measured(leg_t_s: ArrayLike, leg_angle: ArrayLike, frame_rate_hz: float) -> dict[str, str]:
    """The observables, as fields of ``TrialSummary``, for which a trial is too short at this frame rate, with
    the reasons.

    leg_t_s (m,) and leg_angle (m, legs) [rad] as planned, from the start to the stop. Raises InputError if their shapes
    do not match.
    """
    try:
        edges, early = handovers(leg_t_s, leg_angle, float(np.asarray(leg_t_s)[0]))
    except NotMeasured as why:
        return dict.fromkeys(("speed_m_s", "lift_m", "peak_speed_m_s", "first_step_m"), str(why))
    found = {"first_step_m": OUT_OF_STEP.format(abs(early))} if abs(early) > STARTS_IN_STEP else {}
    if edges.size < 5:
        return dict.fromkeys(("speed_m_s", "lift_m", "peak_speed_m_s"), "no whole steady period") | found
    # Cut within the steps (``steady_steps``), the whole periods have one step less.
    last = (edges.size - 1) // 2 * 2 - 1
    try:
        check_enough(int((edges[last] - edges[2]) * frame_rate_hz))
    except NotMeasured as why:
        found |= dict.fromkeys(("lift_m", "peak_speed_m_s"), str(why))
    return found


def _plausible(peak: float, speed: float, lift: float) -> float:
    """The peak speed. Raises NotMeasured if the folded curve missed the arc, or has a spurious one.

    The largest speed of a cycle is not below its mean, and legs that carry the body at far more than its mean speed
    also lift it.
    """
    if peak < SWIMMING_SLACK * speed:
        raise NotMeasured(f"an arc too short to resolve ({peak:.4f} m/s at a mean of {speed:.4f} m/s)")
    if lift < NO_LIFT_M and peak > FAR_ABOVE * speed:
        raise NotMeasured(f"{peak:.4f} m/s at a mean of {speed:.4f} m/s without any rise of the body")
    return peak


def _check(t: Floats, others: tuple[Floats, ...]) -> None:
    if t.ndim != 1 or any(values.shape != t.shape for values in others):
        raise InputError(f"landmarks of shapes {[v.shape for v in others]} with times {t.shape}: (n,) each are needed")
    if not np.isfinite(t).all() or (np.diff(t) <= 0).any():
        raise InputError("frame times must be finite and grow")


def handovers(leg_t_s: ArrayLike, leg_angle: ArrayLike, start_s: float) -> tuple[Floats, float]:
    """Times (n,) of the start and of the end of every step after it; and how far [rad] the start is before a handover.

    Raises NotMeasured.
    """
    t, angle = np.asarray(leg_t_s, dtype=float), np.asarray(leg_angle, dtype=float)
    if angle.ndim != 2 or len(angle) != t.size:
        raise InputError(f"leg angles of shape {angle.shape} with {t.size} times: (n, legs) is needed")
    keep = np.isfinite(t) & np.isfinite(angle).all(axis=1)
    t, angle = t[keep], angle[keep]
    if t.size < 2 or t[-1] <= start_s:
        raise NotMeasured("no leg angles after the start")
    turned = np.unwrap(angle, axis=0)
    start = np.array([np.interp(start_s, t, leg) for leg in turned.T])
    phase = (turned - start).mean(axis=1)
    # Encoder readings may jitter: the first passage of an angle counts.
    advance = np.maximum.accumulate(phase)
    early = _to_handover(start)
    ends = early + np.pi * np.arange(1, advance[-1] // np.pi + 2)
    ends = ends[ends <= advance[-1]]
    if not ends.size:
        raise NotMeasured("the legs turned less than a step")
    ahead = np.concatenate(([True], np.diff(advance) > 0)) & (t >= start_s)
    clock, times = np.append(0.0, advance[ahead]), np.append(start_s, t[ahead])
    return np.append(start_s, np.interp(ends, clock, times)), early


def _to_handover(angle: Floats) -> float:
    """How far [-π/2, π/2) the mean angle is before the nearest handover, where the first step begins; (legs,)."""
    tripods = np.angle(np.exp(1j * angle).reshape(2, -1).sum(axis=1))
    return float((-tripods.sum() + np.pi) % (2 * np.pi) - np.pi) / 2


def _first_step(t: Floats, x: Floats, edges: Floats, early: float, reasons: list[str]) -> float:
    if abs(early) > STARTS_IN_STEP:
        reasons.append(f"first step: {OUT_OF_STEP.format(abs(early))}; is leg_mount_rad right?")
        return np.nan
    before = np.isfinite(x) & (t <= edges[0] + 1e-9)
    start = float(np.mean(x[before][-20:])) if before.any() else position_at(t, x, edges[0], edges[1] - edges[0])
    advance = rest_position(t, x, edges[1], edges[1] - edges[0]) - start
    if not np.isfinite(advance):
        reasons.append("first step: no centre of mass at its start or end")
    return advance


def position_at(t: Floats, x: Floats, when: float, period: float) -> float:
    """x [m] at the time ``when`` [s] from frames ``t``, ``x (n,)``: a straight line through those within a tenth of a
    period (at least two); NaN in a gap."""
    return _line(t, x, when, when, 0.1 * period)[1]


def rest_position(t: Floats, x: Floats, when: float, period: float) -> float:
    """x [m] at the end of a step, at ``when`` [s]. As a leg may leave the ground less than a frame earlier, x is
    extrapolated from the flattest of the lines through the frames before, around and after the end.
    """
    reach = 0.07 * period
    lines = [_line(t, x, when + shift, when, reach) for shift in (-reach, 0.0, reach)]
    return min(lines, key=lambda line: abs(line[0]) if np.isfinite(line[0]) else np.inf)[1]


def _line(t: Floats, x: Floats, middle: float, when: float, reach: float) -> tuple[float, float]:
    """Slope and value at ``when`` of a line through the frames around ``middle``; NaN in a gap."""
    frame = float(np.median(np.diff(t)))
    near = np.isfinite(x) & (np.abs(t - middle) <= max(reach, 1.01 * frame))
    if near.sum() < 2 or middle < t[near][0] - 0.51 * frame or middle > t[near][-1] + 0.51 * frame:
        return np.nan, np.nan
    slope, value = np.polyfit(t[near] - when, x[near], 1)
    return float(slope), float(value)


def _mean_speed(t: Floats, x: Floats, edges: Floats, reasons: list[str]) -> tuple[float, float, int]:
    """Mean over whole periods after the first, its standard error, and the number of periods."""
    marks = edges[2::2]
    where = np.array([position_at(t, x, when, edges[1] - edges[0]) for when in marks])
    seen = np.flatnonzero(np.isfinite(where))
    if seen.size < 2:
        reasons.append("no whole steady period with the centre of mass in sight at both ends")
        return np.nan, np.nan, 0
    first, last = seen[0], seen[-1]
    cycles = int(last - first)
    speed = float((where[last] - where[first]) / (marks[last] - marks[first]))
    each = np.diff(where[seen]) / np.diff(marks[seen])
    sd = float(np.std(each, ddof=1) / np.sqrt(each.size)) if each.size > 1 else np.nan
    return speed, sd, cycles


def steady_steps(t: Floats, x: Floats, edges: Floats, cycles: int) -> _Steps:
    """The steady steps of frames ``t``, ``x (n,)``, cut at the phase at which the body moves least, so that rest
    positions are well defined; ``edges (steps + 1,)`` [s] are where all steps end."""
    steady = edges[2 : 2 + 2 * cycles + 1]
    shift = quiet_phase(t, x, steady)
    cuts = steady[:-1] + shift * np.diff(steady)
    if shift == 0.0:
        cuts = steady
    rest = np.array([position_at(t, x, when, cuts[1] - cuts[0]) for when in cuts])
    return _Steps(cuts, rest)


def quiet_phase(t: Floats, x: Floats, edges: Floats) -> float:
    """The phase of a step, [0, 1), at which |dx/dt| between frames ``t``, ``x (n,)`` is least, averaged over a fifth of
    the step."""
    seen = np.isfinite(x)
    middle, move = (t[seen][1:] + t[seen][:-1]) / 2, np.abs(np.diff(x[seen]) / np.diff(t[seen]))
    number = np.interp(middle, edges, np.arange(edges.size), left=np.nan, right=np.nan)
    inside = np.isfinite(number)
    phase, move = number[inside] % 1.0, move[inside]
    grid = np.arange(20) / 20
    away = np.abs((phase[None, :] - grid[:, None] + 0.5) % 1.0 - 0.5)
    near = away <= 0.1
    cost = np.where(near.any(axis=1), (near * move).sum(axis=1) / np.maximum(near.sum(axis=1), 1), np.inf)
    return float(grid[int(np.argmin(cost))])


def _rest_height(t: Floats, z: Floats, start_s: float, steps: _Steps, default: float) -> float:
    """Axle height at rest: before the start, and also between steps if that agrees to half a millimetre."""
    before = z[np.isfinite(z) & (t <= start_s + 1e-9)]
    span = float(np.median(np.diff(steps.edges)))
    between = z[np.isfinite(z) & (np.abs(t[:, None] - steps.edges).min(axis=1) <= 0.08 * span)]
    if not before.size:
        return float(np.median(between)) if between.size and abs(np.median(between) - default) < 5e-4 else default
    if between.size and abs(np.median(between) - np.median(before)) < 5e-4:
        return float(np.median(np.concatenate((before, between))))
    return float(np.median(before))
