"""Standard errors where the deviance is not parabolic: rms distances of a posterior sample from the fit (``sample``).

A threshold has the same effect anywhere between two conditions, which makes the deviance a staircase. Its derivatives
give no standard error or a wrong one, also for the parameters that jump with it. A nearby bound cuts a parabola off.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.fitted import TOO_STEEP
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.profile import determined, profile, state_of_fit
from sandbot_model.fitting.sample import SEED, moments, posterior_points
from sandbot_model.fitting.scans import by_level, evaluated_at
from sandbot_model.fitting.states import States

LN_K_SHIFTS = np.concatenate([-(s := np.geomspace(1e-4, 0.2, 32))[::-1], [0.0], s])
"""Shifts of a level's ln k from the fit at which the deviance is evaluated."""
FAR = 2.0
"""Standard errors from the fit at which the rise of the deviance is compared with a parabola's."""
TOO_FLAT = 2.0
"""Factor by which the rise may fall short of a parabola's."""
POINTS = 48
"""Points of the sample that are kept for predictions: these give a standard deviation to 10 %."""


@lru_cache(maxsize=32)
def with_sampled_errors(fit: Fit, problem: Problem | None = None) -> Fit:
    """The same fit; where the deviance along a parameter is not parabolic, all errors are those of a posterior sample.

    ``problem`` may have more nuisances than the fit's own.
    """
    if fit.sample is not None:
        return fit
    problem, own = problem or fit.problem, determined(fit)
    begin = state_of_fit(problem, fit)
    along = [index for index in own if not _parabolic(problem, fit, begin, index)]
    if not along:
        return _with_k_errors_across_steps(problem, fit, begin)
    free = ~np.isnan(fit.stderr)
    free[: len(fit.point.theta)] = False
    free[own] = True
    stderr, covariance = fit.stderr.copy(), fit.covariance.copy()
    away = posterior_points(problem, begin, free, along)
    covariance[np.ix_(free, free)] = found = moments(away)
    # A sample covers the search range of what is known only together with others: that is no measurement.
    stderr[free] = np.where(np.isinf(stderr[free]), np.inf, np.sqrt(np.diag(found)))
    points = np.tile(np.concatenate([fit.point.theta, fit.point.ln_k]), (POINTS, 1))
    points[:, free] += np.random.default_rng(SEED).choice(away, POINTS, replace=False)
    return replace(fit, stderr=stderr, covariance=covariance, sample=points)


def _parabolic(problem: Problem, fit: Fit, begin: States, index: int) -> bool:
    """Whether ``FAR`` standard errors away, or as far as its bounds allow, the deviance rises as a parabola would."""
    here, error = fit.point.theta[index], fit.stderr[index]
    if not 0 < error < np.inf:
        return False
    values = np.clip(here + error * np.array([0.0, -FAR, FAR]), *fit.model.parameters[index].search)
    away = (values[1:] - here) / error
    if (np.abs(away) < 1.0).any():
        return False
    deviance = profile(problem, begin, [index], values[:, None]).deviance
    rise = (deviance[1:] - deviance[0]) / away**2
    return bool((rise > 1 / TOO_FLAT).all() and (rise < TOO_STEEP).all())


def _with_k_errors_across_steps(problem: Problem, fit: Fit, begin: States) -> Fit:
    """The same fit; the standard error of a level's k is at least half the distance within which the deviance, all else
    held, rises by less than four. At the edge of a step the derivative alone gives far too small an error.
    """
    shift, count = LN_K_SHIFTS[:, None], len(fit.point.theta)
    # All levels at once: given all else they are independent.
    deviance = by_level(problem, evaluated_at(problem, begin, begin.theta, begin.ln_k + shift, problem.bed(begin)))
    near = deviance < deviance.min(axis=0) + FAR**2
    alone, linear = np.where(near, np.abs(shift), 0.0).max(axis=0) / FAR, fit.stderr[count:]
    wider = np.concatenate([np.ones(count), np.where(alone > linear, alone / np.where(linear > 0, linear, 1.0), 1.0)])
    if (wider == 1.0).all():
        return fit
    return replace(fit, stderr=fit.stderr * wider, covariance=fit.covariance * np.outer(wider, wider))
