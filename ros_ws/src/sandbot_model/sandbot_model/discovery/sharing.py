"""A verdict that survives what trials share: offsets of the bed by batch, drift, a lift zero, a speed scale.

The search is made without them. What it claims is then tried again beside nuisances with priors (``Criteria`` and the
cameras' ``accuracy``), and so is a base model that was refused: an effect is claimed only if it still earns its place.
σ_b is that about the larger set, so that a missing effect is not taken for a bed that scatters. Offsets that correlate
with φ, ω or run order do not count as scatter. What the verdict names is reported as fitted beside the nuisances: its
standard errors hold them all.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from sandbot_model.data.distributions import chi2_sf, f_isf
from sandbot_model.discovery.batch_sd import ALIKE, BATCH, BATCH_SCALE, BATCH_ZERO, READINGS, BatchSd, granted, priors
from sandbot_model.discovery.criteria import Criteria
from sandbot_model.discovery.effect_search import EffectSearch, Names
from sandbot_model.discovery.nuisances_about import batches_apart, gain_of_batches, shared_by
from sandbot_model.discovery.nuisances_in_words import WORDS, significant
from sandbot_model.discovery.structure import at_random
from sandbot_model.discovery.verdict import (
    Verdict,
    claim,
    gains,
    judge,
    leaves_nothing,
    overdispersion,
    parts_of,
    picked_from,
    sound,
    worth,
)
from sandbot_model.fitting.fit import Fit, fitted_at
from sandbot_model.fitting.global_minimum import far_above, solve_from, solve_near, solve_with_nuisances
from sandbot_model.fitting.profile import lowest_along

LEADING = 6
"""Larger sets that are tried again, the best."""
PASSES = 2
"""How often a set is fitted: again with how well its offsets are known."""
GAINED = 0.5
"""Fall of the deviance that makes a fit better than another."""
ROUGH = 1.5
"""Scatter of a bed that is taken for rough, over its prior."""
OWN = 2
"""Unknowns that take up offsets of batches: their mean by k, a trend over ω by Δt."""
FAR_OFF = 4.0
"""Standard deviations of its prior from which a reading off its zero or scale is no explanation."""


@dataclass(frozen=True)
class Shared:
    """A verdict and its fits beside what trials share."""

    verdict: Verdict
    fits: dict[Names, Fit]
    named: Fit
    """The set that the verdict names, or the base model, beside the nuisances."""


def reconsidered(search: EffectSearch, plain: Verdict) -> Shared | None:
    """The verdict beside what trials share; None where nothing repairs the base model.

    Few effects are tried before many: the best of hundreds of pairs takes a share of any scatter for its own. What was
    claimed stands if each of its effects earns its place beside as much scatter: that fewer pass a test of all at once
    says less. Where readings off their zero or scale are enough, the bed does not scatter.
    """
    if plain.status == "adequate":
        apart = batches_apart(search.fits[()], search.criteria)
        found = _beside(search, plain, 0, apart) if apart else None
        return found or _standing(search, plain, _refitted(search, [()], ALIKE)[()])
    for size in range(1, 1 + max(1, *map(len, search.fits))):
        if found := _of_size(search, plain, size):
            stands = found.verdict.status != "identified" or _beats_scatter(search, found.verdict.effects)
            return found if stands else _beside(search, plain, size, _apart_about(search, search.fits[()])) or found
        if size == 1 and (rough := _no_worse_than_rough(search, plain)):
            return rough
    if not plain.effects:
        return None
    # No credible alternative to the claim was found: the claim stands, refitted beside the nuisances.
    named = _refitted(search, [plain.effects], ALIKE)[plain.effects]
    return _bought(search, plain) or _standing(search, plain, named)


def _bought(search: EffectSearch, plain: Verdict) -> Shared | None:
    """The refusal of a claim, if in each of its sets an effect does nothing beside nuisances but to bring a number of
    another back to where it is believed."""
    fits, parts = dict(_refitted(search, [()], ALIKE)), set[Names]()
    for names in plain.alternatives:
        there = _refitted(search, [names, *parts_of(names, search.fits)], ALIKE)
        there |= _smaller_from(there, names, search.criteria, ALIKE)
        own = [part for part in parts_of(names, there) if part and _does_as_well(there, names, part, search.criteria)]
        if not own:
            return None
        fits, parts = fits | there, parts | set(own)
    verdict = judge({(): fits[()]} | {part: fits[part] for part in parts}, search.criteria)
    return Shared(verdict, search.fits, search.fits[()]) if verdict.status == "unexplained" else None


def _does_as_well(fits: Mapping[Names, Fit], names: Names, part: Names, criteria: Criteria) -> bool:
    """Whether a part of a set leaves nothing that the set could gain, beside nuisances that can be."""
    enough = leaves_nothing(fits[part], criteria) and not gains(fits, names, part, criteria)
    return enough and _believable(fits[part], criteria) and at_random(fits[part], criteria)


def refitted_globally(fit: Fit) -> Fit:
    """The same set beside its nuisances where a search of everywhere comes to, if that is lower: where legs meet what
    their predecessors left, a fit without offsets begins in another valley."""
    if fit.nuisances is None or not fit.model.walker.remembers:
        return fit
    point = solve_with_nuisances((fit.model, fit.cells, None, fit.nuisances))
    found = fitted_at(fit.model, fit.cells, point, fit.nuisances)
    return min(fit, found, key=lambda fit: fit.deviance)


def as_granted(search: EffectSearch, found: Shared) -> dict[Names, Fit]:
    """The claim, what is in it and the base model, each beside all that the claim takes for granted."""
    claimed = found.verdict.effects
    sets = {(), claimed, *((name,) for name in claimed)}
    return _refitted(search, [names for names in search.fits if names in sets], granted(found.named))


def at_priors(search: EffectSearch, sets: Sequence[Names]) -> dict[Names, Fit]:
    """Sets beside all that trials may share; batches that are told are as far apart as they are believed to be."""
    told = search.cells.batch_share is not None
    return _refitted(search, sets, priors(search.fits[()], search.criteria) if told else ALIKE)


def bends(fit: Fit) -> bool:
    """Whether a fit takes for granted that beside which an effect in a shape of its own can be bent to nearly anything:
    a zero or a scale of each batch or, where no batches are told, a k of each condition."""
    if fit.nuisances is None:
        return False
    offsets = set(READINGS) if fit.cells.batch_share is not None else {*READINGS, BATCH}
    return not offsets.isdisjoint(fit.nuisances.names)


def nuisances_suffice(search: EffectSearch, size: int) -> bool:
    """Whether what trials share repairs a set of up to ``size`` effects, and no further effect is worth its place."""
    found = reconsidered(search, judge(search.fits, search.criteria))
    # A larger one that passes was found beyond the best of this size: its rivals have not been tried yet.
    if found is None or len(found.verdict.effects) > size:
        return False
    named = found.named
    larger = search.extended(named.effects)
    beside = [named, *search.near([search.model(names) for names in larger], named)]
    fits = found.fits | {fit.effects: fit for fit in beside}
    return not any(worth(fits, names, named.effects, search.criteria) for names in larger)


def _of_size(search: EffectSearch, plain: Verdict, size: int) -> Shared | None:
    """The verdict among sets of up to ``size`` effects; None where it is no better."""
    claimed = len(plain.effects) == size
    apart = _apart_about(search, search.fits[plain.effects] if claimed else _best(search, size))
    if claimed and (survivor := _if_still_earned(search, plain.effects, apart)):
        return Shared(plain, search.fits, survivor)
    found = _readings(search, plain, apart) or _beside(search, plain, size, apart)
    larger = found is not None and len(plain.effects) > len(found.verdict.effects) and not claimed
    survivor = (
        _if_still_earned(search, plain.effects, apart) or _without_scatter(search, plain.effects) if larger else None
    )
    return Shared(plain, search.fits, survivor) if survivor else found


def _standing(search: EffectSearch, plain: Verdict, named: Fit) -> Shared:
    """The verdict that was, with the readings that are seen to be off."""
    off = significant(named)
    because = f"{plain.because}, beside {' and '.join(off)}" if off else plain.because
    return Shared(replace(plain, because=because), search.fits, named)


def _readings(search: EffectSearch, plain: Verdict, apart: BatchSd) -> Shared | None:
    """The base model alone beside readings off their zero or scale, where a bed that scatters need not be granted.

    It is where it is clearly there all the same, and the base model passes beside it: k would be known too well.
    """
    if not apart or judge(_refitted(search, [()], ALIKE), search.criteria).status != "adequate":
        return None
    found = _beside(search, plain, 1, ALIKE)
    if found is None or found.verdict.status != "adequate":
        return None
    there = batches_apart(found.named, search.criteria)
    rough = _beside(search, plain, 1, there) if there else None
    return rough if rough and rough.verdict.status == "adequate" else found


def _apart_about(search: EffectSearch, fit: Fit) -> BatchSd:
    """How far batches differ about a set, and again about where it comes to once that much is granted."""
    apart = batches_apart(fit, search.criteria)
    if not apart:
        return ALIKE
    there = _refitted(search, [fit.effects], apart)[fit.effects]
    # Beside offsets and without them: where cells walk or swim by chance, these may be what takes the bed for rough.
    bare = fitted_at(fit.model, fit.cells, there.point)
    found = batches_apart(there, search.criteria)
    # Far above where the set came to without offsets, what it misses is cells on the wrong side of a switch.
    return found if bare.deviance > far_above(fit.deviance) else found.or_more(batches_apart(bare, search.criteria))


def _best(search: EffectSearch, size: int) -> Fit:
    return next(filter(sound, search.ranked(size)), search.fits[()])


def _beside(search: EffectSearch, plain: Verdict, size: int, apart: BatchSd) -> Shared | None:
    """The verdict beside nuisances among sets of up to ``size`` effects; None where it is no better."""
    fits = _refitted(search, _leading(search, plain, size), apart)
    if judge(fits, search.criteria).status == "unexplained":
        return None
    fits |= _refitted(search, [names for names in search.fits if len(names) == 1], apart)
    verdict = judge(fits, search.criteria)
    while verdict.effects and (lower := _smaller_from(fits, verdict.effects, search.criteria, apart)):
        fits |= lower
        verdict = judge(fits, search.criteria)
    named = fits[verdict.effects]
    if verdict.status == "unexplained" or not (
        _believable(named, search.criteria) and at_random(named, search.criteria)
    ):
        return None
    if plain.status == "adequate" != verdict.status:
        return None
    return Shared(_with_nuisances(verdict, plain, named, apart, search.criteria), fits, named)


def _if_still_earned(search: EffectSearch, names: Names, apart: BatchSd) -> Fit | None:
    """A set beside the nuisances, where every effect of it still earns its place."""
    parts = parts_of(names, search.fits)
    fits = _refitted(search, [names, *parts], apart)
    fits |= _smaller_from(fits, names, search.criteria, apart)
    return fits[names] if all(worth(fits, names, part, search.criteria) for part in parts) else None


def _beats_scatter(search: EffectSearch, names: Names) -> bool:
    """Whether each effect of a set explains more, by its price, than a bed that scatters as suits what is left.

    Asked where each batch holds whole conditions, one or (one frequency a day) several: an effect that follows what
    sets them apart may be nothing but their offsets.
    """
    share = search.cells.batch_share
    if share is None or share.max(axis=1).min() < 1.0:
        return True
    fits = _refitted(search, [names, *parts_of(names, search.fits)], ALIKE)
    return _lead_over_scatter(search, names, fits) > _price(fits[names], share.shape[1], search.criteria)


def _without_scatter(search: EffectSearch, names: Names) -> Fit | None:
    """A set about which the bed does not scatter, where a bed that does explains clearly less than each of its effects.

    A deviance beside an offset for every condition says how little is left, not how many offsets that took: a missing
    effect may hide in them. Their likelihood (``gain_of_batches``) says both.
    """
    if (fit := _if_still_earned(search, names, ALIKE)) is None or batches_apart(fit, search.criteria):
        return None
    fits = _refitted(search, [names, *parts_of(names, search.fits)], ALIKE)
    price = claim(fit, search.criteria) + picked_from(len(search.fits))
    return fit if _lead_over_scatter(search, names, fits) > price else None


def _lead_over_scatter(search: EffectSearch, names: Names, fits: Mapping[Names, Fit]) -> float:
    """By how much each effect of a set, at least, explains more than a bed that scatters, in -2 ln of the posterior."""
    left = {one: fit.deviance - gain_of_batches(fit, search.criteria) for one, fit in fits.items()}
    return min((left[part] - left[names] for part in parts_of(names, fits)), default=0.0)


def _no_worse_than_rough(search: EffectSearch, plain: Verdict) -> Shared | None:
    """The base model on a bed as rough as it shows, where it leaves nothing on a smoother one either, and what gains
    there is not to be believed and explains no more than the bed."""
    criteria, apart = search.criteria, _apart_about(search, _best(search, 1))
    fits = _refitted(search, _leading(search, plain, 1), apart)
    helpful = [names for names in fits if len(names) == 1 and gains(fits, names, (), criteria)]
    explained = leaves_nothing(fits[()], criteria) and helpful
    if not explained or any(sound(fits[names]) or _beats_scatter(search, names) for names in helpful):
        return None
    found = _beside(search, plain, 1, _apart_about(search, search.fits[()]))
    return found if found and found.verdict.status == "adequate" else None


def _price(fit: Fit, batches: int, criteria: Criteria) -> float:
    """What an effect must gain beside a bed that scatters: the claim, and more where few batches tell how far it does.

    Student's t in place of the normal distribution, its likelihood ratio (d + 1) ln(1 + t²/d).
    """
    freedom = max(batches - OWN, 1)
    square = f_isf(chi2_sf(criteria.claim, 1), 1, freedom)
    ratio = (freedom + 1) * np.log1p(square / freedom)
    return float(max(claim(fit, criteria), ratio * overdispersion(fit)))


def _smaller_from(fits: dict[Names, Fit], names: Names, criteria: Criteria, apart: BatchSd) -> dict[Names, Fit]:
    """Sets with one effect less that fit better than so far.

    They are tried near where the larger set has come to, and along each of their parameters where ground remembers.
    """
    found, larger = {}, fits[names]
    assert larger.nuisances is not None
    for part in parts_of(names, fits):
        before = fits[part]
        own = replace(shared_by(before, criteria, apart), initial=larger.nuisances.initial)
        point = solve_near((before.model, before.cells, (larger.warm_start,), own))
        better = min(before, fitted_at(before.model, before.cells, point, own), key=lambda fit: fit.deviance)
        if before.model.walker.remembers and better.deviance < far_above(larger.deviance):
            # Its deviance is a bumpy plain: what an effect gains may be no more than another bump.
            better = lowest_along(better)
        if better.deviance < before.deviance - GAINED:
            found[part] = better
    return found


def _leading(search: EffectSearch, plain: Verdict, most: int) -> list[Names]:
    """The base model, the best sets of each size and those named, with all that is in them."""
    found = {names for names in plain.alternatives if len(names) <= most}
    for size in range(1, most + 1):
        found |= {fit.effects for fit in search.ranked(size)[:LEADING]}
    parts = {part for names in found for size in range(len(names)) for part in combinations(names, size)}
    return sorted((found | parts | {()}) & set(search.fits), key=len)


def _refitted(search: EffectSearch, sets: Sequence[Names], apart: BatchSd) -> dict[Names, Fit]:
    """Sets fitted before, with nuisances; those that began at the same fits before are not fitted again."""
    rough = (_on_rough_ground(search),) if apart[BATCH] else ()
    begun = {names: (apart, *_origins(search, names), *rough) for names in sets}
    new = [names for names in begun if begun[names] not in search.beside]
    for names, fit in zip(new, _settled(search, {names: begun[names][1:] for names in new}, apart), strict=True):
        search.beside[begun[names]] = fit
    return {names: search.beside[start] for names, start in begun.items()}


def _settled(search: EffectSearch, begun: Mapping[Names, tuple[Fit, ...]], apart: BatchSd) -> list[Fit]:
    """The same sets where they come to beside nuisances from these fits, never above where they were."""
    fits = [search.fits[names] for names in begun]
    origins = [tuple(fit.warm_start for fit in some) for some in begun.values()]
    for again in range(PASSES):
        own = [shared_by(fit, search.criteria, apart) for fit in fits]
        starts = [fit.point for fit in fits] if again else origins
        tasks = [(fit.model, fit.cells, *at) for fit, *at in zip(fits, starts, own, strict=True)]
        points = search.fit_all(solve_from if again else solve_near, tasks)
        found = [fitted_at(fit.model, fit.cells, *at) for fit, *at in zip(fits, points, own, strict=True)]
        stayed = [fitted_at(fit.model, fit.cells, fit.point, at) for fit, at in zip(fits, own, strict=True)]
        fits = [min(both, key=lambda fit: fit.deviance) for both in zip(found, stayed, strict=True)]
    return fits


def _origins(search: EffectSearch, names: Names) -> tuple[Fit, ...]:
    """A set's fit, and that of the best with one effect less: with nuisances the effect may have nothing left to do."""
    smaller = [search.fits[part] for part in parts_of(names, search.fits)]
    return (search.fits[names], *sorted(smaller, key=lambda part: part.deviance)[:1])


def _on_rough_ground(search: EffectSearch) -> Fit:
    """The base model where a search of everywhere comes to if replicates of a condition share what k is off by.

    Without that, conditions that walk or swim for what their batch is off by pull k and Δt into other valleys, from
    which no offset leads back.
    """
    if search.rough is None:
        plain = search.fits[()]
        own = shared_by(plain, search.criteria).with_k_scatter(ROUGH * search.criteria.bed_scatter)
        point = solve_with_nuisances((plain.model, plain.cells, None, own))
        search.rough = fitted_at(plain.model, plain.cells, point, own)
    return search.rough


def _with_nuisances(verdict: Verdict, plain: Verdict, fit: Fit, apart: BatchSd, criteria: Criteria) -> Verdict:
    """The verdict with what it takes for granted, and what would be said otherwise."""
    words = _differing(fit, apart, criteria) + significant(fit)
    named = f"{plain.status}: {' + '.join(plain.effects)}" if plain.effects else plain.status
    taken = " and ".join(words) or "a drift that these data can't show"
    because = f"{verdict.because}, granted {taken}"
    if plain.status != verdict.status or plain.effects != verdict.effects:
        because = f"{because}; without that the verdict would be {named}"
    return replace(verdict, because=because)


def _differing(fit: Fit, apart: BatchSd, criteria: Criteria) -> list[str]:
    """What is taken for granted of how batches differ."""
    kind, prior = "condition" if fit.cells.batch_share is None else "batch", priors(fit, criteria)
    words = {
        BATCH: f"k that scatters by {apart[BATCH]:.2%} from {kind} to {kind} (prior {prior[BATCH]:.1%})",
        BATCH_ZERO: f"a lift zero that scatters by {1e3 * apart[BATCH_ZERO]:.2g} mm from batch to batch "
        f"(prior {1e3 * prior[BATCH_ZERO]:.1g} mm)",
        BATCH_SCALE: f"a speed scale that scatters by {apart[BATCH_SCALE]:.2%} from batch to batch "
        f"(prior {prior[BATCH_SCALE]:.1%})",
    }
    return [words[name] for name in apart.names]


def _believable(fit: Fit, criteria: Criteria) -> bool:
    """Whether drift, zeros and scales are within what their priors can mean, those of each batch as well."""
    assert fit.nuisances is not None
    prior = priors(fit, criteria)
    of_batch = {name: prior[name] for name in READINGS}
    named = zip(fit.nuisances.names, fit.nuisances.sd, fit.shared, strict=True)
    return all(
        abs(value) < FAR_OFF * of_batch.get(name, sd) for name, sd, (value, _) in named if name in {*WORDS, *of_batch}
    )
