"""Time series of two trials: leg angles with the clock signal (Li09 Fig. 1c), forward speed (Fig. 1d)."""

from typing import TYPE_CHECKING, Any

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_common.errors import InputError
from sandbot_model.physics.observables import CM
from sandbot_model.report import text
from sandbot_model.report.atlas.material import Material, Motion
from sandbot_model.report.atlas.style import ABOVE, FAINT, key, sheet

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = ("#b3261e", "#1f5fa8")
"""Red and blue as in the paper: closely and loosely packed."""
LINES: tuple[dict[str, Any], ...] = ({"linewidth": 2.6, "alpha": 0.5}, {})
"""The first broad and pale, the second thin: told apart also in grey, and where one covers the other."""
PERIODS = 4
TURN = 2 * np.pi


def angles(material: Material, width_mm: float) -> "tuple[Figure, str]":
    """Fig. 1c: shaft angle of a leg within a turn, and the clock signal. Raises InputError without bags."""
    motions = _two_motions(material)
    figure, (panel,) = sheet(width_mm, 0.6 * width_mm)
    end = _end(motions)
    for motion, colour, line in zip(motions, COLOURS, LINES, strict=True):
        shown = (motion.leg_time_s >= 0) & (motion.leg_time_s <= end)
        _turns(
            panel,
            motion.leg_time_s[shown],
            motion.leg_angle_rad[shown],
            color=colour,
            label=f"φ {motion.phi:.3f}",
            **line,
        )
    first = motions[0]
    clock_note = ""
    if first.clock_signal is not None:
        t = np.linspace(0, end, 2000)
        _turns(panel, t, clock_angle(first, t), color=FAINT, linewidth=0.8, linestyle=(0, (2, 1.5)), label="clock")
        clock_note = " Dashed: the clock signal."
    panel.set_xlabel("time (s)")
    panel.set_ylabel("leg angle θ (rad)")
    panel.set_ylim(-np.pi, np.pi)
    panel.set_yticks([-np.pi, 0, np.pi], ["−π", "0", "π"])
    panel.set_xlim(0, end)
    key(panel, "", columns=3, **ABOVE)
    difference = _median_difference(motions, end)
    return figure, (
        f"Shaft angle of one leg in {_named(motions)} at {first.omega_rad_s:g} rad/s: the two differ by "
        f"{difference:.3f} rad in the median, so the legs turn alike on both grounds.{clock_note}"
    )


def speeds(material: Material, width_mm: float) -> "tuple[Figure, str]":
    """Fig. 1d: v_x(t) of the same two trials. Raises InputError without bags."""
    motions = _two_motions(material)
    figure, (panel,) = sheet(width_mm, 0.6 * width_mm)
    end, summaries = _end(motions), []
    for motion, colour, line in zip(motions, COLOURS, LINES, strict=True):
        shown = (motion.time_s >= 0) & (motion.time_s <= end)
        speed = CM * motion.speed_m_s[shown]
        panel.plot(motion.time_s[shown], speed, color=colour, label=f"φ {motion.phi:.3f}", **line)
        settled = CM * motion.speed_m_s[shown & (motion.time_s > end / PERIODS)]
        mean, low, high = map(text.number, (np.nanmean(settled), *np.nanpercentile(settled, [5, 95])))
        summaries.append(f"{mean} cm/s (90 % of the time {low} to {high}) at φ {motion.phi:.3f}")
    panel.axhline(0, color=FAINT, linewidth=0.5)
    panel.set_xlabel("time (s)")
    panel.set_ylabel("forward speed v$_x$ (cm/s)")
    panel.set_xlim(0, end)
    key(panel, "", columns=2, **ABOVE)
    return figure, f"Forward speed of the same two trials, with the legs turning alike: {' and '.join(summaries)}."


def clock_angle(motion: Motion, t_s: Floats) -> Floats:
    """Leg angle commanded by the clock, (n,) [rad], starting from the leg's angle at t = 0."""
    assert motion.clock_signal is not None
    theta_s, theta_0, duty = motion.clock_signal
    knots = np.array([0.0, duty, 1.0])
    values = theta_0 - theta_s / 2 + np.array([0.0, theta_s, TURN])
    start = float(np.interp(0.0, motion.leg_time_s, motion.leg_angle_rad))
    begun = np.interp((start - values[0]) % TURN + values[0], values, knots)
    phase = begun + t_s * motion.omega_rad_s / TURN
    return np.asarray(np.interp(phase % 1.0, knots, values) + TURN * np.floor(phase))


def _turns(panel: "object", t_s: Floats, angle_rad: Floats, **looks: object) -> None:
    """A line of the angle wrapped to (-π, π), broken at each wrap."""
    wrapped = (angle_rad + np.pi) % TURN - np.pi
    broken = np.flatnonzero(np.abs(np.diff(wrapped)) > np.pi) + 1
    panel.plot(np.insert(t_s, broken, np.nan), np.insert(wrapped, broken, np.nan), **looks)  # type: ignore[attr-defined]


def _median_difference(motions: tuple[Motion, ...], end: float) -> float:
    t = np.linspace(0, end, 500)
    first, second = (np.interp(t, motion.leg_time_s, motion.leg_angle_rad) for motion in motions)
    difference = (first - second + np.pi) % TURN - np.pi
    return float(np.median(np.abs(difference)))


def _two_motions(material: Material) -> tuple[Motion, ...]:
    if len(material.motions) < 2:
        raise InputError("two trials with bags at one leg frequency are needed")
    return material.motions[:2]


def _end(motions: tuple[Motion, ...]) -> float:
    longest = min(float(motion.time_s[-1]) for motion in motions)
    return min(longest, PERIODS * TURN / motions[0].omega_rad_s)


def _named(motions: tuple[Motion, ...]) -> str:
    return " and ".join(motion.trial_id for motion in motions)
