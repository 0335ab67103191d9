"""Parameters of the predictor, the model they give, and its command line; neither needs ROS loaded."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sandbot_common import cli
from sandbot_common.errors import InputError
from sandbot_common.files import read_json
from sandbot_common.parameters import parameter
from sandbot_common.robot import SANDBOT, Robot, difference, read_robot, robot_from_mapping
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.model import model_of
from sandbot_model.physics.predictor import Predictor, predictor
from sandbot_model.physics.variants import with_variants
from sandbot_model.physics.walking import BASES, USUAL_K

_PHI, _K = tuple(USUAL_K.phi.tolist()), tuple(USUAL_K.k_n_per_m.tolist())


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
    values: str = parameter(
        "", doc="parameters of the effects, e.g. 'stance_overlap.eta=0.1, ...' (default: usual values)"
    )
    phi: tuple[float, ...] = parameter(_PHI, doc="volume fractions of the k table", low=0.3, high=0.8)
    k_n_per_m: tuple[float, ...] = parameter(_K, unit="N/m", doc="k at these volume fractions", low=1.0, high=1e5)
    delta_t_s: float = parameter(0.4, unit="s", doc="time in which the body is brought to leg speed", low=0.02, high=10)
    v_swim_m_s: float = parameter(0.02, unit="m/s", doc="swimming speed", low=0.0, high=1.0)


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
    return predictor(model, values, np.array(given.phi), np.array(given.k_n_per_m), "values")


def predictor_from_json(path: Path, robot: Robot | None, effects: Mapping[str, Effect] | None) -> Predictor:
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
    return predictor(model, values, phi, k, str(path))


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


main = cli.node("sandbot_model.nodes.predictor_node", PredictorParameters)

if __name__ == "__main__":
    raise SystemExit(main())
