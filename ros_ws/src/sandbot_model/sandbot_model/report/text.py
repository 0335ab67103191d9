"""Numbers as people read them: a unit on each, as many digits as its error allows, never a silent NaN."""

import math
from collections.abc import Iterable

from sandbot_model.physics.effect import Effect
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.model import BASE_PARAMETERS
from sandbot_model.physics.observables import CM
from sandbot_model.report.view import readable

UNKNOWN = "not known"


def cm_s(value_m_s: float) -> str:
    """A speed [m/s] in cm/s: ``4.11 cm/s``."""
    return f"{CM * value_m_s:.2f} cm/s" if math.isfinite(value_m_s) else UNKNOWN


def centi(value: float) -> str:
    """A length or speed in cm or cm/s, without its unit."""
    return f"{CM * value:.2f}" if math.isfinite(value) else UNKNOWN


def probability(p: float) -> str:
    """A p-value: ``0.43``, ``< 0.001``."""
    if not math.isfinite(p):
        return UNKNOWN
    return "< 0.001" if p < 0.001 else f"{p:.2g}"


def with_error(value: float, stderr: float) -> str:
    """Value ± standard error, rounded to two digits of the error: ``0.401 ± 0.012``."""
    if not math.isfinite(value):
        return UNKNOWN
    if not math.isfinite(stderr) or stderr <= 0.0:
        return f"{value:.4g} (± {UNKNOWN})"
    decimals = max(0, 1 - math.floor(math.log10(stderr)))
    return f"{value:.{decimals}f} ± {stderr:.{decimals}f}"


def number(value: float, digits: int = 1) -> str:
    """A plain number with a true minus sign."""
    return f"{value:.{digits}f}".replace("-", "−") if math.isfinite(value) else UNKNOWN


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
