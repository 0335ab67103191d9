"""Outliers without replicates: a trial that went wrong and is the only one of its condition, so no model fits it.

If a model explains all other trials, the verdict is on those, and says so.
"""

import numpy as np

from sandbot_common.arrays import Ints
from sandbot_model.data.conditions import Cells
from sandbot_model.discovery.criteria import Criteria
from sandbot_model.fitting.fit import Fit

FAR_OFF = 6.0
"""Standard errors by which the best model misses a trial that is considered an outlier."""


def suspect_trials(fit: Fit, criteria: Criteria) -> Ints:
    """Cells of one trial each that a fit misses by far; none if these are too many.

    Cells that are alone in their level, or beside a switch, where the robot walks or swims by chance, do not count.
    """
    cells = fit.cells
    sd = np.sqrt(np.einsum("cii->ci", fit.state.covariance[0]))
    miss = np.abs(cells.mean - fit.predicted) / sd
    clear = fit.problem.away_from_switch(fit.problem.widening(fit.state.covariance[0]))
    alone = (cells.n.max(axis=1) == 1) & (np.bincount(cells.level)[cells.level] > 1)
    far = np.flatnonzero(alone & clear & (np.nan_to_num(miss).max(axis=1) > FAR_OFF))
    return far if len(far) <= criteria.lone_trials * len(cells) else far[:0]


def repeat_request(cells: Cells, which: Ints) -> str:
    """Which trials were left out and should be repeated, in words."""
    where = ", ".join(f"φ {cells.phi[cell]:.3f}, ω {cells.omega[cell]:.3g} rad/s" for cell in which)
    if len(which) == 1:
        return f"without the trial at {where}, which is alone in its condition and far off: repeat it"
    return f"without the trials at {where}, each alone in its condition and far off: repeat them"
