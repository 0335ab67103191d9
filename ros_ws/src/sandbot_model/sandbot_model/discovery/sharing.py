"""The verdict revised with nuisances that trials share: bed offsets by batch, drift, zero of the lift, speed scale.

The search fits every set without nuisances, and ``judge`` draws a first verdict from these fits. Then:

1. A base model that was adequate is refitted with nuisances, and stays adequate.
2. Otherwise sets of one effect are considered, then sets of two, and so on: the best of hundreds of pairs absorbs part
   of any scatter. The spread of the batches is estimated about the larger set, so that a missing effect is not mistaken
   for scatter of the bed, and the leading sets are refitted with nuisances (priors: ``Criteria``, ``accuracy`` of the
   cameras).
   a. The claim stands if each of its effects still earns its place and, if trials were run in order of ω or φ, no other
      set explains as much.
   b. Otherwise the refitted sets are judged. Their verdict replaces the first if it explains the data with nuisances
      within their priors and with batch offsets that look random (``structure``).
   Either way, an identified effect must explain more than scatter of the bed would; else scatter is assumed instead.
3. If no size yields a verdict, the claim stands, unless one of its effects only keeps another's parameter plausible.

The named set is reported as refitted, so that its standard errors include the nuisances.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from sandbot_model.data.distributions import chi2_sf, f_isf
from sandbot_model.discovery.batch_sd import (
    ALIKE,
    BATCH,
    BATCH_SCALE,
    BATCH_ZERO,
    READINGS,
    BatchSd,
    batch_sd_of,
    priors,
)
from sandbot_model.discovery.criteria import Criteria
from sandbot_model.discovery.effect_search import EffectSearch, once_per_search
from sandbot_model.discovery.nuisances_about import estimated_batch_sd, gain_of_batches, nuisances_for, run_in_order_of
from sandbot_model.discovery.nuisances_in_words import WORDS, significant
from sandbot_model.discovery.residual import SuggestedFormula
from sandbot_model.discovery.structure import at_random
from sandbot_model.discovery.verdict import (
    Names,
    Verdict,
    claim_threshold,
    earns_place,
    either,
    gains_enough,
    judge,
    leaves_nothing,
    overdispersion,
    parts_of,
    selection_penalty,
    sound,
)
from sandbot_model.fitting.fit import Fit, fitted_at, refitted
from sandbot_model.fitting.global_minimum import far_above, solve_from, solve_near, solve_with_nuisances
from sandbot_model.fitting.nuisances import Nuisances
from sandbot_model.fitting.profile import lowest_along

LEADING = 6
"""Number of sets of each size, the best by BIC, that are refitted with nuisances."""
PASSES = 2
"""Fits of each set: the second uses the precision of the batch offsets in the first."""
LEAST_GAIN = 0.5
"""Decrease of the deviance from which a fit replaces an earlier one."""
NEAREST = 2
"""Number of rivals that are refitted from a claim of several effects with offsets of k."""
ROUGH_FACTOR = 1.5
"""Scatter of a rough bed, in units of its prior."""
ABSORBED = 2
"""Parameters that absorb batch offsets: k takes up their mean, Δt a trend over ω."""
FAR_OFF = 4.0
"""Prior standard deviations from which a zero, scale or drift is no longer accepted as an explanation."""


@dataclass(frozen=True)
class Judged:
    """A verdict and the fits that it rests on, with nuisances where these were needed."""

    verdict: Verdict
    fits: dict[Names, Fit]
    named: Fit
    """The set that the verdict names, or else the base model, refitted with nuisances."""
    formula: SuggestedFormula | None = None
    """The formula for which a claim was refused."""

    @classmethod
    def of(cls, search: EffectSearch, verdict: Verdict) -> "Judged":
        """A verdict on the fits of a search as they are."""
        return cls(verdict, search.fits, search.fits[verdict.effects])


def judged_with_nuisances(search: EffectSearch, plain: Verdict) -> Judged | None:
    """The verdict with nuisances, by the steps above; None where no set explains the data even with them.

    A claim whose effects all earn their place is not overturned by a smaller set that passes the lack-of-fit test: that
    test is the weaker evidence. Where calibration errors suffice, no scatter of the bed is assumed.
    """
    if plain.status == "adequate":
        batch_sd = estimated_batch_sd(search.fits[()], search.criteria)
        found = _judged_with_batch_sd(search, plain, 0, batch_sd) if batch_sd else None
        return found or _confirmed(search, plain, _refitted(search, [()], ALIKE)[()])
    for size in range(1, 1 + max(1, *map(len, search.fits))):
        if found := _verdict_up_to_size(search, plain, size):
            if found.verdict.status != "identified" or _beats_scatter(search, found.verdict.effects):
                return found
            return _judged_with_batch_sd(search, plain, size, _batch_sd_about(search, search.fits[()])) or found
        if size == 1 and (rough := _base_with_scatter(search, plain)):
            return rough
    if not plain.effects:
        return None
    # No credible alternative to the claim was found: the claim stands, refitted with nuisances.
    named = _refitted(search, [plain.effects], ALIKE)[plain.effects]
    return _refused_if_parts_suffice(search, plain) or _confirmed(search, plain, named)


def _refused_if_parts_suffice(search: EffectSearch, plain: Verdict) -> Judged | None:
    """The refusal of a claim if each of its sets, fitted with nuisances, has an effect that only keeps a parameter of
    another one within its plausible range; else None."""
    fits, parts = dict(_refitted(search, [()], ALIKE)), set[Names]()
    for names in plain.alternatives:
        there = _refitted(search, [names, *parts_of(names, search.fits)], ALIKE)
        there |= _improved_parts(search, there, names, ALIKE)
        own = [part for part in parts_of(names, there) if part and _part_suffices(there, names, part, search.criteria)]
        if not own:
            return None
        fits, parts = fits | there, parts | set(own)
    verdict = judge({(): fits[()]} | {part: fits[part] for part in parts}, search.criteria)
    return Judged.of(search, verdict) if verdict.status == "unexplained" else None


def _part_suffices(fits: Mapping[Names, Fit], names: Names, part: Names, criteria: Criteria) -> bool:
    """Whether a part of a set leaves no lack of fit and nothing for the set to gain, with credible nuisances."""
    enough = leaves_nothing(fits[part], criteria) and not gains_enough(fits, names, part, criteria)
    return enough and _within_priors(fits[part], criteria) and at_random(fits[part], criteria)


def refitted_globally(fit: Fit) -> Fit:
    """The same set at its global minimum with nuisances, if that is lower.

    Where legs meet ground that earlier legs disturbed, the fit without offsets may lie in the basin of another minimum.
    """
    if fit.nuisances is None or not fit.model.walker.remembers:
        return fit
    point = solve_with_nuisances((fit.model, fit.cells, None, fit.nuisances))
    found = fitted_at(fit.model, fit.cells, point, fit.nuisances)
    return min(fit, found, key=lambda fit: fit.deviance)


def refitted_as_claimed(search: EffectSearch, found: Judged) -> dict[Names, Fit]:
    """The claimed set, each of its effects and the base model, refitted with the nuisances that the claim assumes."""
    claimed = found.verdict.effects
    sets = {(), claimed, *((name,) for name in claimed)}
    return _refitted(search, [names for names in search.fits if names in sets], batch_sd_of(found.named))


def calibrated(fit: Fit, criteria: Criteria) -> Fit | None:
    """The fit with a zero of the lift, a scale of speed and a drift of k within their priors, if these suffice to leave
    no lack of fit: the base model is then adequate to ``discover``. None where they do not, or are not needed."""
    if leaves_nothing(fit, criteria):
        return None
    found = refitted(fit, nuisances_for(fit, criteria))
    return found if leaves_nothing(found, criteria) and _within_priors(found, criteria) else None


def refitted_at_priors(search: EffectSearch, sets: Sequence[Names]) -> dict[Names, Fit]:
    """Sets refitted with all nuisances; recorded batches differ by their prior standard deviations."""
    recorded = search.cells.batch_share is not None
    return _refitted(search, sets, priors(search.fits[()], search.criteria) if recorded else ALIKE)


def has_flexible_nuisances(fit: Fit) -> bool:
    """Whether a fit has nuisances so flexible that an effect under another convention could fit nearly anything: a zero
    or scale for each batch or, where no batches are recorded, a k for each condition."""
    if fit.nuisances is None:
        return False
    offsets = set(READINGS) if fit.cells.batch_share is not None else {*READINGS, BATCH}
    return not offsets.isdisjoint(fit.nuisances.names)


def nuisances_suffice(search: EffectSearch, size: int) -> bool:
    """Whether nuisances make a set of up to ``size`` effects fit, and no further effect earns its place."""
    found = judged_with_nuisances(search, judge(search.fits, search.criteria))
    # A larger set that passes was found by extending the best of this size; its rivals have not been fitted yet.
    if found is None or len(found.verdict.effects) > size:
        return False
    named = found.named
    larger = search.extended(named.effects)
    extended = [named, *search.near([search.model(names) for names in larger], named)]
    fits = found.fits | {fit.effects: fit for fit in extended}
    return not any(earns_place(fits, names, named.effects, search.criteria) for names in larger)


def _verdict_up_to_size(search: EffectSearch, plain: Verdict, size: int) -> Judged | None:
    """The verdict among sets of up to ``size`` effects; None where nuisances do not help."""
    claimed = len(plain.effects) == size
    batch_sd = _batch_sd_about(search, search.fits[plain.effects] if claimed else _best_plausible(search, size))
    if claimed and (survivor := _if_still_earned(search, plain.effects, batch_sd)):
        return _with_new_rivals(search, plain, size, batch_sd) or Judged(plain, search.fits, survivor)
    found = _base_with_calibration_errors(search, plain, batch_sd)
    found = found or _judged_with_batch_sd(search, plain, size, batch_sd)
    if found is not None and len(plain.effects) > len(found.verdict.effects) and not claimed:
        survivor = _if_still_earned(search, plain.effects, batch_sd)
        if survivor := survivor or _if_earned_without_scatter(search, plain.effects):
            return Judged(plain, search.fits, survivor)
    return found


def _confirmed(search: EffectSearch, plain: Verdict, named: Fit) -> Judged:
    """The first verdict, with the calibration errors that the refitted set shows."""
    off = significant(named)
    because = f"{plain.because}, with {' and '.join(off)}" if off else plain.because
    return Judged(replace(plain, because=because), search.fits, named)


def _base_with_calibration_errors(search: EffectSearch, plain: Verdict, batch_sd: BatchSd) -> Judged | None:
    """The base model with calibration errors alone, where these make a scattering bed unnecessary.

    Scatter of the bed is still included if it is clearly present beside them and the base model remains adequate:
    without it, the standard error of k would be too small.
    """
    if not batch_sd or judge(_refitted(search, [()], ALIKE), search.criteria).status != "adequate":
        return None
    found = _judged_with_batch_sd(search, plain, 1, ALIKE)
    if found is None or found.verdict.status != "adequate":
        return None
    there = estimated_batch_sd(found.named, search.criteria)
    rough = _judged_with_batch_sd(search, plain, 1, there) if there else None
    return rough if rough and rough.verdict.status == "adequate" else found


def _batch_sd_about(search: EffectSearch, fit: Fit) -> BatchSd:
    """Batch SDs about a set, estimated again about its fit with batch offsets of that size."""
    batch_sd = estimated_batch_sd(fit, search.criteria)
    if not batch_sd:
        return ALIKE
    there = _refitted(search, [fit.effects], batch_sd)[fit.effects]
    # Where cells walk or swim by chance, the estimates with and without offsets differ: the larger one is used.
    bare = fitted_at(fit.model, fit.cells, there.point)
    found = estimated_batch_sd(there, search.criteria)
    # Unless that without is far above the set's own minimum: then it only shows cells on the wrong side of a switch.
    if bare.deviance > far_above(fit.deviance):
        return found
    return found.maximum(estimated_batch_sd(bare, search.criteria))


def _best_plausible(search: EffectSearch, size: int) -> Fit:
    return next(filter(sound, search.ranked(size)), search.fits[()])


def _judged_with_batch_sd(search: EffectSearch, plain: Verdict, size: int, batch_sd: BatchSd) -> Judged | None:
    """The verdict among sets of up to ``size`` effects, refitted with these batch SDs; None where it is no better."""
    fits = _refitted(search, _leading_sets(search, plain, size), batch_sd)
    if judge(fits, search.criteria).status == "unexplained":
        return None
    fits |= _refitted(search, [names for names in search.fits if len(names) == 1], batch_sd)
    verdict = judge(fits, search.criteria)
    while verdict.effects and (lower := _improved_beside(search, fits, verdict.effects, batch_sd)):
        fits |= lower
        verdict = judge(fits, search.criteria)
    named = fits[verdict.effects]
    if verdict.status == "unexplained" or not (
        _within_priors(named, search.criteria) and at_random(named, search.criteria)
    ):
        return None
    if plain.status == "adequate" != verdict.status:
        return None
    return Judged(_with_nuisances(verdict, plain, named, search.criteria), fits, named)


def _with_new_rivals(search: EffectSearch, plain: Verdict, size: int, batch_sd: BatchSd) -> Judged | None:
    """The verdict with nuisances if trials were run in order and it names sets that the claim does not; else None.

    In order of ω, a drift may be all that a rival lacks. Scatter of the bed lets any rival fit, so a claim that needs
    it is not compared again.
    """
    ordered = not batch_sd and run_in_order_of(search.cells)
    found = None if not ordered else _judged_with_batch_sd(search, plain, size, batch_sd)
    return found if found and set(found.verdict.alternatives) - set(plain.alternatives) else None


def _if_still_earned(search: EffectSearch, names: Names, batch_sd: BatchSd) -> Fit | None:
    """The set refitted with nuisances if each of its effects still earns its place; else None."""
    parts = parts_of(names, search.fits)
    fits = _refitted(search, [names, *parts], batch_sd)
    fits |= _improved_parts(search, fits, names, batch_sd)
    return fits[names] if all(earns_place(fits, names, part, search.criteria) for part in parts) else None


def _beats_scatter(search: EffectSearch, names: Names) -> bool:
    """Whether each effect of a set explains more, by its threshold, than scatter of the bed estimated without it.

    Only tested where each batch holds whole conditions, such as one frequency a day: there an effect that follows the
    differences between batches may be nothing but their offsets.
    """
    share = search.cells.batch_share
    if share is None or share.max(axis=1).min() < 1.0:
        return True
    fits = _refitted(search, [names, *parts_of(names, search.fits)], ALIKE)
    return _lead_over_scatter(search, names, fits) > _scatter_threshold(fits[names], share.shape[1], search.criteria)


def _if_earned_without_scatter(search: EffectSearch, names: Names) -> Fit | None:
    """The set refitted without scatter of the bed, if each effect explains clearly more than scatter would; else None.

    The deviance with an offset for every condition does not count the offsets, in which a missing effect may hide;
    their marginal likelihood (``gain_of_batches``) does.
    """
    if (fit := _if_still_earned(search, names, ALIKE)) is None or estimated_batch_sd(fit, search.criteria):
        return None
    fits = _refitted(search, [names, *parts_of(names, search.fits)], ALIKE)
    threshold = claim_threshold(fit, search.criteria) + selection_penalty(len(search.fits))
    return fit if _lead_over_scatter(search, names, fits) > threshold else None


def _lead_over_scatter(search: EffectSearch, names: Names, fits: Mapping[Names, Fit]) -> float:
    """The least gain of an effect of a set over scatter of the bed, in -2 ln of the posterior."""
    marginal = {key: fit.deviance - gain_of_batches(fit, search.criteria) for key, fit in fits.items()}
    return min((marginal[part] - marginal[names] for part in parts_of(names, fits)), default=0.0)


def _base_with_scatter(search: EffectSearch, plain: Verdict) -> Judged | None:
    """The base model with the scatter estimated about it, where no believable effect explains more; else None.

    It must also pass with the scatter estimated about the best single effect, and every effect that gains there must
    have an implausible parameter and explain no more than scatter would.
    """
    criteria, batch_sd = search.criteria, _batch_sd_about(search, _best_plausible(search, 1))
    fits = _refitted(search, _leading_sets(search, plain, 1), batch_sd)
    helpful = [names for names in fits if len(names) == 1 and gains_enough(fits, names, (), criteria)]
    explained = leaves_nothing(fits[()], criteria) and helpful
    if not explained or any(sound(fits[names]) or _beats_scatter(search, names) for names in helpful):
        return None
    found = _judged_with_batch_sd(search, plain, 1, _batch_sd_about(search, search.fits[()]))
    return found if found and found.verdict.status == "adequate" else None


def _scatter_threshold(fit: Fit, batches: int, criteria: Criteria) -> float:
    """What an effect must gain over scatter of the bed: the usual threshold, and more where batches are few.

    Student's t replaces the normal distribution; its likelihood ratio is (d + 1) ln(1 + t²/d).
    """
    freedom = max(batches - ABSORBED, 1)
    square = f_isf(chi2_sf(criteria.claim, 1), 1, freedom)
    ratio = (freedom + 1) * np.log1p(square / freedom)
    return float(max(claim_threshold(fit, criteria), ratio * overdispersion(fit)))


def _improved_beside(
    search: EffectSearch, fits: Mapping[Names, Fit], names: Names, batch_sd: BatchSd
) -> dict[Names, Fit]:
    """What a set is compared with that fits better when refitted from its minimum: its parts and, where batches have
    offsets of k beside several effects, its rivals; then the set itself is searched as closely.

    Such offsets turn cells into walkers or swimmers: a search from a set's own fit without offsets ends in another
    basin than one from the offsets of a rival.
    """
    lower = _improved_parts(search, fits, names, batch_sd)
    if len(names) > 1 and batch_sd[BATCH]:
        some = [names, *_nearest_rivals(fits, names)]
        lower |= _improved(search, fits, names, some, batch_sd, search.criteria.clearly)
    return lower


def _nearest_rivals(fits: Mapping[Names, Fit], names: Names) -> list[Names]:
    """The best sets by BIC that have one other effect in place of one of a set's."""
    others = [key for key in fits if len(key) == len(names) == len({*key, *names}) - 1]
    return sorted(others, key=lambda key: fits[key].bic)[:NEAREST]


def _improved_parts(
    search: EffectSearch, fits: Mapping[Names, Fit], names: Names, batch_sd: BatchSd
) -> dict[Names, Fit]:
    """Parts of a set that fit better when refitted from the minimum of the set."""
    return _improved(search, fits, names, parts_of(names, fits), batch_sd, LEAST_GAIN)


def _improved(
    search: EffectSearch,
    fits: Mapping[Names, Fit],
    names: Names,
    others: Sequence[Names],
    batch_sd: BatchSd,
    least_gain: float,
) -> dict[Names, Fit]:
    """Those of the ``others`` that fit better by a ``least_gain`` when refitted from the minimum of a set."""
    origin = fits[names]
    tasks = [(fits[other], origin, nuisances_for(fits[other], search.criteria, batch_sd)) for other in others]
    found = zip(others, search.fit_all(_from_minimum_of, tasks), strict=True)
    return {other: fit for other, fit in found if fit.deviance < fits[other].deviance - least_gain}


def _from_minimum_of(task: tuple[Fit, Fit, Nuisances]) -> Fit:
    """A set refitted from the minimum of another one, with its own nuisances, if that is better.

    Where steps disturb the ground for later ones, each parameter is also scanned.
    """
    before, origin, own = task
    assert origin.nuisances is not None
    own = replace(own, initial=origin.nuisances.initial)
    point = solve_near((before.model, before.cells, (origin.warm_start,), own))
    better = min(before, fitted_at(before.model, before.cells, point, own), key=lambda fit: fit.deviance)
    if before.model.walker.remembers and better.deviance < far_above(origin.deviance):
        # The deviance has many shallow local minima: an apparent gain may only be the difference between two.
        better = lowest_along(better)
    return better


def _leading_sets(search: EffectSearch, plain: Verdict, most: int) -> list[Names]:
    """The base model, the best sets of each size and those the verdict names, with all their subsets."""
    found = {names for names in plain.alternatives if len(names) <= most}
    for size in range(1, most + 1):
        found |= {fit.effects for fit in search.ranked(size)[:LEADING]}
    parts = {part for names in found for size in range(len(names)) for part in combinations(names, size)}
    return sorted((found | parts | {()}) & set(search.fits), key=len)


def _refitted(search: EffectSearch, sets: Sequence[Names], batch_sd: BatchSd) -> dict[Names, Fit]:
    """Sets refitted with nuisances; cached by the batch SDs and the fits they start from."""
    rough = (_on_rough_ground(search),) if batch_sd[BATCH] else ()
    begun = {names: (*_starting_fits(search, names), *rough) for names in sets}
    keys = {names: (_refitted, batch_sd, *some) for names, some in begun.items()}
    new = {names: some for names, some in begun.items() if keys[names] not in search.computed}
    for names, fit in zip(new, _fitted_from(search, new, batch_sd), strict=True):
        search.computed[keys[names]] = fit
    return {names: search.computed[key] for names, key in keys.items()}


def _fitted_from(search: EffectSearch, begun: Mapping[Names, tuple[Fit, ...]], batch_sd: BatchSd) -> list[Fit]:
    """Sets fitted with nuisances from these starting fits, never to a higher deviance than at their present point."""
    fits = [search.fits[names] for names in begun]
    origins = [tuple(fit.warm_start for fit in some) for some in begun.values()]
    for later in range(PASSES):
        own = [nuisances_for(fit, search.criteria, batch_sd) for fit in fits]
        starts = [fit.point for fit in fits] if later else origins
        tasks = [(fit.model, fit.cells, *at) for fit, *at in zip(fits, starts, own, strict=True)]
        found = search.solved(tasks, solve_from if later else solve_near)
        stayed = [fitted_at(fit.model, fit.cells, fit.point, at) for fit, at in zip(fits, own, strict=True)]
        fits = [min(both, key=lambda fit: fit.deviance) for both in zip(found, stayed, strict=True)]
    return fits


def _starting_fits(search: EffectSearch, names: Names) -> tuple[Fit, ...]:
    """The fit of a set, and that of its best part: with nuisances the last effect may no longer be needed."""
    smaller = [search.fits[part] for part in parts_of(names, search.fits)]
    return (search.fits[names], *sorted(smaller, key=lambda part: part.deviance)[:1])


@once_per_search
def _on_rough_ground(search: EffectSearch) -> Fit:
    """The base model at its global minimum if all replicates of a condition share an offset of k.

    Otherwise conditions that walk or swim because of their batch's offset draw k and Δt to another local minimum, from
    which a descent with offsets does not return.
    """
    plain = search.fits[()]
    own = nuisances_for(plain, search.criteria).with_k_scatter(ROUGH_FACTOR * search.criteria.bed_scatter)
    return fitted_at(plain.model, plain.cells, solve_with_nuisances((plain.model, plain.cells, None, own)), own)


def allowed_for(fit: Fit, criteria: Criteria) -> list[str]:
    """What differs between batches in a fit with nuisances, and its significant zero, scale and drift, in words."""
    return _batch_terms_in_words(fit, batch_sd_of(fit), criteria) + significant(fit)


def in_words(fit: Fit, criteria: Criteria) -> str:
    """All that a fit with nuisances allows for."""
    return " and ".join(allowed_for(fit, criteria)) or "a drift that these data can't show"


def _with_nuisances(verdict: Verdict, plain: Verdict, fit: Fit, criteria: Criteria) -> Verdict:
    """The verdict with the nuisances that it assumes, and what it would be without them."""
    sets = either(plain.alternatives or (plain.effects,))
    named = f"{plain.status}: {sets}" if sets else plain.status
    because = f"{verdict.because}, allowing for {in_words(fit, criteria)}"
    if plain.status != verdict.status or plain.effects != verdict.effects:
        because = f"{because}; without that the verdict would be {named}"
    return replace(verdict, because=because)


def _batch_terms_in_words(fit: Fit, batch_sd: BatchSd, criteria: Criteria) -> list[str]:
    """The assumed differences between batches, in words."""
    kind, prior = "condition" if fit.cells.batch_share is None else "batch", priors(fit, criteria)
    words = {
        BATCH: f"k that scatters by {batch_sd[BATCH]:.2%} from {kind} to {kind} (prior {prior[BATCH]:.1%})",
        BATCH_ZERO: f"a lift zero that scatters by {1e3 * batch_sd[BATCH_ZERO]:.2g} mm from batch to batch "
        f"(prior {1e3 * prior[BATCH_ZERO]:.1g} mm)",
        BATCH_SCALE: f"a speed scale that scatters by {batch_sd[BATCH_SCALE]:.2%} from batch to batch "
        f"(prior {prior[BATCH_SCALE]:.1%})",
    }
    return [words[name] for name in batch_sd.names]


def _within_priors(fit: Fit, criteria: Criteria) -> bool:
    """Whether drift, zeros and scales, also those of each batch, are compatible with their priors."""
    assert fit.nuisances is not None
    prior = priors(fit, criteria)
    of_batch = {name: prior[name] for name in READINGS}
    named = zip(fit.nuisances.names, fit.nuisances.sd, fit.shared, strict=True)
    return all(
        abs(value) < FAR_OFF * of_batch.get(name, sd) for name, sd, (value, _) in named if name in {*WORDS, *of_batch}
    )
