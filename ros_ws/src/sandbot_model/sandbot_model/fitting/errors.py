"""Standard errors where the deviance is no parabola: rms distances of a sample from the fit (``sample``).

A threshold between two conditions acts alike wherever it is: the deviance is a staircase, a derivative along it knows
no error or a wrong one, and so it is with other parameters, which jump with it. A bound that is near cuts a parabola.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.profile import begun_at, determined, profile
from sandbot_model.fitting.sample import moments
from sandbot_model.fitting.scans import by_level, elsewhere
from sandbot_model.fitting.states import States

LN_K_AWAY = np.concatenate([-(s := np.geomspace(1e-4, 0.2, 32))[::-1], [0.0], s])
"""How far from the fit ln k of a level is looked at: all over what a fit can need."""
FAR = 2.0
"""Standard errors away from the fit at which the deviance is looked at."""
UNLIKE = 2.0
"""Factor by which its rise may fall short of a parabola's."""
CLIFF = 4.0
"""Factor by which it may exceed a parabola's."""


@lru_cache(maxsize=32)
def with_sampled_errors(fit: Fit, problem: Problem | None = None) -> Fit:
    """The same fit; where the deviance along a parameter is no parabola, all errors are those of a sample.

    ``problem`` may have more in it that trials share than the fit's own.
    """
    problem, own = problem or fit.problem, determined(fit)
    begin = begun_at(problem, fit)
    along = [index for index in own if not _parabolic(problem, fit, begin, index)]
    if not along:
        return _with_k_across_stairs(problem, fit, begin)
    free = np.isfinite(fit.stderr)
    free[: len(fit.point.theta)] = False
    free[own] = True
    stderr, covariance = fit.stderr.copy(), fit.covariance.copy()
    covariance[np.ix_(free, free)] = found = moments(problem, begin, free, along)
    stderr[free] = np.sqrt(np.diag(found))
    return replace(fit, stderr=stderr, covariance=covariance)


def _parabolic(problem: Problem, fit: Fit, begin: States, index: int) -> bool:
    """Whether two standard errors away along a parameter, or as far as it may go, the deviance has risen as they say.

    Where it rises far faster there is a cliff.
    """
    here, error = fit.point.theta[index], fit.stderr[index]
    if not error > 0:
        return False
    values = np.clip(here + error * np.array([0.0, -FAR, FAR]), *fit.model.parameters[index].search)
    away = (values[1:] - here) / error
    if (np.abs(away) < 1.0).any():
        return False
    deviance = profile(problem, begin, [index], values[:, None]).deviance
    rise = (deviance[1:] - deviance[0]) / away**2
    return bool((rise > 1 / UNLIKE).all() and (rise < CLIFF).all())


def _with_k_across_stairs(problem: Problem, fit: Fit, begin: States) -> Fit:
    """The same fit; a level's k is known no better than its deviance says with all else as it is: at twice its standard
    error that has risen by four. At the brink of a stair a derivative says far more.
    """
    away, count = LN_K_AWAY[:, None], len(fit.point.theta)
    # All levels at once: given all else they are independent.
    deviance = by_level(problem, elsewhere(problem, begin, begin.theta, begin.ln_k + away, problem.bed(begin)))
    near = deviance < deviance.min(axis=0) + FAR**2
    alone, told = np.where(near, np.abs(away), 0.0).max(axis=0) / FAR, fit.stderr[count:]
    wider = np.concatenate([np.ones(count), np.where(alone > told, alone / np.where(told > 0, told, 1.0), 1.0)])
    if (wider == 1.0).all():
        return fit
    return replace(fit, stderr=fit.stderr * wider, covariance=fit.covariance * np.outer(wider, wider))
