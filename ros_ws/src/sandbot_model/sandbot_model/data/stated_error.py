"""Error bars that come with the data, such as those of means read off a figure.

A row with a replicate number is one trial; its ``speed_sd_m_s`` is that of the measurement alone, which says nothing of
the scatter of replicates. A row without one stands for all trials of its condition, and its error bar is pure error.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sandbot_model.data.pure_error import FLOOR, PureError
from sandbot_model.physics.observables import Observable

Floats = NDArray[np.float64]

TRIALS_BEHIND = 3
"""An error bar counts as the scatter of this many trials: no figure states how well its error bars are known."""


def stated_variance(stated_columns: Floats, slope: Floats) -> Floats:
    """Variance of the speed ``(n,)`` [m²/s²] from the error bars of v and φ, with ``slope`` ∂v/∂φ; NaN if not stated.

    ``stated_columns (3, n)`` are the table's replicate, speed_sd_m_s and phi_sd.
    """
    replicate, speed_sd, phi_sd = stated_columns
    stated = ~np.isfinite(replicate) & (speed_sd > 0)
    return np.where(stated, speed_sd**2 + (slope * np.nan_to_num(phi_sd)) ** 2, np.nan)


def of_single_trials(stated_columns: Floats) -> bool:
    """Whether any error bar is that of a single trial, and so does not give pure error; columns as above."""
    replicate, speed_sd, _ = stated_columns
    return bool((np.isfinite(replicate) & (speed_sd > 0)).any())


def with_stated(error: PureError, variance: Floats) -> PureError:
    """Pure error from the cells' error bars of ``variance (cells,)``, unless speed was replicated."""
    stated = np.isfinite(variance)
    if error.dof[Observable.speed] or not stated.any():
        return error
    common = float(np.mean(variance[stated]))
    covariance, sd, dof = error.covariance.copy(), error.sd.copy(), error.dof.copy()
    # Error bars do not give the covariance of speed with other observables: where unknown, it is set to 0.
    for of_speed in (covariance[:, Observable.speed], covariance[..., Observable.speed]):
        of_speed[~np.isfinite(of_speed)] = 0.0
    covariance[:, Observable.speed, Observable.speed] = np.maximum(np.where(stated, variance, common), FLOOR**2)
    sd[Observable.speed] = np.sqrt(common)
    dof[Observable.speed] = (TRIALS_BEHIND - 1) * stated.sum()
    return replace(error, covariance=covariance, sd=sd, dof=dof)
