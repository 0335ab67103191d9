"""A trial that is alone in its condition and went wrong: no replicate shows it, and no model explains it.

Where everything is explained but for such trials, the verdict is that without them, and says so.
"""

import numpy as np

from sandbot_model.data.conditions import Cells
from sandbot_model.discovery.criteria import Criteria
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.arrays import Ints

FAR_OFF = 6.0
"""Standard errors by which the best model misses a trial that is taken to have gone wrong."""


def suspect_trials(fit: Fit, criteria: Criteria) -> Ints:
    """Cells of one trial each that a fit misses by far; none where these are many, or all of their level.

    Beside a switch, where the robot walks or swims by chance, nothing is far off.
    """
    cells = fit.cells
    sd = np.sqrt(np.einsum("cii->ci", fit.state.covariance[0]))
    miss = np.abs(cells.mean - fit.predicted) / sd
    clear = fit.problem.away_from_switch(fit.problem.widening(fit.state.covariance[0]))
    alone = (cells.n.max(axis=1) == 1) & (np.bincount(cells.level)[cells.level] > 1)
    far = np.flatnonzero(alone & clear & (np.nan_to_num(miss).max(axis=1) > FAR_OFF))
    return far if len(far) <= criteria.lone_trials * len(cells) else far[:0]


def repeat_request(cells: Cells, which: Ints) -> str:
    """Which trials these are."""
    where = ", ".join(f"φ {cells.phi[one]:.3f}, ω {cells.omega[one]:.3g} rad/s" for one in which)
    if len(which) == 1:
        return f"without the trial at {where}, which is alone in its condition and far off: repeat it"
    return f"without the trials at {where}, each alone in its condition and far off: repeat them"
