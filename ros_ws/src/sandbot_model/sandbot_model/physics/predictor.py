"""Predictions while a trial runs: mean speed for the conditions, v_x(t) for the leg angles."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sandbot_common.arrays import Floats
from sandbot_common.errors import InputError
from sandbot_common.robot import Robot
from sandbot_model.physics.averaging import predicted
from sandbot_model.physics.gait import clock
from sandbot_model.physics.geometry import stance_angle, step_from_lift
from sandbot_model.physics.model import Model
from sandbot_model.physics.walking import KCurve, Prediction


@dataclass(frozen=True)
class Instant:
    """Body velocity at a moment [m/s; trackway frame]."""

    v_x: float
    v_z: float


@dataclass(frozen=True)
class Predictor:
    """A model with values for all parameters and k."""

    model: Model
    theta: Floats
    phi: Floats
    k_n_per_m: Floats
    _cache: dict[Any, Any] = field(default_factory=dict, repr=False, compare=False)

    def mean_speed(self, phi: float, omega: float, gait: str = "") -> float:
        """v̄ [m/s]."""
        return self._stance(phi, omega, gait)[0]

    def mean_speeds(self, phi: float, omega: Floats, gait: str) -> Floats:
        """v̄ [m/s] at one φ over leg frequencies [rad/s] of shape ``(n,)``."""
        return np.asarray(self._predicted(np.full(len(omega), phi), omega, gait).speed_m_s, dtype=float)

    def velocity(self, phi: float, omega: float, gait: str, angles: Floats, rates: Floats) -> Instant:
        """Body velocity for leg angles [rad] and rates [rad/s] of shape ``(legs,)``.

        A leg stands while its centre is within the chord, |θ| ≤ asin(s/2R); the axle then moves on a circle about it,
        v = Rθ̇ (cos θ, -sin θ). With no leg standing the belly is down and the body rests; a swimming one has v_swim.
        """
        mean, reach = self._stance(phi, omega, gait)
        if reach <= 0:
            return Instant(mean, 0.0)
        wrapped = np.mod(np.asarray(angles) + np.pi, 2 * np.pi) - np.pi
        standing = np.abs(wrapped) <= reach
        if not standing.any():
            return Instant(0.0, 0.0)
        leg = int(np.argmax(np.where(standing, np.cos(wrapped), -np.inf)))
        speed = self.model.robot.leg_radius_m * float(rates[leg])
        return Instant(speed * math.cos(wrapped[leg]), -speed * math.sin(wrapped[leg]))

    def _stance(self, phi: float, omega: float, gait: str) -> tuple[float, float]:
        """Mean speed [m/s] and largest leg angle while standing [rad]; 0 where it swims."""
        key = (round(phi, 5), round(omega, 4), gait)
        if key not in self._cache:
            self._cache[key] = self._solve(phi, omega, gait)
        found: tuple[float, float] = self._cache[key]
        return found

    def _solve(self, phi: float, omega: float, gait: str) -> tuple[float, float]:
        found = self._predicted(np.asarray(phi), omega, gait)
        if not bool(found.walking):
            return float(found.speed_m_s), 0.0
        radius = self.model.robot.leg_radius_m
        return float(found.speed_m_s), float(stance_angle(step_from_lift(found.lift_m, radius), radius))

    def _predicted(self, phi: Floats, omega: ArrayLike, gait: str) -> Prediction:
        curve = KCurve(self.phi, self.k_n_per_m)
        inputs, params = self.model.inputs(self.theta, curve(phi), omega, phi, clock([gait])[0], curve)
        return predicted(self.model.walker, inputs, params, curve)


def of_robot(predictor: Predictor, robot: Robot) -> Predictor:
    """The same model for another robot."""
    return Predictor(replace(predictor.model, robot=robot), predictor.theta, predictor.phi, predictor.k_n_per_m)


def predictor(model: Model, values: Mapping[str, float], phi: Floats, k: Floats, where: str) -> Predictor:
    """A model at these values, else its starts, on the curve ``k`` [N/m] at ``phi``, both ``(levels,)``.

    Raises InputError, which begins with ``where``, for a wrong value.
    """
    for name, value in values.items():
        if name in model.names:
            model.parameter(name).check(value, f"{where}: {name}")
        elif name != "v_swim_m_s":
            raise InputError(f"{where}: {name!r} is not a parameter of this model; it has {', '.join(model.names)}")
    starts = dict(zip(model.names, (parameter.start for parameter in model.parameters), strict=True))
    theta = np.array([values.get(name, start) for name, start in starts.items()], dtype=float)
    return Predictor(model, theta, phi, k)
