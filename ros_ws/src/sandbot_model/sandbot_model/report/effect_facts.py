"""Facts about an effect as text: a description, its parameters' ranges, and the observables in which it would show."""

import inspect
import sys

from sandbot_model.discovery.fingerprint import OMEGA_RAD_S, PHI, SEEN, TRIALS, Fingerprint
from sandbot_model.physics import effects
from sandbot_model.physics.effect import Effect, Parameter
from sandbot_model.physics.formula import GIVEN
from sandbot_model.physics.observables import Observable
from sandbot_model.physics.variants import Variant

DESIGN = f"{TRIALS} trials in each of {len(PHI)} x {len(OMEGA_RAD_S)} conditions"
OBSERVABLES = "v speed, L lift, W waveform, T torque, P pitch"
"""Symbols in ``Effect.seen_in``."""
ABSORBED = "k(φ), Δt and the swimming speed of the simple model absorb it"


def words(effect: Effect) -> str:
    """An effect in plain words: the docstring of its module (of its class for a user's effect), or the formula that
    defines it. A variant under another convention is described by its family."""
    if isinstance(effect, Variant):
        return words(effect.family)
    cls = type(effect)
    if effect.source == GIVEN:
        return effect.formula
    own = cls.__module__.startswith(f"{effects.__name__}.")
    said = inspect.getdoc(sys.modules[cls.__module__] if own else cls) or effect.formula
    return " ".join(said.split("\n\n")[0].split()).rstrip(".")


def range_of(parameter: Parameter) -> str:
    """A parameter's name, plausible range, usual value and description."""
    return f"{parameter.name} {range_text(parameter)}"


def range_text(parameter: Parameter) -> str:
    """A parameter's plausible range, usual value and description, without its name."""
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    return f"{parameter.low:g} to {parameter.high:g}{unit}, usually {parameter.start:g}: {parameter.doc}"


def shown_in(found: Fingerprint) -> list[Observable]:
    """The observables in which an effect would show, most sensitive first."""
    most = sorted(Observable, key=lambda observable: -abs(found.largest(observable)[0]))
    return [observable for observable in most if abs(found.largest(observable)[0]) >= SEEN]


def showing(found: Fingerprint, observable: Observable) -> str:
    """Size and condition of the effect's largest deviation in an observable."""
    errors, phi, omega = found.largest(observable)
    where = f"{abs(errors):.0f} standard errors {'above' if errors > 0 else 'below'} the model"
    return f"{observable.label}: {where} at φ {phi:g}, ω {omega:g} rad/s"
