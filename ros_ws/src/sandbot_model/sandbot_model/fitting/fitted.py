"""A model at its fitted parameters, and what follows: errors, cells missed, predictions and their uncertainty."""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sandbot_common.arrays import Bools, Floats
from sandbot_common.errors import InputError
from sandbot_model.data.conditions import Cells
from sandbot_model.fitting import goodness
from sandbot_model.fitting.global_minimum import Point, WarmStart
from sandbot_model.fitting.goodness import Estimate, Fail, Goodness
from sandbot_model.fitting.jacobian import full_jacobian
from sandbot_model.fitting.leave_one_out import CrossValidation, cross_validation
from sandbot_model.fitting.levenberg_marquardt import bounds
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.nuisances import Nuisances
from sandbot_model.fitting.states import States
from sandbot_model.fitting.uncertainty import change, principal_steps
from sandbot_model.physics.averaging import predicted
from sandbot_model.physics.gait import Clock
from sandbot_model.physics.model import Model
from sandbot_model.physics.observables import NAMES
from sandbot_model.physics.walking import KCurve, Prediction

PARTS = 0.5 ** np.arange(8)
"""Parts of a standard deviation that are tried as a step (``Fitted.uncertainty``)."""
TOO_STEEP = 4.0
"""Factor by which the rise of the deviance may exceed a parabola's; beyond it there is a cliff."""
CLIFF = 4.0
"""Rise beyond a parabola's, that of two standard deviations, behind which a switch is still likely."""


@dataclass(frozen=True, eq=False, repr=False)
class Fitted:
    """A model at the minimum of its deviance, or with values held by hand.

    Arrays over cells have length n, the last axis is ``Observable``.

    What follows from these fields is computed on demand and not pickled.
    """

    model: Model
    cells: Cells
    point: Point
    stderr: Floats
    """Standard errors of the shared parameters, then of every level's ln k; NaN where the data do not determine one, ∞
    where only together with others."""
    covariance: Floats
    """Covariance of the same unknowns; 0 where, or along combinations that, the data do not determine."""
    goodness: Goodness
    nuisances: Nuisances | None = None
    """Nuisance parameters fitted with the rest; their estimates are ``shared``."""
    shared: tuple[Estimate, ...] = ()
    sample: Floats | None = None
    """Points ``(points, unknowns)`` of a posterior sample of the same unknowns, where ``stderr`` is that of one."""
    at_minimum: bool = True
    """False if values are held by hand: the others were not refitted, so there is no error out of sample."""

    @property
    def effects(self) -> tuple[str, ...]:
        """Identifiers of the effects on top of the base model."""
        return self.model.identifiers

    @property
    def variants(self) -> dict[str, str]:
        """The effects with another convention than the catalogue's, and which one (``physics.variants``)."""
        return {effect.identifier: effect.variant for effect in self.model.effects if effect.variant}

    @cached_property
    def parameters(self) -> Mapping[str, Estimate]:
        """The shared parameters."""
        named = zip(self.model.names, self.point.theta, self.stderr, strict=False)
        return {name: Estimate(float(value), float(error)) for name, value, error in named}

    @property
    def level_phi(self) -> Floats:
        """Volume fraction of every level."""
        return self.cells.level_phi

    @cached_property
    def k_n_per_m(self) -> Floats:
        """Stiffness of the ground at every level."""
        return np.asarray(np.exp(self.point.ln_k))

    @property
    def k_stderr_n_per_m(self) -> Floats:
        """Its standard error."""
        return self.k_n_per_m * self.stderr[len(self.point.theta) : len(self.point.theta) + len(self.point.ln_k)]

    @property
    def deviance(self) -> float:
        """See ``Goodness``."""
        return self.goodness.deviance

    @property
    def bic(self) -> float:
        """See ``Goodness``."""
        return self.goodness.bic

    @property
    def lack_of_fit_p(self) -> float:
        """See ``Goodness``."""
        return self.goodness.lack_of_fit_p

    @property
    def rmse_m_s(self) -> float:
        """Rms error of mean speed in sample."""
        return self.rmse["speed"]

    @property
    def rmse(self) -> Mapping[str, float]:
        """Rms error of each observable in sample [SI]; NaN if there are as many unknowns as cell means, for such a
        model passes through them all."""
        return self.goodness.rmse if self.goodness.dof > 0 else dict.fromkeys(NAMES, np.nan)

    @cached_property
    def cross_validation(self) -> CrossValidation:
        """The errors where each cell is predicted by the others."""
        if not self.at_minimum:
            return CrossValidation(dict.fromkeys(NAMES, np.nan), 0, np.nan)
        return cross_validation(self.problem, self.state, self._jacobian)

    @property
    def cv_rmse_m_s(self) -> float:
        """Rms error of mean speed out of sample."""
        return self.cross_validation.rmse["speed"]

    @cached_property
    def problem(self) -> Problem:
        """The likelihood that was maximised."""
        return Problem(self.model, self.cells, self.nuisances)

    @cached_property
    def state(self) -> States:
        """The likelihood at the fitted parameters, one row."""
        return state_at(self.problem, self.point)

    @property
    def predicted(self) -> Floats:
        """Predicted cell means ``(n, 4)``."""
        return np.asarray(self.state.predicted[0])

    @cached_property
    def residual_z(self) -> Floats:
        """Measured minus model in standard errors ``(n, 4)``; NaN where not measured."""
        return goodness.residual_z(self.problem, self.state)

    @cached_property
    def fails(self) -> tuple[Fail, ...]:
        """The cell means that are missed, the worst first."""
        return goodness.fails(self.cells, goodness.residual(self.problem, self.state), self.residual_z)

    @cached_property
    def at_bounds(self) -> tuple[str, ...]:
        """Parameters at an end of their search range, of those that the data determine."""
        return tuple(filter(self.determines, goodness.at_bounds(self.problem, self.point.theta)))

    @property
    def stopped(self) -> tuple[str, ...]:
        """Parameters of effects that only an end of their search range stopped: values beyond it were not tried."""
        ends = {name: self.model.parameter(name).ends_at(self.parameters[name].value) for name in self.at_bounds}
        return tuple(name for name, end in ends.items() if "." in name and end is not None)

    @cached_property
    def implausible(self) -> tuple[str, ...]:
        """Parameters three standard errors or more outside their plausible range, of those that the data determine."""
        return tuple(filter(self.determines, goodness.implausible(self.model, self.parameters)))

    def determines(self, name: str) -> bool:
        """Whether the data determine a shared parameter, or it is held. An effect's threshold without a standard error
        counts: the deviance is a staircase along it."""
        return "." in name or name in self.model.held or self.parameters[name].stderr > 0

    @cached_property
    def gait(self) -> str:
        """The gait of most trials."""
        trials = Counter[str]()
        for gait, count in zip(self.cells.gait, self.cells.n.max(axis=1).tolist(), strict=True):
            trials[gait] += count
        return max(trials, key=trials.__getitem__)

    @property
    def warm_start(self) -> WarmStart:
        """A start for a larger model."""
        values = {name: estimate.value for name, estimate in self.parameters.items()}
        return WarmStart(self.k_n_per_m, values, self.deviance)

    def predict(self, phi: ArrayLike, omega: ArrayLike, clock: Clock | None = None) -> Prediction:
        """The observables at other conditions; k is interpolated between levels and constant beyond them.

        ``clock`` is how legs turn (``gait.clock``), by default as in most of the trials. Raises InputError unless
        0 < φ < 1, 0 < ω < ∞ [rad/s] and their shapes can be broadcast.
        """
        return self._predict(self.point.theta, self.point.ln_k, *_conditions(phi, omega, clock), clock)

    def uncertainty(self, phi: ArrayLike, omega: ArrayLike, clock: Clock | None = None) -> Floats:
        """Standard deviation ``(..., 4)`` of ``predict`` due to the uncertainty of θ and k.

        It is large near a switch. Raises InputError as ``predict`` does.
        """
        phi, omega = _conditions(phi, omega, clock)
        return _sd(self._changes(lambda theta, k: self._observables(theta, k, phi, omega, clock)))

    def deviations(self, phi: Floats, omega: Floats, clock: Clock | None = None) -> Floats:
        """Changes ``(m, n, 4)`` of ``predict`` at conditions ``(n,)``, the sum of whose products is its covariance: one
        for each principal axis of the covariance of θ and k, or for each point of the ``sample``.
        """
        return self._changes(lambda theta, k: self._observables(theta, k, phi, omega, clock))

    def press(self, phi: Floats, depth_m: Floats) -> tuple[Floats, Floats]:
        """Force [N] on a leg pressed into virgin ground (see ``penetrometer``) and its standard deviation, ``(n,)``."""

        def force(theta: Floats, ln_k: Floats) -> Floats:
            return self.problem.press(theta, ln_k, np.interp(phi, self.level_phi, np.exp(ln_k)), phi, depth_m)

        found = self._changes(lambda theta, ln_k: (force(theta, ln_k)[:, None], True))
        return force(self.point.theta, self.point.ln_k), _sd(found)[..., 0]

    def __getstate__(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def _changes(self, predict: Callable[[Floats, Floats], tuple[Floats, Bools | bool]]) -> Floats:
        """Changes of ``predict(θ, ln k)``, which returns values ``(..., m)`` and whether the robot walks ``(...)``: see
        ``deviations``."""
        here, count = np.concatenate([self.point.theta, self.point.ln_k]), len(self.point.theta)

        def at(unknowns: Floats) -> tuple[Floats, Bools | bool]:
            return predict(unknowns[:count], unknowns[count:])

        expected, _ = at(here)
        if self.sample is None:
            changes = [change(at, here, *step) for step in self._steps]
        else:
            changes = [(at(point)[0] - expected) / np.sqrt(len(self.sample)) for point in self.sample]
        return np.array(changes).reshape(-1, *expected.shape)

    @cached_property
    def _steps(self) -> list[tuple[Floats, tuple[float, float], tuple[float, float]]]:
        """Steps ``(unknowns,)`` of one standard deviation along the principal axes of the covariance, and the fraction
        of each that may be taken back and ahead within bounds (``uncertainty.change``): while the deviance rises about
        as a parabola does, and to look for a switch, while no high cliff is in the way.
        """
        if not len(steps := principal_steps(self.covariance)):
            return []
        both, (low, high) = np.concatenate([-steps, steps]), bounds(self.problem)
        theta, here = both[:, : len(low)], self.point.theta
        moving = np.where(theta == 0.0, 1.0, theta)
        room = np.where(theta == 0.0, 1.0, (np.where(theta > 0.0, high, low) - here) / moving)
        parts = np.clip(room.min(axis=1, initial=1.0), 0.0, 1.0)[:, None] * PARTS
        rise = self._rise(parts[..., None] * both[:, None])
        parabola = parts**2 * np.sum((self._jacobian[:, : both.shape[1]] @ both.T) ** 2, axis=0)[:, None]
        near, far = (
            np.where(rise <= most, parts, parts[:, -1:]).max(axis=1).reshape(2, -1).T.tolist()
            for most in (TOO_STEEP * parabola, parabola + CLIFF)
        )
        return list(zip(steps, near, far, strict=True))

    def _rise(self, away: Floats) -> Floats:
        """Rise of the deviance ``(...)`` where θ and ln k differ from the fit by ``away (..., unknowns)``."""
        theta, ln_k = np.split(away.reshape(-1, away.shape[-1]), [len(self.point.theta)], axis=1)
        state, rows = self.state, np.zeros(len(theta), dtype=np.int64)
        at = self.point.theta + theta, self.point.ln_k + ln_k, state.slope[rows], self.problem.shared(state)
        return np.asarray(self.problem.states(*at).deviance - state.deviance).reshape(away.shape[:-1])

    @cached_property
    def _jacobian(self) -> Floats:
        return np.asarray(full_jacobian(self.problem, self.state)[0])

    def _observables(
        self, theta: Floats, ln_k: Floats, phi: Floats, omega: Floats, clock: Clock | None
    ) -> tuple[Floats, Bools | bool]:
        found = self._predict(theta, ln_k, phi, omega, clock)
        return found.observables, found.walking

    def _predict(self, theta: Floats, ln_k: Floats, phi: Floats, omega: Floats, clock: Clock | None) -> Prediction:
        k = np.exp(ln_k)
        clock = self.cells.clock[self.cells.gait.index(self.gait)] if clock is None else clock
        curve = KCurve(self.level_phi, k)
        inputs, params = self.model.inputs(theta, curve(phi), omega, phi, clock, curve)
        shape = np.broadcast_shapes(np.shape(phi), np.shape(omega), np.shape(clock.slow_ratio))
        found = predicted(self.model.walker, inputs, params, curve)
        return Prediction(*(np.broadcast_to(values, shape) for values in vars(found).values()))


def _sd(changes: Floats) -> Floats:
    return np.asarray(np.sqrt(np.sum(changes**2, axis=0)))


def _conditions(phi: ArrayLike, omega: ArrayLike, clock: Clock | None) -> tuple[Floats, Floats]:
    """φ and ω [rad/s] as arrays. Raises InputError for those at which nothing can be predicted."""
    found = (
        _between(0.0, 1.0, phi, "phi", "volume fractions between 0 and 1, both excluded, are needed"),
        _between(0.0, np.inf, omega, "omega", "finite leg frequencies above 0 rad/s are needed"),
    )
    shapes = [np.shape(values) for values in (*found, *([] if clock is None else [clock.slow_ratio]))]
    try:
        np.broadcast_shapes(*shapes)
    except ValueError:
        raise InputError(
            f"phi, omega: shapes {', '.join(map(str, shapes))} can't be broadcast; give as many of each, or a grid: "
            "phi[:, None] and omega[None, :]"
        ) from None
    return found


def _between(low: float, high: float, given: ArrayLike, name: str, right: str) -> Floats:
    try:
        values = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{name}: {given!r:.40}: not numbers; {right}") from None
    wrong = values[~((values > low) & (values < high))]
    if wrong.size:
        raise InputError(f"{name}: {wrong[0]:g} is out of range; {right}")
    return values


def state_at(problem: Problem, point: Point) -> States:
    """The likelihood at a point, one row."""
    shared = None if problem.nuisances is None or point.shared is None else point.shared[None]
    return problem.states(point.theta[None], point.ln_k[None], point.slope[None], shared)
