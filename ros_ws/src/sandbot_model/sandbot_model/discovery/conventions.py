"""Effects under other conventions (``physics.variants``): as rivals of a claim, and where no set of the catalogue fits.

Rivals of a claim (``admit_rivals``): all single effects are fitted under all conventions. As each was selected from
dozens, and some contain the claim's formula as a limiting case (a slip that spares the peak is an overlap if it is the
same at all depths), a rival must have the better BIC after a penalty for the selection. Then both are named, or the
rival alone if it is clearly better (``verdict.judge``). A bed of another depth than robot.yaml says is not such a
selection: it is named beside the claim if it explains about as much.

Where no set fits: ``try_single_effects``, then ``try_beside_the_leader``, then ``try_within_pairs``, each of which puts
clearly better conventions in the place of the catalogue's.

A convention that changes a step, but not how deep legs go, shows only along the track. If only the mean speed was
measured there, such conventions cannot be distinguished, and none is claimed.
"""

import math
from collections.abc import Callable, Hashable, Iterable, Sequence
from functools import partial

import numpy as np

from sandbot_model.discovery.batch_sd import batch_sd_of
from sandbot_model.discovery.effect_search import EffectSearch, once_per_search
from sandbot_model.discovery.nuisances_about import ALONG, gain_of_batches, nuisances_for
from sandbot_model.discovery.verdict import (
    claim_threshold,
    earns_place,
    leaves_nothing,
    overdispersion,
    parts_of,
    passes,
    selection_penalty,
    sound,
)
from sandbot_model.fitting.errors import with_sampled_errors
from sandbot_model.fitting.fit import Fit, fitted_at, refitted
from sandbot_model.fitting.global_minimum import WarmStart, far_above, solve, solve_near_unless_hopeless
from sandbot_model.physics.model import Model, model_of
from sandbot_model.physics.variants import BY_ITS_TILT, IN_ANOTHER_BED, Variant, variants_of

PAIRS = 3
"""Pairs, the best by BIC, that are tried under other conventions."""
NEXT = 3
"""Other families that are compared with a claim beside its nuisances, the best by BIC."""
CLOSER = 8
"""Single effects under other conventions, the best by deviance, that also get a global search."""


def try_single_effects(search: EffectSearch) -> bool:
    """Give single effects their best convention where it fits clearly better than the usual one, or is plausible where
    that is not, also after the penalty for having been selected from all; whether there is any. Each is fitted from
    warm starts, the best of them then globally.
    """
    tried = singles(search)
    picked = selection_penalty(len(tried))
    better = [
        fit
        for fit in tried
        if BY_ITS_TILT not in fit.variants.values()
        and _is_identifiable(search, fit)
        and search.fits[()].deviance - fit.deviance
        > claim_threshold(fit, search.criteria) + picked * overdispersion(fit)
        and (_clearly_better(search, fit) or _plausible_instead(search, fit))
    ]
    return _adopt(search, better)


def try_beside_the_leader(search: EffectSearch) -> bool:
    """Add each effect to the best single one, if that is under another convention; whether any pair fits clearly better
    than with the usual convention."""
    leader = search.ranked(1)[0]
    if not leader.variants:
        return False
    own = {**search.effects, leader.effects[0]: leader.model.effects[0]}
    sets = search.extended(leader.effects)
    found = _near(search, [model_of(search.base, names, own, search.cells.robot) for names in sets])
    return _adopt(search, list(filter(partial(_clearly_better, search), found)))


def try_within_pairs(search: EffectSearch) -> bool:
    """Try the best pairs with one effect under another convention; whether any fits clearly better than with the usual
    one, after the penalty for having been selected from all."""
    models = [
        model_of(search.base, pair.effects, {**search.effects, name: variant}, search.cells.robot)
        for pair in search.ranked(2)[:PAIRS]
        for name in pair.effects
        for variant in _applicable_variants(search, name)
    ]
    better = partial(_clearly_better, search, picked=selection_penalty(len(models)))
    return _adopt(search, list(filter(better, _near(search, models))))


def _adopt(search: EffectSearch, better: Sequence[Fit]) -> bool:
    """Replace the usual fits by the best of each set, and refit the best of all globally; whether there are any.

    One with implausible parameters must be clearly better than one without.
    """

    def badness(fit: Fit) -> float:
        return fit.bic + (0.0 if sound(fit) else search.criteria.clearly * overdispersion(fit))

    search.fits |= {fit.effects: fit for fit in sorted(better, key=badness, reverse=True)}
    if better:
        best = min(better, key=badness)
        global_fit = fitted_at(best.model, search.cells, solve((best.model, search.cells, best.warm_start)))
        search.fits[best.effects] = min(best, global_fit, key=badness)
    return bool(better)


def admit_rivals(search: EffectSearch, claimed: Fit) -> bool:
    """Add single effects under other conventions to the fits if they show no lack of fit and speak against a claim.

    Against a claim of several effects, themselves selected, a rival need only be better. Against a single effect it
    must be better after the penalty for its selection; the claimed effect then gets its own best convention, too. Claim
    and rival are compared without nuisances and with them. Returns whether there are any rivals.
    """
    # Geometric mean with the base model: a first descent of an effect that fits may still end this high.
    hopeless = max(far_above(claimed.deviance, 1.0), math.sqrt(claimed.deviance * search.fits[()].deviance))
    tried = _near(search, _single_effect_models(search), hopeless, (claimed.warm_start,))
    picked = 0.0 if len(claimed.effects) > 1 else selection_penalty(len(tried))

    def leads(fit: Fit, bic: float, claims: float) -> bool:
        lead = -search.criteria.clearly if IN_ANOTHER_BED in fit.variants.values() else picked
        return bic < claims - lead * overdispersion(claimed)

    better = [fit for fit in tried if leads(fit, fit.bic, claimed.bic) and _explains(search, fit)]
    if better:
        claims = _bic_with_nuisances(search, claimed)
        better = [fit for fit in better if leads(fit, _bic_with_nuisances(search, fit), claims)]
    if all(fit.effects == claimed.effects for fit in better):
        return False
    search.fits |= {fit.effects: fit for fit in sorted(better, key=lambda fit: -fit.bic)}
    return True


def other_families(search: EffectSearch, claimed: Fit, named: Fit) -> list[Fit]:
    """The best of those tried under other conventions in the place of a claim, one for each set, at plausible
    parameters and with the nuisances of ``named``."""
    others = [fit for fit in search.tried if fit.effects != claimed.effects and sound(fit)]
    return _fitted_like(search, named, _best_of_each(others, lambda fit: fit.effects)[:NEXT])


def same_family(search: EffectSearch, claimed: Fit, named: Fit) -> list[Fit]:
    """The fits of a named effect under other conventions that show no lack of fit and are not clearly worse, with the
    nuisances of ``named``: any of them may be true. The catalogue's, if plausible, is doubted only for a better fit."""
    doubted = bool(claimed.variants) or not sound(claimed)
    most = claimed.bic + search.criteria.clearly * overdispersion(claimed) * doubted
    others = [
        fit
        for fit in search.tried
        if fit.effects == claimed.effects and fit.variants != claimed.variants and fit.bic < most and not fit.model.held
    ]
    near = _best_of_each(others, lambda fit: tuple(fit.variants.items()))
    return [with_sampled_errors(fit) for fit in _fitted_like(search, named, near) if passes(fit, search.criteria)]


def _best_of_each(fits: Iterable[Fit], key: Callable[[Fit], Hashable]) -> list[Fit]:
    """Of fits with the same key the best, in order of BIC."""
    best: dict[Hashable, Fit] = {}
    for fit in sorted(fits, key=lambda fit: fit.bic):
        best.setdefault(key(fit), fit)
    return list(best.values())


def _fitted_like(search: EffectSearch, named: Fit, fits: Sequence[Fit]) -> list[Fit]:
    """The same sets, with nuisances if ``named`` has them."""
    if named.nuisances is None:
        return list(fits)
    batch_sd = batch_sd_of(named)
    own = [nuisances_for(fit, search.criteria, batch_sd) for fit in fits]
    return search.solved([(fit.model, fit.cells, (fit.warm_start,), at) for fit, at in zip(fits, own, strict=True)])


def conventions(fits: Sequence[Fit]) -> dict[str, str]:
    """The convention of each effect of these fits that is not under the catalogue's."""
    return {name: variant for fit in fits for name, variant in fit.variants.items()}


def _bic_with_nuisances(search: EffectSearch, fit: Fit) -> float:
    """BIC with nuisances, less the gain by scatter of the bed as estimated about this fit: an effect that needs a rough
    bed explains less."""
    found = refitted(fit, nuisances_for(fit, search.criteria))
    return float(found.bic - gain_of_batches(found, search.criteria))


def _explains(search: EffectSearch, fit: Fit) -> bool:
    fits = {**search.fits, fit.effects: fit}
    return passes(fit, search.criteria) and earns_place(fits, fit.effects, (), search.criteria)


def _clearly_better(search: EffectSearch, fit: Fit, picked: float = 0.0) -> bool:
    """Whether a set fits clearly better than under the usual convention, with ``picked`` as penalty for its selection.

    One without lack of fit may also have implausible parameters: it cannot be claimed, but may be ``partial``.
    """
    usual = search.fits.get(fit.effects)
    margin = search.criteria.clearly + picked * overdispersion(fit)
    gains = usual is None or fit.bic < usual.bic - margin
    return gains and (sound(fit) or leaves_nothing(fit, search.criteria))


def _plausible_instead(search: EffectSearch, fit: Fit) -> bool:
    """Whether a set shows no lack of fit at plausible parameters, where under the usual convention they are implausible
    and it fits no clearly better."""
    usual, margin = search.fits[fit.effects], search.criteria.clearly * overdispersion(fit)
    return not sound(usual) and passes(fit, search.criteria) and fit.bic < usual.bic + margin


def _is_identifiable(search: EffectSearch, fit: Fit) -> bool:
    """Whether more than one observable depends on what the convention changes."""
    stages = {effect.stage for effect in fit.model.effects if effect.variant}
    along = [observable for observable in ALONG if observable.name in search.cells.observables]
    return not stages <= {"step", "speed"} or len(along) > 1


@once_per_search
def singles(search: EffectSearch) -> list[Fit]:
    """All single effects under all other conventions."""
    near = _near(search, _single_effect_models(search))
    found = any(passes(fit, search.criteria) for fit in near)
    return near if found else _searched_globally(search, near)


def _searched_globally(search: EffectSearch, near: Sequence[Fit]) -> list[Fit]:
    """The same fits, the best of them searched globally: warm starts may lie in the basin of another minimum."""
    ranked = sorted(near, key=_deviance)
    best, rest = ranked[:CLOSER], ranked[CLOSER:]
    points = search.fit_all(solve, [(fit.model, search.cells, fit.warm_start) for fit in best])
    found = search.fits_with_plausible_delta_t([fit.model for fit in best], points)
    search.tried += found
    return [*(min(both, key=_deviance) for both in zip(best, found, strict=True)), *rest]


def _single_effect_models(search: EffectSearch) -> list[Model]:
    """Models of each single effect under each applicable convention."""
    return [
        model_of(search.base, (name,), {**search.effects, name: variant}, search.cells.robot)
        for name in search.names
        for variant in _applicable_variants(search, name)
    ]


def _applicable_variants(search: EffectSearch, name: str) -> list[Variant]:
    """An effect's other conventions; those about the phases of a gait only where it has two."""
    one_rate = search.cells.clock.one_rate.all()
    return [variant for variant in variants_of(search.effects[name]) if not (one_rate and variant.of_phases)]


def _near(
    search: EffectSearch, models: Sequence[Model], hopeless: float = np.inf, also: tuple[WarmStart, ...] = ()
) -> list[Fit]:
    """Sets under another convention, fitted from warm starts: their best part, the fit under the usual convention, if
    that gains, and ``also``. Thresholds are not found from far away, and a rival of a claim has a similar k. Fits whose
    first descent ends above the deviance ``hopeless`` are not refined.
    """
    tasks = []
    for model in models:
        usual = search.fits.get(model.identifiers)
        smaller = min((search.fits[part] for part in parts_of(model.identifiers, search.fits)), key=_deviance)
        gains = usual is not None and smaller.deviance - usual.deviance > search.criteria.claim
        starts = (smaller.warm_start, *((usual.warm_start,) if usual and gains else ()), *also)
        tasks.append((model, search.cells, starts, None, hopeless))
    points = search.fit_all(solve_near_unless_hopeless, tasks)
    found = search.fits_with_plausible_delta_t(models, points)
    search.tried += found
    return found


def _deviance(fit: Fit) -> float:
    return fit.deviance
