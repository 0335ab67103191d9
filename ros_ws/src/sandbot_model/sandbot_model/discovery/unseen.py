"""Effects that could be there at their usual strength and not show in these data."""

from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.verdict import earns_place
from sandbot_model.fitting.fit import Fit


def unseen(search: EffectSearch, named: Fit) -> list[Fit]:
    """The base model with each effect held at its usual strength, where data do not exclude it beside what the verdict
    grants; fitted without that, as what trials would show is no reading's zero."""
    criteria = search.criteria
    names = [
        name for name in search.names if (name,) in search.fits and not earns_place(search.fits, (name,), (), criteria)
    ]
    held = [search.model((name,), _usual(search, name)) for name in names]
    beside = search.near(held, named)
    hidden = [at for at, fit in enumerate(beside) if fit.deviance < named.deviance + criteria.not_excluded]
    return (
        search.near([held[at] for at in hidden], search.fits[()]) if named.nuisances else [beside[at] for at in hidden]
    )


def _usual(search: EffectSearch, name: str) -> dict[str, float]:
    """Where one effect's parameters usually are."""
    return {f"{name}.{parameter.name}": parameter.start for parameter in search.effects[name].parameters}
