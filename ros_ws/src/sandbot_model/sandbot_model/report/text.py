"""Numbers as people read them: a unit on each, as many digits as its error allows, never a silent NaN."""

import math
from collections.abc import Iterable

from sandbot_model.fitting.text import UNKNOWN, cm_s, counted, probability, with_error
from sandbot_model.physics.effect import Effect, Parameter
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.model import BASE_PARAMETERS
from sandbot_model.physics.observables import CM
from sandbot_model.physics.typeset import plain
from sandbot_model.report.view import readable

__all__ = ("centi", "cm_s", "counted", "described", "number", "probability", "symbol", "with_error")


def centi(value: float) -> str:
    """A length or speed in cm or cm/s, without its unit."""
    return number(CM * value, 2)


def number(value: float, digits: int = 1) -> str:
    """A plain number with a true minus sign, and none before what rounds to zero."""
    return f"{value:z.{digits}f}".replace("-", "−") if math.isfinite(value) else UNKNOWN


def symbol(parameter: Parameter) -> str:
    """What formulas call a parameter, its subscript as HTML and Plotly set it: ``k<sub>L</sub>``."""
    called = plain(parameter.symbol or parameter.name.removesuffix(f"_{parameter.unit}"))
    head, _, subscript = called.partition("_")
    return f"{head}<sub>{subscript}</sub>" if subscript else head


def described(parameter: str, effects: Iterable[Effect] = CATALOGUE) -> tuple[str, str]:
    """(description, unit) of a fitted parameter such as ``delta_t_s`` or ``disturbed_ground.s_c``.

    A parameter of an effect that is not among ``effects`` (a user's own) is called by its name, without a unit.
    """
    effect, _, name = parameter.rpartition(".")
    owners = {e.identifier: e.parameters for e in effects} | {"": BASE_PARAMETERS}
    for known in owners.get(effect, ()):
        if known.name == name:
            words = f"{readable(effect)}: {known.doc}" if effect else known.doc
            return words, "" if known.unit == "1" else known.unit
    return parameter, ""
