"""Effects that may be present at their usual strength without showing in these data, and how they would shift Δt."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.verdict import RESPONSE_TIME, earns_place
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.text import to_error

SHIFTS = 2.0
"""Standard errors of Δt from which it is said how far an unseen effect would shift it."""


@dataclass(frozen=True)
class Shift:
    """Δt [s] as fitted if an unseen effect is there at its usual strength."""

    effect: str
    parameters: Mapping[str, float]
    """The effect's parameters, held at their usual values, by full name."""
    delta_t_s: float

    def in_words(self, named: Fit, *, covered: bool) -> str:
        """Both values, rounded to the error of the reported one, and whether its error as printed covers both."""
        held = ", ".join(f"{name.partition('.')[2]} = {value:g}" for name, value in self.parameters.items())
        there, (here, stderr) = self.delta_t_s, named.parameters[RESPONSE_TIME]
        given = f"{self.effect} ({held})" if held else self.effect
        both = f"if {given} is there, Δt is {to_error(there, stderr)} s, not {to_error(here, stderr)} s"
        return f"{both} (its standard error covers both)" if covered else both


def largest_shift(reported: Fit, hidden: Sequence[Fit]) -> Shift | None:
    """Of the effects that these fits hold, the one that would shift Δt most; None if none does by ``SHIFTS`` of its
    reported errors."""
    value, _ = reported.parameters[RESPONSE_TIME]
    most = max(hidden, key=lambda fit: abs(fit.parameters[RESPONSE_TIME].value - value), default=None)
    if most is None or not _is_shifted(reported, most):
        return None
    return Shift(most.effects[0], dict(most.model.held), most.parameters[RESPONSE_TIME].value)


def equally_simple(reported: Fit, hidden: Sequence[Fit]) -> list[Fit]:
    """The hidden effects without parameters that would shift Δt by ``SHIFTS`` errors: each only puts another formula in
    place of one of the model's, so neither is simpler."""
    return [fit for fit in hidden if not fit.model.held and _is_shifted(reported, fit)]


def _is_shifted(reported: Fit, hidden: Fit) -> bool:
    """Whether an effect would shift Δt by ``SHIFTS`` of its reported errors."""
    value, stderr = reported.parameters[RESPONSE_TIME]
    return abs(hidden.parameters[RESPONSE_TIME].value - value) > SHIFTS * stderr


def unseen(search: EffectSearch, named: Fit) -> list[Fit]:
    """Fits of the base model with each effect that is not excluded, given the nuisances of ``named``, held at its usual
    strength."""
    criteria = search.criteria
    names = [
        name for name in search.names if (name,) in search.fits and not earns_place(search.fits, (name,), (), criteria)
    ]
    models = [search.model((name,), _usual_values(search, name)) for name in names]
    fits = search.near(models, named, also=[(search.fits[name,].warm_start,) for name in names])
    return [fit for fit in fits if fit.deviance < named.deviance + criteria.not_excluded]


def without_nuisances(search: EffectSearch, hidden: list[Fit]) -> list[Fit]:
    """The same fits without nuisances: a trial is to show an effect, not the zero of a reading."""
    if all(fit.nuisances is None for fit in hidden):
        return hidden
    return search.near([fit.model for fit in hidden], search.fits[()])


def _usual_values(search: EffectSearch, name: str) -> dict[str, float]:
    """The parameters of an effect at its usual strength."""
    return {f"{name}.{parameter.name}": parameter.start for parameter in search.effects[name].parameters}
