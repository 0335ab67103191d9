"""Predictions while a trial runs: mean speed for the conditions, v_x(t) for the leg angles."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sandbot_common.errors import InputError
from sandbot_common.files import read_json
from sandbot_common.parameters import parameter
from sandbot_common.robot import SANDBOT, Robot, difference, read_robot, robot_from_mapping
from sandbot_model.physics.arrays import Array
from sandbot_model.physics.averaging import predicted
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.gait import clock
from sandbot_model.physics.geometry import stance_angle, step_from_lift
from sandbot_model.physics.model import Model, model_of
from sandbot_model.physics.variants import with_variants
from sandbot_model.physics.walking import BASES, KCurve, Prediction


@dataclass(frozen=True)
class PredictorParameters:
    """The model a predictor runs; ``result`` takes all from a file of ``discover --json`` or ``compare --json``."""

    result: str = parameter("", doc="JSON of discover or compare: use its last step (empty: the parameters below)")
    robot: str = parameter("", doc="robot file (empty: the result's, else the trial's own, else SandBot)")
    model: str = parameter("simple", doc="base model", choices=tuple(BASES))
    effects: str = parameter("", doc="effects, separated by commas")
    # ROS has no empty list of strings.
    effect: tuple[str, ...] = parameter(("",), doc="your own effects as formulas, as --effect of compare")
    effects_from: tuple[str, ...] = parameter(("",), doc="Python files with effects of your own")
    values: str = parameter("", doc="their parameters, e.g. 'stance_overlap.eta=0.1, ...' (default: each one's start)")
    phi: tuple[float, ...] = parameter((0.58, 0.6, 0.633), doc="volume fractions of the k table", low=0.3, high=0.8)
    k_n_per_m: tuple[float, ...] = parameter((170.0, 205.0, 220.0), unit="N/m", doc="k at those", low=1.0, high=1e5)
    delta_t_s: float = parameter(0.4, unit="s", doc="time in which the body is brought to leg speed", low=0.02, high=10)
    v_swim_m_s: float = parameter(0.02, unit="m/s", doc="swimming speed", low=0.0, high=1.0)


@dataclass(frozen=True)
class Instant:
    """Body velocity at a moment [m/s; trackway frame]."""

    v_x: float
    v_z: float


@dataclass(frozen=True)
class Predictor:
    """A model with values for all parameters and k."""

    model: Model
    theta: Array
    phi: Array
    k_n_per_m: Array
    _cache: dict[Any, Any] = field(default_factory=dict, repr=False, compare=False)

    def mean_speed(self, phi: float, omega: float, gait: str = "") -> float:
        """v̄ [m/s]."""
        return self._stance(phi, omega, gait)[0]

    def mean_speeds(self, phi: float, omega: Array, gait: str = "") -> Array:
        """v̄ [m/s] at one φ over leg frequencies [rad/s] of shape ``(n,)``."""
        return np.asarray(self._predicted(np.full(len(omega), phi), omega, gait).speed_m_s, dtype=float)

    def velocity(self, phi: float, omega: float, gait: str, angles: Array, rates: Array) -> Instant:
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

    def _predicted(self, phi: Array, omega: ArrayLike, gait: str) -> Prediction:
        curve = KCurve(self.phi, self.k_n_per_m)
        inputs, params = self.model.inputs(self.theta, curve(phi), omega, phi, clock([gait])[0], curve)
        return predicted(self.model.walker, inputs, params, curve)


def of_robot(predictor: Predictor, robot: Robot) -> Predictor:
    """The same model for another robot."""
    return Predictor(replace(predictor.model, robot=robot), predictor.theta, predictor.phi, predictor.k_n_per_m)


def predictor_of(given: PredictorParameters) -> Predictor:
    """The predictor that the parameters describe. Raises InputError where they are inconsistent."""
    robot = read_robot(given.robot) if given.robot else None
    effects = catalogue([Path(file) for file in given.effects_from if file], list(filter(None, given.effect)))
    if given.result:
        alone = PredictorParameters(
            given.result, robot=given.robot, effect=given.effect, effects_from=given.effects_from
        )
        if others := [name for name, value in vars(given).items() if value != getattr(alone, name)]:
            raise InputError(f"{others[0]}: result {given.result} specifies the whole model; leave one of the two out")
        return predictor_from_json(Path(given.result), robot, effects)
    if len(given.phi) != len(given.k_n_per_m) or list(given.phi) != sorted(set(given.phi)):
        raise InputError("phi must rise and have as many values as k_n_per_m")
    names = [name.strip() for name in given.effects.split(",") if name.strip()]
    model = model_of(given.model, names, effects, robot)
    values = {"delta_t_s": given.delta_t_s, "v_swim_m_s": given.v_swim_m_s, **_assignments(given.values)}
    return _predictor(model, values, np.array(given.phi), np.array(given.k_n_per_m), "values")


def predictor_from_json(
    path: Path, robot: Robot | None = None, effects: Mapping[str, Effect] | None = None
) -> Predictor:
    """The last step of a result of ``discover --json`` or ``compare --json``, which must be for ``robot`` if given.

    ``effects`` are by default the catalogue's.
    """
    content, known = read_json(path), catalogue() if effects is None else effects
    try:
        step = content["steps"][-1]
        values = {name: float(entry["value"]) for name, entry in step["parameters"].items()}
        phi, k = np.array([(row["phi"], row["value"]) for row in step["k_n_per_m"]], dtype=float).T
        stated = content.get("robot")
        own = robot_from_mapping(stated, f"{path}: robot") if stated is not None else robot or SANDBOT
        # Older files have one entry for all steps.
        known = with_variants(step.get("variants", content.get("variants", {})), known)
        if absent := [name for name in step["effects"] if name not in known]:
            raise InputError(f"effect {absent[0]!r} is not in the catalogue; effect or effects_from gives your own")
        model = model_of(content["model"], step["effects"], known, own)
    except InputError as error:
        raise InputError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None
    except (KeyError, IndexError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{path}: not a result of discover or compare: {type(error).__name__} {error}") from None
    if robot is not None and robot != own:
        raise InputError(f"{path}: the result is for another robot than robot says ({difference(own, robot)})")
    return _predictor(model, values, phi, k, str(path))


def _predictor(model: Model, values: Mapping[str, float], phi: Array, k: Array, where: str) -> Predictor:
    for name, value in values.items():
        if name in model.names:
            model.parameter(name).check(value, f"{where}: {name}")
        elif name != "v_swim_m_s":
            raise InputError(f"{where}: {name!r} is no parameter of this model; it has {', '.join(model.names)}")
    starts = dict(zip(model.names, (parameter.start for parameter in model.parameters), strict=True))
    theta = np.array([values.get(name, start) for name, start in starts.items()], dtype=float)
    return Predictor(model, theta, phi, k)


def _assignments(text: str) -> dict[str, float]:
    found = {}
    for part in filter(None, (part.strip() for part in text.split(","))):
        name, equals, value = part.partition("=")
        try:
            found[name.strip()] = float(value) if equals else math.nan
        except ValueError:
            raise InputError(f"values: {part!r} is not 'effect.parameter=number'") from None
        if not math.isfinite(found[name.strip()]):
            raise InputError(f"values: {part!r} is not 'effect.parameter=number'")
    return found
