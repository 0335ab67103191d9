"""Numbers formatted for readers: with unit, with as many digits as the error justifies, and never a bare NaN."""

import math
from collections.abc import Iterable

from sandbot_model.fitting.text import UNKNOWN, cm_s, counted, probability, to_error, with_error
from sandbot_model.physics.effect import Effect, Parameter
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.model import BASE_PARAMETERS
from sandbot_model.physics.observables import CM
from sandbot_model.physics.typeset import plain
from sandbot_model.report.view import readable

__all__ = (
    "UNKNOWN",
    "centi",
    "cm_s",
    "counted",
    "described",
    "number",
    "probability",
    "symbol",
    "to_error",
    "with_error",
)


def centi(value: float) -> str:
    """A length or speed in cm or cm/s, without its unit."""
    return number(CM * value, 2)


def number(value: float, digits: int = 1) -> str:
    """A plain number with a true minus sign, never "−0"."""
    return f"{value:z.{digits}f}".replace("-", "−") if math.isfinite(value) else UNKNOWN


def symbol(parameter: Parameter) -> str:
    """A parameter's symbol in formulas, its subscript as HTML and Plotly set it: ``k<sub>L</sub>``."""
    name = plain(parameter.symbol or parameter.name.removesuffix(f"_{parameter.unit}"))
    head, _, subscript = name.partition("_")
    return f"{head}<sub>{subscript}</sub>" if subscript else head


def described(parameter: str, effects: Iterable[Effect] = CATALOGUE) -> tuple[str, str]:
    """(description, unit) of a fitted parameter such as ``delta_t_s`` or ``disturbed_ground.s_c``.

    A parameter of an effect that is not among ``effects`` (a user's own) is returned by name, without a unit.
    """
    effect, _, name = parameter.rpartition(".")
    owners = {e.identifier: e.parameters for e in effects} | {"": BASE_PARAMETERS}
    for known in owners.get(effect, ()):
        if known.name == name:
            words = f"{readable(effect)}: {known.doc}" if effect else known.doc
            return words, "" if known.unit == "1" else known.unit
    return parameter, ""
