"""Whether the robot that walked can be that of robot.yaml, judged by kinematic limits that hold on any ground.

A leg of radius R at rate θ̇ moves its axle at Rθ̇ at most, carries it 2R at most in a step and lifts it 2R - h at most.
In the absence of effects, lift and speed together give one estimate of R and the peak speed gives another: if the two
agree on a value other than robot.yaml's, robot.yaml is doubted. Nothing is fitted; effects that shorten a step (slip,
overlap, drag) make the estimates disagree or leave one of them unchanged. A forward push (a slope steeper than the
catalogue's) may carry the robot further and faster than its legs do, by one common factor: where peak, step and lift
agree with such a factor, robot.yaml is not doubted.

Replicates that scatter far beyond the accuracy, but not within the two groups of a split, are two robots' or set-ups'.
"""

from collections.abc import Iterator

import numpy as np

from sandbot_common.arrays import Bools, Floats
from sandbot_model.data.conditions import Cells
from sandbot_model.data.regime import SURE_LIFT_M, walks
from sandbot_model.data.two_groups import AGREEING, far_apart
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.gait import fastest_phase_ratio
from sandbot_model.physics.geometry import deepest_m
from sandbot_model.physics.observables import CM, Observable, usual_noise

TOO_FAR = 1.25
"""Ratio to a kinematic limit beyond which robot.yaml is doubted: 2° downhill, the catalogue's most, gains 18 %."""
FEWEST = 3
"""Walking cells needed for a median to mean anything."""
MIXED_REGIMES = 0.25
"""Relative scatter of the lift beyond which some replicates may have swum."""
POPPY_SEEDS = ((0.580, 0.622), (300e3, 480e3))
"""φ and α = k/(wR) [N/m³] that a plate meets there (Li09)."""
FAR_FROM_POPPY = 2.5
PUSH_TOLERANCE = 0.03
"""Relative error of R from steps corrected for a push up to which the push is believed."""
DIFFERENT, EQUAL = 0.12, 0.04
"""Relative difference above which two radii count as different, and below which they count as equal."""

SPLIT_OFF = 0.9
"""Fraction of replicates' variance that a split removes if they are of two robots; of a steady drift it is 3/4."""


def in_doubt(cells: Cells) -> str:
    """Why nothing may be identified from these trials, in words; empty where nothing is in doubt."""
    if mixed := _two_set_ups(cells):
        return f"the table may mix two robots or set-ups, so nothing is identified: {mixed}"
    if doubted := doubts(cells):
        return robot_may_be_wrong(*doubted)
    return ""


def robot_may_be_wrong(*why: str) -> str:
    """The reason of a verdict that names nothing because of robot.yaml."""
    return f"robot.yaml may be wrong, so nothing is identified: {'; '.join(why)}"


def doubts(cells: Cells) -> tuple[str, ...]:
    """Reasons to doubt robot.yaml, one clause each; empty where it is plausible."""
    return (*_beyond_limits(cells), *_another_radius(cells))


def effects_may_explain(cells: Cells) -> bool:
    """Whether effects may explain all that puts robot.yaml in doubt: none makes legs reach beyond their limits, but two
    together may imitate another radius."""
    return bool([*_another_radius(cells)]) and not any(_beyond_limits(cells)) and not _two_set_ups(cells)


def implausible_k(fit: Fit) -> str:
    """A remark on robot.yaml where k is far from that of poppy seeds at the same φ; empty where it is not.

    It does not affect the verdict: k is proportional to the mass assumed (kd = mg), and grains differ.
    """
    robot = fit.cells.robot
    alpha = fit.k_n_per_m / (robot.leg_width_m * robot.leg_radius_m)
    usual = _median(alpha / np.interp(fit.level_phi, *POPPY_SEEDS)) if len(alpha) >= FEWEST else 1.0
    if 1 / FAR_FROM_POPPY < usual < FAR_FROM_POPPY:
        return ""
    return (
        f"k is {usual:.2g} times what a leg of this size meets in poppy seeds of this φ: "
        "are mass_per_leg_kg (a third of the robot's), leg_radius_m and leg_width_m right?"
    )


def _two_set_ups(cells: Cells) -> str:
    """The two groups into which replicates fall, and their scatter; empty where they don't."""
    if (groups := cells.two_groups) is None:
        return ""
    questioned = far_apart(cells.noise, usual_noise(cells.accuracy))
    split_off = questioned & (groups.sd**2 < (1 - SPLIT_OFF) * cells.noise**2)
    if split_off.sum() < AGREEING:
        return ""
    scatter = ", ".join(
        f"{o.label} by {CM * cells.noise[o]:.2g} {o.readers_unit} and {CM * groups.sd[o]:.2g} within the groups"
        for o in Observable
        if split_off[o]
    )
    return f"replicates form two groups, up to {groups.last} and from {groups.first} on; they scatter in {scatter}"


def _beyond_limits(cells: Cells) -> Iterator[str]:
    robot, mean = cells.robot, _of_walkers(cells)
    top = robot.leg_radius_m * cells.omega * np.array([fastest_phase_ratio(gait) for gait in cells.gait])
    step = np.pi * mean[:, Observable.speed] / cells.omega
    pushed = _pushed(cells, mean, step)
    for with_a_push, what, ratio in (
        (
            True,
            "peak speeds are {:.2f} times what legs of R = {R:.3g} cm reach at these rates",
            mean[:, Observable.peak_speed] / top,
        ),
        (True, "steps are {:.2f} times the 2R that legs of R = {R:.3g} cm can span", step / (2 * robot.leg_radius_m)),
        (
            True,
            "first steps are {:.2f} times the 2R that legs of R = {R:.3g} cm can span",
            mean[:, Observable.first_step] / (2 * robot.leg_radius_m),
        ),
        (False, "the body rises {:.2f} times as high as 2R - h allows", mean[:, Observable.lift] / deepest_m(robot)),
    ):
        if (usual := _median(ratio)) > TOO_FAR and not (with_a_push and pushed):
            yield what.format(usual, R=CM * robot.leg_radius_m)


def _another_radius(cells: Cells) -> Iterator[str]:
    robot, mean = cells.robot, _of_walkers(cells)
    step = np.pi * mean[:, Observable.speed] / cells.omega
    by_peak, by_lift = (_median(radius) for radius in (_radius_by_peak(cells, mean), _radius_by_lift(mean, step)))
    difference = abs(by_peak - by_lift) / robot.leg_radius_m
    if difference < EQUAL and min(abs(radius / robot.leg_radius_m - 1) for radius in (by_peak, by_lift)) > DIFFERENT:
        yield (
            f"lift with speed and peak speed agree on a leg radius of {CM * by_lift:.2f} and {CM * by_peak:.2f} cm, "
            f"not on {CM * robot.leg_radius_m:.3g} cm"
        )


def _of_walkers(cells: Cells) -> Floats:
    """The cell means ``(n, 4)`` [SI], NaN where not every trial walked."""
    return np.where(_all_walk(cells)[:, None], cells.mean, np.nan)


def _all_walk(cells: Cells) -> Bools:
    """Cells ``(n,)`` in which every trial walked: if some swam, peak and lift are averaged over both regimes alike and
    would agree on a smaller radius.
    """
    sure = walks(cells.mean, SURE_LIFT_M)
    return np.asarray(sure & ~(cells.sd[:, Observable.lift] > MIXED_REGIMES * cells.mean[:, Observable.lift]))


def _pushed(cells: Cells, mean: Floats, step: Floats) -> bool:
    """Whether peaks and steps exceed what legs do by one factor: corrected for it, lift gives robot.yaml's R."""
    radius = cells.robot.leg_radius_m
    push = _radius_by_peak(cells, mean) / radius
    with np.errstate(divide="ignore", invalid="ignore"):  # a peak of 0, for one that was not measured, gives no R
        by_lift = _radius_by_lift(mean, step / push)
    return abs(_median(by_lift) / radius - 1) < PUSH_TOLERANCE


def _radius_by_peak(cells: Cells, mean: Floats) -> Floats:
    """R = v_peak/(βω): all legs on the ground turn at the slow phase's rate. NaN for gaits with two rates."""
    even = cells.clock.slow_ratio == 1.0
    return np.where(even, mean[:, Observable.peak_speed] / cells.omega, np.nan)


def _radius_by_lift(mean: Floats, step: Floats) -> Floats:
    """R from s = 2√(Δz(2R - Δz))."""
    lift = mean[:, Observable.lift]
    return lift / 2 + step**2 / (8 * lift)


def _median(values: Floats) -> float:
    """NaN, which passes no threshold, where fewer than ``FEWEST`` values are finite."""
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) >= FEWEST else float("nan")
