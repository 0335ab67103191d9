"""Effects that could be there at their usual strength and not show in these data."""

from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.verdict import worth
from sandbot_model.fitting.fit import Fit


def unseen(search: EffectSearch, base: Fit) -> list[Fit]:
    """The base model, as it is reported, with each effect held at its usual strength, where data do not exclude it."""
    criteria = search.criteria
    names = [name for name in search.names if (name,) in search.fits and not worth(search.fits, (name,), (), criteria)]
    held = search.near([search.model((name,), _usual(search, name)) for name in names], base)
    return [fit for fit in held if fit.deviance < base.deviance + criteria.not_excluded]


def _usual(search: EffectSearch, name: str) -> dict[str, float]:
    """Where one effect's parameters usually are."""
    return {f"{name}.{parameter.name}": parameter.start for parameter in search.effects[name].parameters}
