"""Confidence limits at 95 % on effects that are absent, such as ``stance_overlap.eta < 0.02``.

They come from the profile likelihood, with the nuisances of the named set. An effect that can only reduce something
(η, σ) has an upper limit, where the deviance has risen by 2.71; an effect of either sign (b, χ) has an interval, where
it has risen by 3.84.
"""

import math
from dataclasses import dataclass

import numpy as np

from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.jacobian import full_jacobian, project_out, spanned
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.states import States
from sandbot_model.fitting.text import to_error
from sandbot_model.physics.arrays import Array
from sandbot_model.physics.effect import Parameter

ONE_SIDED, TWO_SIDED = 2.706, 3.841
"""χ² of one degree of freedom at 90 and 95 %."""
PROFILED_AT = (-4.0, -2.5, -1.5, 0.0, 1.5, 2.5, 4.0)
"""Values at which the profile is computed, in standard errors from the linearised estimate."""
NEAREST = 0.5
"""Linearised standard errors within which no limit is credible: the deviance is a staircase there, not a parabola."""


@dataclass(frozen=True)
class Limit:
    """Limits at 95 % on a parameter of an absent effect; None on a side where they exclude no plausible value."""

    effect: str
    parameter: str
    unit: str
    low: float | None
    high: float | None
    neutral: float = 0.0
    """Value at which the effect vanishes."""

    def __str__(self) -> str:
        low, high = self.ends
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"{low and f'{low} < '}{self.effect}.{self.parameter}{high and f' < {high}'}{unit}"

    @property
    def ends(self) -> tuple[str, str]:
        """Both limits as text, empty for none: to a tenth of the interval, since both may lie near the neutral value;
        one alone to two digits of its distance from there.
        """
        if self.low is not None and self.high is not None:
            error = 0.1 * (self.high - self.low)
            return to_error(self.low, error), to_error(self.high, error)
        low, high = ("" if end is None else _to_two_digits(end, self.neutral) for end in (self.low, self.high))
        return low, high


def _to_two_digits(value: float, neutral: float) -> str:
    distance = max(abs(value - neutral), 1e-9)
    return f"{round(value, 1 - math.floor(math.log10(distance))):.12g}"


def limits(search: EffectSearch, named: Fit) -> list[Limit]:
    """Limits on each effect that is not named, vanishes at a neutral value of one parameter, and shows in the data."""
    found = [_limit(search, named, name, strength) for name, strength in search.strengths(named.effects)]
    return [limit for limit in found if limit is not None]


def _limit(search: EffectSearch, named: Fit, name: str, parameter: Parameter) -> Limit | None:
    model = search.model(search.extended(named.effects, [name])[0])
    problem, index = Problem(model, named.cells, named.nuisances), model.names.index(f"{name}.{parameter.name}")
    neutral, (low, high) = float(parameter.neutral or 0.0), parameter.search
    values = {f"{name}.{other.name}": other.start for other in search.effects[name].parameters}
    values |= {key: estimate.value for key, estimate in named.parameters.items()}
    theta = np.array([[values.get(key, 0.0) for key in model.names]])
    theta[0, index] = neutral
    start = problem.states(theta, named.state.ln_k, named.state.slope)
    jacobian = full_jacobian(problem, start)[0]
    estimate, error = _linear_estimate(jacobian, start.all_residuals[0], index)
    estimate += neutral
    if not error < high - low:
        return None
    points = np.unique(np.clip([neutral, *(estimate + error * np.array(PROFILED_AT))], low, high))
    deviance = _profile(problem, start, jacobian, index, points)
    one_sided = parameter.hard_low == neutral
    rise = ONE_SIDED if one_sided else TWO_SIDED
    below = None if one_sided else _crossing(-points[::-1], deviance[::-1], rise)
    above = _crossing(points, deviance, rise)
    ends = [end for end in (below and -below, above) if end is not None]
    if not ends or max(abs(end - max(estimate, low)) for end in ends) < NEAREST * error:
        return None
    lower = None if below is None or -below < parameter.low else -below
    upper = None if above is None or above > parameter.high else above
    return None if lower is upper is None else Limit(name, parameter.name, parameter.unit, lower, upper, neutral)


def _linear_estimate(jacobian: Array, residual: Array, index: int) -> tuple[float, float]:
    """Linearised estimate of a parameter, relative to its present value, and its standard error; all others free."""
    covariance = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-12, hermitian=True)
    return float((covariance @ (jacobian.T @ residual))[index]), float(np.sqrt(covariance[index, index])) or np.inf


def _profile(problem: Problem, start: States, jacobian: Array, index: int, values: Array) -> Array:
    """Profile deviance ``(rows,)`` at values of one parameter, minimised over all others to first order.

    Cells near a switch keep the weight they have at the start: the deviance of a mixture is rugged, not a parabola.
    """
    theta = np.repeat(start.theta, len(values), axis=0)
    theta[:, index] = values
    rows = np.zeros(len(values), dtype=np.int64)
    moved = problem.states(theta, start.ln_k[rows], start.slope[rows], -start.shared[rows] * _prior_sd(problem))
    shift = np.where(problem.measured, moved.predicted - start.predicted, 0.0)
    residual = np.repeat(start.all_residuals, len(values), axis=0)
    cells, readings = shift[0].size, moved.pressed.shape[1]
    residual[:, :cells] -= np.einsum("cij,rcj->rci", start.whiten[0], shift).reshape(len(values), -1)
    residual[:, cells : cells + readings] = moved.pressed
    remaining = project_out(residual.T, spanned(np.delete(jacobian, index, axis=1)))
    return np.asarray(np.sum(remaining**2, axis=0))


def _prior_sd(problem: Problem) -> Array:
    return np.zeros(0) if problem.nuisances is None else problem.nuisances.sd


def _crossing(values: Array, deviance: Array, rise: float) -> float | None:
    """The value above the minimum at which the deviance has risen by ``rise``; None if it does not.

    Interpolated linearly in the square root of the deviance, as is exact for a parabola.
    """
    best = int(np.argmin(deviance))
    root = np.sqrt(np.maximum(deviance - deviance[best], 0.0))[best:]
    beyond = np.flatnonzero(root > np.sqrt(rise))
    if not len(beyond):
        return None
    at = int(beyond[0])
    return float(np.interp(np.sqrt(rise), root[at - 1 : at + 1], values[best:][at - 1 : at + 1]))
