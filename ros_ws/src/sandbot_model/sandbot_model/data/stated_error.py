"""Error bars that come with the data, such as those of means read off a figure.

A row with a replicate number is one trial; its ``speed_sd_m_s`` is that of the measurement alone, which says nothing of
the scatter of replicates. A row without one stands for all trials of its condition, and its error bar is pure error:
an estimate from few trials, which is pooled with the others like the scatter of replicates.
"""

from dataclasses import replace

import numpy as np

from sandbot_common.arrays import Bools, Floats
from sandbot_model.data.pure_error import PureError, pooled_error
from sandbot_model.physics.observables import Observable

COLUMNS = ("replicate", "speed_sd_m_s", "speed_sem_m_s", "phi_sd", "n_trials")
"""Columns of the table that say what an error bar is."""
TRIALS_BEHIND = 3
"""An error bar counts as the scatter of this many trials where the table does not say how many there were."""


def stated_bars(columns: Floats, slope: Floats) -> Floats:
    """What error bars state ``(4, n)``, from the table's ``COLUMNS (5, n)`` and the ``slope`` ∂v/∂φ ``(n,)``.

    The variance of the speed of one trial [m²/s²], NaN if not stated; its degrees of freedom; the trials by whose
    number it is divided in the row's mean; and the variance of that mean due to φ [m²/s²]. Without ``n_trials``,
    ``speed_sd_m_s`` is taken for the error of the row as it stands.
    """
    replicate, sd, sem, phi_sd, trials = columns
    known, of_mean = np.isfinite(trials), (sem > 0) | (~(sd > 0) & (sem > 0).any())
    behind = np.where(known, np.maximum(trials, 1.0), np.where(of_mean, TRIALS_BEHIND, 1.0))
    dof = np.where(known, behind, TRIALS_BEHIND) - 1.0
    variance = np.where(sem > 0, sem**2 * behind, sd**2)
    stated = ~np.isfinite(replicate) & (dof > 0) & (variance > 0)
    of_phi = (slope * np.nan_to_num(phi_sd)) ** 2 / np.where(known, behind, 1.0)
    return np.stack([np.where(stated, variance, np.nan), dof, behind, of_phi])


def of_single_trials(columns: Floats) -> bool:
    """Whether any error bar is that of a single trial, and so does not give pure error; columns as above."""
    replicate, sd, sem, _, trials = columns
    return bool(((np.isfinite(replicate) | (trials <= 1)) & ((sd > 0) | (sem > 0))).any())


def with_stated(error: PureError, bars: Floats, walking: Bools, omega: Floats, usual: Floats) -> PureError:
    """Pure error of the rows as they stand from the cells' error ``bars (4, cells)`` of ``stated_bars``, unless speed
    was replicated. ``walking``, ``omega`` and ``usual`` are those of ``pure_error``.
    """
    variance, dof, behind, of_phi = bars
    stated, speed = np.isfinite(variance), Observable.speed
    if error.dof[speed] or not stated.any():
        return error
    freedom = np.where(stated, np.round(dof), 0).astype(np.int64)
    square = np.where(stated, freedom * variance, 0.0)
    pooled = pooled_error(square[:, None, None], freedom[:, None], walking, omega, usual[[speed]])
    of_means = pooled.covariance[:, 0, 0] / behind + of_phi
    covariance, sd, known = error.covariance.copy(), error.sd.copy(), error.dof.copy()
    # Error bars do not give the covariance of speed with other observables: where unknown, it is set to 0.
    for of_speed in (covariance[:, speed], covariance[..., speed]):
        of_speed[~np.isfinite(of_speed)] = 0.0
    covariance[:, speed, speed] = of_means
    sd[speed], known[speed] = np.sqrt(np.mean(of_means[stated])), pooled.dof[0]
    return replace(error, covariance=covariance, sd=sd, dof=known, own=error.own | pooled.own)
