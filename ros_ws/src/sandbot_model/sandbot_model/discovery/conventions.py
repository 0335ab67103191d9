"""Other conventions of effects' formulas (``physics.variants``): where no set fits, and what speaks against a claim.

A claim is of a family, and another family may explain as much under a convention of its own. Single effects under all
conventions are therefore tried against every claim. One that only comes near is none: it was picked from dozens, and
some have the claim's formula for a limit (a slip that spares the peak is an overlap where it is the same at all
depths). So the catalogue's formula stands unless another is better by BIC, its choice paid for; then both are named,
and the other alone where it is clearly better as well (``verdict.judge``).
"""

from collections.abc import Sequence

import numpy as np

from sandbot_model.discovery.batch_sd import granted
from sandbot_model.discovery.effect_search import EffectSearch, Names
from sandbot_model.discovery.nuisances_about import shared_by
from sandbot_model.discovery.verdict import leaves_nothing, overdispersion, parts_of, passes, picked_from, sound, worth
from sandbot_model.fitting.fit import Fit, fitted_at
from sandbot_model.fitting.global_minimum import far_above, solve, solve_below, solve_near
from sandbot_model.physics.model import Model, model_of
from sandbot_model.physics.variants import variants_of

CLOSER = 8
"""Single effects under other conventions that get a global search after a first look, the best."""
PAIRS = 3
"""Pairs that are tried under other conventions, the best; of single effects all are."""


def other_conventions(search: EffectSearch, size: int) -> bool:
    """Give single effects, or the best pairs, the convention that fits them best; whether any fits clearly better.

    Each is looked at near the best smaller set, the best of all then anywhere.
    """
    better = [names for names in _leading(search, size) if _better(search, names)]
    if better:
        best = min(better, key=lambda names: search.fits[names].bic)
        fit = search.fits[best]
        anywhere = fitted_at(fit.model, search.cells, solve((fit.model, search.cells, fit.warm_start)))
        search.fits[best] = anywhere if anywhere.deviance < fit.deviance else fit
    return bool(better)


def against(search: EffectSearch, claimed: Fit, named: Fit) -> bool:
    """Let in single effects under other conventions that leave nothing to explain and speak against a claim.

    Against several effects one must be clearly better. Against one, another family must be better though it was picked
    from all that were tried, also beside what trials share, as the claim is ``named``; then the claim's own family has
    the convention that is best for it, too. Whether there are any.
    """
    tried = _near(search, _models_of_one(search), far_above(claimed.deviance, 1.0))
    lead = search.criteria.clearly if len(claimed.effects) > 1 else picked_from(len(tried))
    better = [
        fit
        for fit in tried
        if _leads(fit, claimed, lead) and _explains(search, fit) and _leads(_beside(search, fit, named), named, lead)
    ]
    if all(fit.effects == claimed.effects for fit in better):
        return False
    search.fits |= {fit.effects: fit for fit in sorted(better, key=lambda fit: -fit.bic)}
    return True


def conventions(fits: Sequence[Fit]) -> dict[str, str]:
    """The other convention that each effect of these fits follows, if it does."""
    return {name: variant for fit in fits for name, variant in fit.variants.items()}


def _leads(fit: Fit, claimed: Fit, lead: float) -> bool:
    return fit.bic < claimed.bic - lead * overdispersion(claimed)


def _beside(search: EffectSearch, fit: Fit, named: Fit) -> Fit:
    """A set beside what trials share, the bed as rough as it is beside another."""
    if named.nuisances is None:
        return fit
    own = shared_by(fit, search.criteria, granted(named))
    return fitted_at(fit.model, fit.cells, solve_near((fit.model, fit.cells, (fit.warm_start,), own)), own)


def _explains(search: EffectSearch, fit: Fit) -> bool:
    return passes(fit, search.criteria) and worth({**search.fits, fit.effects: fit}, fit.effects, (), search.criteria)


def _better(search: EffectSearch, names: Names) -> bool:
    """Whether a set fits clearly better under another convention, which then takes its place.

    One that leaves nothing takes it with a number that nobody believes, too: it is no claim, but may be ``partial``.
    """
    if len(names) == 1:
        found = [fit for fit in singles(search) if fit.effects == names]
    else:
        found = _near(search, _models(search, names))
    some = [fit for fit in found if sound(fit) or leaves_nothing(fit, search.criteria)]
    best = min(some, key=lambda fit: fit.bic, default=search.fits[names])
    if best.bic >= search.fits[names].bic - search.criteria.clearly:
        return False
    search.fits[names] = best
    return True


def singles(search: EffectSearch) -> list[Fit]:
    """All single effects under all other conventions, fitted once."""
    if search.other_conventions is None:
        near = _near(search, _models_of_one(search))
        found = any(passes(fit, search.criteria) for fit in near)
        search.other_conventions = near if found else _closer(search, near)
    return search.other_conventions


def _closer(search: EffectSearch, near: Sequence[Fit]) -> list[Fit]:
    """The same, the best of them looked for everywhere: what the usual convention came to may lie in another valley."""
    ranked = sorted(near, key=_deviance)
    best, rest = ranked[:CLOSER], ranked[CLOSER:]
    points = search.fit_all(solve, [(fit.model, search.cells, fit.warm_start) for fit in best])
    anywhere = search.believable([fit.model for fit in best], points)
    return [*(min(both, key=_deviance) for both in zip(best, anywhere, strict=True)), *rest]


def _models_of_one(search: EffectSearch) -> list[Model]:
    return [model for name in search.names for model in _models(search, (name,))]


def _near(search: EffectSearch, models: Sequence[Model], hopeless: float = np.inf) -> list[Fit]:
    """Sets under another convention, near their best smaller set and near where the usual one has come to, if that
    gains: a threshold is not found from far away. What is above a deviance that is ``hopeless`` at once is left there.
    """
    tasks = []
    for model in models:
        usual = search.fits[model.identifiers]
        smaller = min((search.fits[part] for part in parts_of(model.identifiers, search.fits)), key=_deviance)
        gains = smaller.deviance - usual.deviance > search.criteria.claim
        starts = (smaller.warm_start, usual.warm_start)[: 1 + gains]
        tasks.append((model, search.cells, starts, None, hopeless))
    points = search.fit_all(solve_below, tasks)
    return search.believable(models, points)


def _deviance(fit: Fit) -> float:
    return fit.deviance


def _leading(search: EffectSearch, size: int) -> list[Names]:
    ranked = search.ranked(size)
    return [fit.effects for fit in (ranked if size == 1 else ranked[:PAIRS])]


def _models(search: EffectSearch, names: Names) -> list[Model]:
    """A set with one of its effects under another convention; those of a gait's phases where it has two."""
    one_rate = search.cells.clock.one_rate.all()
    swaps = [
        (name, variant)
        for name in names
        for variant in variants_of(search.effects[name])
        if not (one_rate and variant.of_phases)
    ]
    return [
        model_of(search.base, names, {**search.effects, name: variant}, search.cells.robot) for name, variant in swaps
    ]
