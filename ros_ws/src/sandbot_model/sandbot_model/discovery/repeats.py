"""Conditions to run again: those that a verdict asks for, and one that even a model that explains all others misses."""

import numpy as np

from sandbot_common.arrays import Ints
from sandbot_model.data.conditions import Cells, level_name
from sandbot_model.data.distributions import t_sf
from sandbot_model.discovery.candidates import nearly_claimed
from sandbot_model.discovery.criteria import Criteria
from sandbot_model.discovery.next_trials import NextTrial, known_gait, replicates_for
from sandbot_model.discovery.untested import repeat_of
from sandbot_model.discovery.verdict import (
    EXPLAINS_ALL,
    USUAL_LEVEL,
    Sets,
    Verdict,
    decided_by,
    why_not_claimed,
    would_suffice,
)
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.goodness import Fail
from sandbot_model.physics.observables import NAMES, Observable, usual_noise

SLIP_OR_MISS = ("a failed trial", "missing physics")
"""What repeating a condition that is far off separates."""


def decisive(fits: Sets, verdict: Verdict, criteria: Criteria) -> list[NextTrial]:
    """The condition in which most of the gain lies for which a set is nearly named, with as many replicates as would
    show it; none if something else is lacking."""
    near = {"adequate": nearly_claimed, "unexplained": would_suffice}.get(verdict.status)
    fit = near(fits, criteria) if near else None
    found = decided_by(fits, fit, criteria) if fit else None
    if fit is None or found is None:
        return []
    if verdict.status == "unexplained" and why_not_claimed(fits, fit, criteria) not in verdict.because:
        return []  # it is refused for another reason
    part, cell = found
    return [_between(fits[part], fit, cell)]


def odd_one_out(verdict: Verdict, named: Fit) -> Fail | None:
    """The cell mean that a model which explains the data misses most, if chance would hardly leave that; or None.

    The test of lack of fit takes all cell means together, and may pass if one of many is far off. Where a cell has an
    error of its own, from a few trials, a miss says little.
    """
    worst = next((fail for fail in named.fails if not named.cells.own_scatter[fail.cell]), None)
    if worst is None or verdict.status not in ("adequate", *EXPLAINS_ALL) or _by_chance(worst, named) > USUAL_LEVEL:
        return None
    return worst


def in_words(odd: Fail | None, named: Fit) -> str:
    """That a condition should be run again, and why; empty where there is none."""
    if odd is None:
        return ""
    where = f"{odd.observable} at φ {level_name(named.cells, odd.cell)}, ω {odd.omega_rad_s:.3g} rad/s"
    return (
        f"{where} is missed by {abs(odd.z):.1f} standard errors, by chance in {_by_chance(odd, named):.1g} of such "
        "tables: run that again"
    )


def again(odd: Fail | None, named: Fit) -> list[NextTrial]:
    """The trials of that condition; none where there is none."""
    return [repeat_of(named.cells, odd.cell, SLIP_OR_MISS, odd.observable)] if odd else []


def _by_chance(worst: Fail, fit: Fit) -> float:
    """Probability that some cell mean is missed by as many standard errors (t test; Bonferroni)."""
    values, dof = int(np.isfinite(fit.residual_z).sum()), int(fit.cells.pure_error_dof[Observable[worst.observable]])
    return min(1.0, 2 * values * t_sf(abs(worst.z), dof)) if dof else 1.0


def alone(cells: Cells, which: Ints) -> list[NextTrial]:
    """Trials that were alone in their condition and far off."""
    return [repeat_of(cells, int(cell), SLIP_OR_MISS) for cell in which]


def _between(smaller: Fit, larger: Fit, cell: int) -> NextTrial:
    """The trial in a condition in whose prediction two fits differ most, of what is measured there."""
    cells = larger.cells
    noise = np.where(np.isfinite(cells.noise), cells.noise, usual_noise(cells.accuracy))
    gap = np.abs(larger.predicted[cell] - smaller.predicted[cell]) / noise
    best = int(np.argmax(np.where(np.isfinite(cells.mean[cell]), gap, 0.0)))
    names = tuple(" + ".join(fit.effects) or "base" for fit in (smaller, larger))
    return NextTrial(
        phi=float(cells.level_phi[cells.level[cell]]),
        omega_rad_s=round(float(cells.omega[cell]), 3),
        observable=NAMES[best],
        separates=(names[0], names[1]),
        expected_gap_sd=float(gap[best]),
        replicates=min(replicates_for(float(gap[best]) ** 2), cells.trials),
        gait=known_gait(cells.gait[cell]),
    )
