"""Other conventions of effects' formulas (``physics.variants``): where no set fits, and what speaks against a claim.

A claim is of a family, and another family may explain as much under a convention of its own. Single effects under all
conventions are therefore tried against every claim. One that only comes near is none: it was picked from dozens, and
some have the claim's formula for a limit (a slip that spares the peak is an overlap where it is the same at all
depths). So the catalogue's formula stands unless another is better by BIC, its choice paid for; then both are named,
and the other alone where it is clearly better as well (``verdict.judge``). A bed of another depth than the robot's
file says is no formula to be picked: a floor that is felt is named beside the claim where it explains about as much.

What changes a step, and not how deep legs go, is seen along the track alone: where only the mean speed was measured
there, no convention of it can be told from another, and none is claimed.
"""

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.nuisances_about import ALONG, gain_of_batches, shared_by
from sandbot_model.discovery.verdict import (
    claim,
    leaves_nothing,
    overdispersion,
    parts_of,
    passes,
    picked_from,
    sound,
    worth,
)
from sandbot_model.fitting.fit import Fit, fitted_at
from sandbot_model.fitting.global_minimum import WarmStart, far_above, solve, solve_near, solve_near_unless_hopeless
from sandbot_model.physics.model import Model, model_of
from sandbot_model.physics.variants import BY_ITS_TILT, IN_ANOTHER_BED, Variant, variants_of

PAIRS = 3
"""Sets of two that are tried under other conventions, the best."""
CLOSER = 8
"""Single effects under other conventions that get a global search after a first look, the best."""


def other_conventions(search: EffectSearch) -> bool:
    """Give single effects the convention that fits them best; whether any fits clearly better, and is worth that it
    was picked from all.

    Each is looked at near the base model, the best of all then anywhere.
    """
    tried = singles(search)
    picked = picked_from(len(tried))
    better = [
        fit
        for fit in tried
        if BY_ITS_TILT not in fit.variants.values()
        and _seen(search, fit)
        and search.fits[()].deviance - fit.deviance > claim(fit, search.criteria) + picked * overdispersion(fit)
        and _clearly_better(search, fit)
    ]
    return _taken(search, better)


def beside_the_leader(search: EffectSearch) -> bool:
    """Try each effect beside the best single one, where that is under another convention; whether any fits clearly
    better than with the usual one."""
    leader = search.ranked(1)[0]
    if not leader.variants:
        return False
    own = {**search.effects, leader.effects[0]: leader.model.effects[0]}
    sets = search.extended(leader.effects)
    found = _near(search, [model_of(search.base, names, own, search.cells.robot) for names in sets])
    return _taken(search, list(filter(partial(_clearly_better, search), found)))


def within_pairs(search: EffectSearch) -> bool:
    """Try the best sets of two with one effect under another convention; whether any fits clearly better than with the
    usual one, though it was picked from all."""
    models = [
        model_of(search.base, pair.effects, {**search.effects, name: variant}, search.cells.robot)
        for pair in search.ranked(2)[:PAIRS]
        for name in pair.effects
        for variant in _to_be_tried(search, name)
    ]
    better = partial(_clearly_better, search, picked=picked_from(len(models)))
    return _taken(search, list(filter(better, _near(search, models))))


def _taken(search: EffectSearch, better: Sequence[Fit]) -> bool:
    """Put the best of each set in the usual one's place, the best of all where a search of everywhere comes to; whether
    there are."""
    search.fits |= {fit.effects: fit for fit in sorted(better, key=lambda fit: -fit.bic)}
    if better:
        best = min(better, key=lambda fit: fit.bic)
        anywhere = fitted_at(best.model, search.cells, solve((best.model, search.cells, best.warm_start)))
        search.fits[best.effects] = min(best, anywhere, key=_deviance)
    return bool(better)


def against(search: EffectSearch, claimed: Fit) -> bool:
    """Let in single effects under other conventions that leave nothing to explain and speak against a claim.

    Against several effects, which were picked as well, one need only be better. Against one, another family must be
    better though it was picked from all that were tried; then the claim's own family has the convention that is best
    for it, too. Both are compared beside what trials share, as well. Whether there are any.
    """
    # Half way to the base model, by orders of magnitude: so high may end a first descent of what explains all.
    hopeless = max(far_above(claimed.deviance, 1.0), math.sqrt(claimed.deviance * search.fits[()].deviance))
    tried = _near(search, _models_of_one(search), hopeless, (claimed.warm_start,))
    picked = 0.0 if len(claimed.effects) > 1 else picked_from(len(tried))

    def leads(fit: Fit, bic: float, claims: float) -> bool:
        lead = -search.criteria.clearly if IN_ANOTHER_BED in fit.variants.values() else picked
        return bic < claims - lead * overdispersion(claimed)

    better = [fit for fit in tried if leads(fit, fit.bic, claimed.bic) and _explains(search, fit)]
    if better:
        claims = _weighed(search, claimed)
        better = [fit for fit in better if leads(fit, _weighed(search, fit), claims)]
    if all(fit.effects == claimed.effects for fit in better):
        return False
    search.fits |= {fit.effects: fit for fit in sorted(better, key=lambda fit: -fit.bic)}
    return True


def conventions(fits: Sequence[Fit]) -> dict[str, str]:
    """The other convention that each effect of these fits follows, if it does."""
    return {name: variant for fit in fits for name, variant in fit.variants.items()}


def _weighed(search: EffectSearch, fit: Fit) -> float:
    """BIC beside what trials share, on a bed that scatters as suits what is left: what needs a rough bed has explained
    less."""
    own = shared_by(fit, search.criteria)
    beside = fitted_at(fit.model, fit.cells, solve_near((fit.model, fit.cells, (fit.warm_start,), own)), own)
    return float(beside.bic - gain_of_batches(beside, search.criteria))


def _explains(search: EffectSearch, fit: Fit) -> bool:
    return passes(fit, search.criteria) and worth({**search.fits, fit.effects: fit}, fit.effects, (), search.criteria)


def _clearly_better(search: EffectSearch, fit: Fit, picked: float = 0.0) -> bool:
    """Whether a set fits clearly better than under the usual convention, by the price of having been ``picked``, too.

    One that leaves nothing takes its place with a number that nobody believes, too: it is no claim, but may be
    ``partial``.
    """
    usual = search.fits.get(fit.effects)
    price = search.criteria.clearly + picked * overdispersion(fit)
    gains = usual is None or fit.bic < usual.bic - price
    return gains and (sound(fit) or leaves_nothing(fit, search.criteria))


def _seen(search: EffectSearch, fit: Fit) -> bool:
    """Whether more than one observable sees what the convention changes."""
    stages = {effect.stage for effect in fit.model.effects if effect.variant}
    return not stages <= {"step", "speed"} or sum(one.name in search.cells.observables for one in ALONG) > 1


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
    """Each single effect under each other convention; those of a gait's phases where it has two."""
    return [
        model_of(search.base, (name,), {**search.effects, name: variant}, search.cells.robot)
        for name in search.names
        for variant in _to_be_tried(search, name)
    ]


def _to_be_tried(search: EffectSearch, name: str) -> list[Variant]:
    """An effect's other conventions; those of a gait's phases where it has two."""
    one_rate = search.cells.clock.one_rate.all()
    return [variant for variant in variants_of(search.effects[name]) if not (one_rate and variant.of_phases)]


def _near(
    search: EffectSearch, models: Sequence[Model], hopeless: float = np.inf, also: tuple[WarmStart, ...] = ()
) -> list[Fit]:
    """Sets under another convention, near their best smaller set, near where the usual one has come to, if that gains,
    and where they begin ``also``: a threshold is not found from far away, and what explains as much as a claim does
    stands on ground as stiff. What is above a deviance that is ``hopeless`` at once is left there.
    """
    tasks = []
    for model in models:
        usual = search.fits.get(model.identifiers)
        smaller = min((search.fits[part] for part in parts_of(model.identifiers, search.fits)), key=_deviance)
        gains = usual is not None and smaller.deviance - usual.deviance > search.criteria.claim
        starts = (smaller.warm_start, *((usual.warm_start,) if usual and gains else ()), *also)
        tasks.append((model, search.cells, starts, None, hopeless))
    points = search.fit_all(solve_near_unless_hopeless, tasks)
    return search.believable(models, points)


def _deviance(fit: Fit) -> float:
    return fit.deviance
