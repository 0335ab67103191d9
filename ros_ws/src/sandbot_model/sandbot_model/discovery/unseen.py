"""Effects that may be present at their usual strength without showing in these data."""

from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.verdict import earns_place
from sandbot_model.fitting.fit import Fit


def unseen(search: EffectSearch, named: Fit) -> list[Fit]:
    """Fits of the base model with each effect that is not excluded, given the nuisances of ``named``, held at its usual
    strength. They are without nuisances: a trial is to show the effect, not the zero of a reading."""
    criteria = search.criteria
    names = [
        name for name in search.names if (name,) in search.fits and not earns_place(search.fits, (name,), (), criteria)
    ]
    models = [search.model((name,), _usual_values(search, name)) for name in names]
    fits = search.near(models, named)
    hidden = [at for at, fit in enumerate(fits) if fit.deviance < named.deviance + criteria.not_excluded]
    return (
        search.near([models[at] for at in hidden], search.fits[()]) if named.nuisances else [fits[at] for at in hidden]
    )


def _usual_values(search: EffectSearch, name: str) -> dict[str, float]:
    """The parameters of an effect at its usual strength."""
    return {f"{name}.{parameter.name}": parameter.start for parameter in search.effects[name].parameters}
