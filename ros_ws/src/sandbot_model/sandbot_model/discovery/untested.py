"""Whether pure error is known well enough to test a model at all, decided before any search."""

import numpy as np

from sandbot_model.data.conditions import Cells
from sandbot_model.data.distributions import chi2_ppf
from sandbot_model.discovery.criteria import Criteria
from sandbot_model.discovery.next_trials import NextTrial, known_gait
from sandbot_model.discovery.verdict import Verdict
from sandbot_model.fitting.text import counted

CONDITIONS, MORE = 6, 2
"""Conditions to repeat, and replicates to add at each: pure error then has twelve degrees of freedom."""


def untested(cells: Cells, criteria: Criteria) -> Verdict | None:
    """The verdict ``untested`` if a gross lack of fit would pass the test; None if the data can refuse a model."""
    known = int(cells.pure_error_dof.max())
    if known and (passing := undetected_miss(known, criteria)) <= criteria.gross:
        return None
    what = (
        f"{'replicates' if (cells.n > 1).any() else 'error bars'} give {counted(known, 'degree')} of freedom of pure "
        f"error, on which a model that misses every cell mean by {passing:.0f} standard errors would pass"
        if known
        else f"{_no_replicates(cells)}, so pure error is unknown and nothing can be tested"
    )
    where = counted(min(CONDITIONS, len(cells)), "condition")
    more = f"{MORE} more trials at each of {where} would do (next trials)"
    return Verdict("untested", (), (), f"{what}; {more}")


def _no_replicates(cells: Cells) -> str:
    if (cells.n > 1).any():
        return "replicates agree to the last digit, as copies do or a computation without noise"
    return f"no cell has replicates and {_no_error_bars(cells)}"


def _no_error_bars(cells: Cells) -> str:
    """Why error bars do not give pure error either."""
    if not cells.bars_of_trials:
        return "no error bars are given"
    return (
        "the error bars (speed_sd_m_s) are those of measuring a single trial, for their rows have a replicate number "
        "(a row that is the mean of a condition has none)"
    )


def undetected_miss(known: int, criteria: Criteria) -> float:
    """Miss of every cell mean, in standard errors, that just passes with ``known`` degrees of freedom of pure error.

    The lack-of-fit F test with many cells: F(p; ∞, ν) = ν/χ²(p; ν).
    """
    return float(np.sqrt(known / chi2_ppf(criteria.lack_of_fit, known)))


def repeats(cells: Cells) -> list[NextTrial]:
    """Conditions to repeat, spread as widely as possible over φ and ω."""
    at = np.stack([cells.phi, cells.omega], axis=-1)
    width = np.ptp(at, axis=0)
    places = (at - at.min(axis=0)) / np.where(width > 0, width, 1.0)
    chosen = [int(np.argmin(places.sum(axis=1)))]
    while len(chosen) < min(CONDITIONS, len(cells)):
        distance = np.linalg.norm(places[:, None] - places[chosen], axis=-1).min(axis=1)
        distance[chosen] = -1.0
        chosen.append(int(np.argmax(distance)))
    return [
        NextTrial(
            phi=float(cells.level_phi[cells.level[cell]]),
            omega_rad_s=float(cells.omega[cell]),
            observable="speed",
            separates=("scatter of replicates", "a miss of the model"),
            expected_gap_sd=float("nan"),
            replicates=MORE,
            gait=known_gait(cells.gait[cell]),
        )
        for cell in sorted(chosen)
    ]
