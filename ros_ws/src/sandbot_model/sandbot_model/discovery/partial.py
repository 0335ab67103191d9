"""The verdict *partial*: one effect repairs most of what the base model misses, and the exception is reported.

Three cases, tried in this order:

1. The effect shows no lack of fit and no other comes near, but a parameter of it is beyond its plausible range: its
   formula may have another form here, or the range may be too narrow. Where the search for an effect ended, it is
   searched further first: how wide the ranges are decides nothing. If others then do as well, all are named.
2. The effect shows no lack of fit once one observable is left out, which may be wrong (another convention, a camera).
   It is not named if the base model then fits too (only the observable is wrong), or if another effect does about as
   well with the same or another observable left out.
3. The effect leaves a small rest, and leads clearly whichever observable is left out.

In none of them is it named if it needs a k far from that of grains.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from sandbot_model.data.conditions import Cells
from sandbot_model.discovery import conventions
from sandbot_model.discovery.criteria import Criteria
from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.plausibility import implausible_k
from sandbot_model.discovery.verdict import (
    Names,
    Verdict,
    doubtful_parameters,
    doubtful_values,
    earns_place,
    gains_enough,
    leaves_nothing,
    overdispersion,
    p_in_words,
    passes,
    sound,
)
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.jacobian import project_out, tangent_basis
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.model import model_of
from sandbot_model.physics.observables import CM, Observable
from sandbot_model.physics.variants import NEW

LEAST_SHARE = 0.5
"""Fraction of the excess deviance that an effect must exceed if one observable is left out."""
LEAST_OBSERVABLES = 3
"""Observables needed, so that without one the others still distinguish effects."""
TRIED = 4
"""Single effects that are refitted with an observable left out, those with the least expected χ²."""
OPEN = 10.0
"""Widths of the plausible range by which the search goes beyond it where an effect was stopped at its end."""
HOPELESS = 4.0
"""χ² per degree of freedom, to first order, from which a refit to the other observables is not worth trying."""


@dataclass(frozen=True)
class Miss:
    """An observable in which the effect fails: rms of measured minus model, in SI units and in standard errors."""

    observable: str
    rms: float
    z: float


@dataclass(frozen=True)
class Partial:
    """What the leading effect achieves: the observables in which it holds, the ``share`` of the excess deviance that it
    removes there (in all observables if no single one is at fault), and those in which it fails."""

    effect: str
    share: float
    holds: tuple[str, ...]
    fails: tuple[Miss, ...]


LeftOut = Mapping[Observable, Mapping[Names, Fit]]
"""Fits of single effects and of the base model with an observable left out."""
Found = tuple[Mapping[Names, Fit], Names, list[Observable]]
"""Fits, the named set among them, and the observables in which it fails."""
Finder = Callable[[EffectSearch, Sequence[Observable]], Found | None]


def mostly_repaired(search: EffectSearch) -> tuple[Verdict, Partial] | None:
    """The verdict where one effect repairs most of the misfit; None where none does, or several might."""
    # An effect that fails in no observable takes precedence.
    return beyond_its_range(search) or _verdict_from(search, _with_an_exception)


def beyond_its_range(search: EffectSearch) -> tuple[Verdict, Partial] | None:
    """The verdict where one effect shows no lack of fit and no other comes near, but a parameter is out of range."""
    found = _verdict_from(search, lambda search, _: _all_but_plausibility(search))
    return found and _with_those_as_good(search, *found)


def _verdict_from(search: EffectSearch, finds: Finder) -> tuple[Verdict, Partial] | None:
    observables = [observable for observable in Observable if observable.name in search.cells.observables]
    if len(observables) < LEAST_OBSERVABLES or len(search.fits) == 1 or (found := finds(search, observables)) is None:
        return None
    fits, names, failing = found
    at, share = fits[names], _share_removed(fits, names)
    # Most of an enormous misfit is removed by a ground that is stiff enough.
    if implausible_k(at):
        return None
    misses = tuple(_miss(search.cells, at, observable) for observable in failing)
    holds = tuple(observable.name for observable in observables if observable not in failing)
    partial = Partial(at.effects[0], share, holds, misses)
    return Verdict("partial", at.effects, (at.effects,), _because(partial, at)), partial


def _with_an_exception(search: EffectSearch, observables: Sequence[Observable]) -> Found | None:
    """The effect that fits without one observable, or else leaves a small rest."""
    found = _all_but_one_observable(_fits_without_each(search, observables, HOPELESS), search.criteria)
    if found is None or _is_clearly_beaten(search, found[1]) or _another_convention_does_better(search, found):
        return _all_but_a_rest(search, observables)
    return found


def without(cells: Cells, observable: Observable) -> Cells:
    """Cells with the measurements of one observable removed."""
    mean, count = cells.mean.copy(), cells.n.copy()
    mean[:, observable], count[:, observable] = np.nan, 0
    return replace(cells, mean=mean, n=count)


def _fits_without_each(search: EffectSearch, observables: Sequence[Observable], hopeless: float) -> LeftOut:
    """The base model and the most promising single effects, refitted with each observable left out in turn."""
    singles = [fit for names, fit in search.fits.items() if len(names) == 1]
    found = {}
    for observable in observables:
        cells = without(search.cells, observable)
        hopeful = _hopeful(cells, singles, hopeless)
        some = [search.fits[()], *hopeful] if hopeful else []
        found[observable] = {fit.effects: fit for fit in _fitted_to(search, cells, some)}
    return found


def _hopeful(cells: Cells, fits: Iterable[Fit], hopeless: float = HOPELESS) -> list[Fit]:
    """Fits expected to come nearest to other cells than those they were fitted to, below χ² = ``hopeless``."""
    expected = sorted(((_reduced_chi2(fit, cells), fit) for fit in fits), key=lambda pair: pair[0])
    return [fit for chi2, fit in expected[:TRIED] if chi2 < hopeless]


def _fitted_to(search: EffectSearch, cells: Cells, fits: Sequence[Fit]) -> list[Fit]:
    """The same models, fitted to other cells."""
    return search.solved([(fit.model, cells, (fit.warm_start,), None) for fit in fits])


def _reduced_chi2(fit: Fit, cells: Cells) -> float:
    """χ² per degree of freedom of a fit on other cells, with its parameters adjusted to first order."""
    problem = Problem(fit.model, cells)
    state = problem.states(fit.state.theta, fit.state.ln_k, fit.state.slope)
    left = project_out(state.all_residuals[0], tangent_basis(problem, state))
    return float(left @ left) / max(int(problem.measured.sum()) - len(fit.stderr), 1)


def _all_but_one_observable(left_out: LeftOut, criteria: Criteria) -> Found | None:
    """The effect that fits once one observable is left out, and that observable."""
    passing = [(key, names) for key, fits in left_out.items() for names in fits if _explains(fits, names, criteria)]
    if not passing or any(not names for _, names in passing):
        return None
    excess = {(key, names): _excess(left_out[key][names]) for key, names in passing}
    odd, best = min(passing, key=lambda key: excess[key])
    rivals = [key for key in passing if key[1] != best and excess[key] - excess[odd, best] < criteria.clearly]
    return None if rivals else (left_out[odd], best, [odd])


def _is_clearly_beaten(search: EffectSearch, names: Names) -> bool:
    """Whether another effect is clearly better on all observables."""
    singles, leader = _singles(search)
    named = singles[names]
    return leader.bic < named.bic - search.criteria.clearly * overdispersion(named)


def _another_convention_does_better(search: EffectSearch, found: Found) -> bool:
    """Whether another effect under another convention fits better with the same observable left out; clearly better, if
    its parameters are implausible."""
    fits, names, _ = found
    named = fits[names]
    others = _hopeful(named.cells, (fit for fit in conventions.singles(search) if fit.effects != names))
    rivals = [fit for fit in _fitted_to(search, named.cells, others) if leaves_nothing(fit, search.criteria)]
    return any(fit.bic < named.bic - (0.0 if sound(fit) else search.criteria.clearly) for fit in rivals)


def _explains(fits: Mapping[Names, Fit], names: Names, criteria: Criteria) -> bool:
    earned = not names or (earns_place(dict(fits), names, (), criteria) and _share_removed(fits, names) > LEAST_SHARE)
    return earned and passes(fits[names], criteria)


def _excess(fit: Fit) -> float:
    """Deviance in excess of its expectation from pure error alone."""
    return fit.deviance - fit.goodness.dof


def _all_but_plausibility(search: EffectSearch) -> Found | None:
    """The effect that would be identified if the values of its parameters were plausible.

    The parameter of a convention does not count as its own: out of range, it is a formula that nobody would write.
    """
    if not _lacks_only_plausibility(_singles(search)[1], search.criteria):
        return None
    opened = _searched_further(search)
    singles, leader = _singles(search, opened)
    near = _as_good(singles, leader, search.criteria)
    by_the_search = not near or any(fit.effects in opened for fit in (leader, *near))
    if not by_the_search or not all(_lacks_only_plausibility(fit, search.criteria) for fit in (leader, *near)):
        return None
    if not gains_enough(singles, leader.effects, (), search.criteria):
        return None
    search.fits |= {fit.effects: fit for fit in (leader, *near)}
    return singles, leader.effects, []


def _lacks_only_plausibility(fit: Fit, criteria: Criteria) -> bool:
    """Whether a single effect leaves no lack of fit, with parameters of its own out of range, and no others."""
    if not fit.model.effects:
        return False
    (effect,) = fit.model.effects
    own = {f"{effect.identifier}.{parameter.name}" for parameter in effect.parameters if parameter.doc != NEW}
    beyond = doubtful_parameters(fit)
    return bool(beyond) and own.issuperset(beyond) and leaves_nothing(fit, criteria)


def _searched_further(search: EffectSearch) -> dict[Names, Fit]:
    """The single effects that an end of the search stopped, fitted again without that end."""
    stopped = [fit for names, fit in search.fits.items() if len(names) == 1 and fit.stopped]
    models = [
        model_of(search.base, fit.effects, {**fit.model.catalogue, fit.effects[0]: _opened(fit)}, search.cells.robot)
        for fit in stopped
    ]
    tasks = [(model, search.cells, (fit.warm_start,), None) for model, fit in zip(models, stopped, strict=True)]
    return {fit.effects: fit for fit in search.solved(tasks)}


def _opened(fit: Fit) -> Effect:
    """The effect of a fit with a wider search for its ``stopped`` parameters."""
    (effect,) = fit.model.effects
    return effect.with_parameters(
        tuple(
            replace(parameter, reach=OPEN) if f"{effect.identifier}.{parameter.name}" in fit.stopped else parameter
            for parameter in effect.parameters
        )
    )


def _as_good(singles: Mapping[Names, Fit], leader: Fit, criteria: Criteria) -> list[Fit]:
    """The other fits that the best single effect does not clearly beat, the best first."""
    most = leader.bic + criteria.clearly * overdispersion(leader)
    return sorted((fit for fit in singles.values() if fit is not leader and fit.bic <= most), key=lambda fit: fit.bic)


def _with_those_as_good(search: EffectSearch, verdict: Verdict, partial: Partial) -> tuple[Verdict, Partial]:
    """The verdict, with the effects that do as well as the one it names."""
    leader = search.fits[verdict.effects]
    near = _as_good(_singles(search)[0], leader, search.criteria)
    as_well = [f"{fit.effects[0]} with {doubtful_values(fit)} fits as well" for fit in near]
    alternatives = (*verdict.alternatives, *(fit.effects for fit in near))
    return Verdict("partial", verdict.effects, alternatives, "; ".join((verdict.because, *as_well))), partial


def _all_but_a_rest(search: EffectSearch, observables: Sequence[Observable]) -> Found | None:
    """The effect that leaves a small rest and leads whichever observable is left out; the observables it fails in."""
    singles, leader = _singles(search)
    if _share_removed(singles, leader.effects) < search.criteria.all_but_a_rest:
        return None
    # A small rest of a large misfit may still be large, so no fit is excluded as hopeless.
    left_out = _fits_without_each(search, observables, np.inf)
    if not all(_leads(fits, leader.effects, search.criteria) for fits in (singles, *left_out.values())):
        return None
    tests = leader.goodness.lack_of_fit
    failing = [
        observable for observable in left_out if tests.get(observable.name, 1.0) < search.criteria.lack_of_fit_of_one
    ]
    return singles, leader.effects, failing


def _singles(search: EffectSearch, instead: Mapping[Names, Fit] = MappingProxyType({})) -> tuple[dict[Names, Fit], Fit]:
    """The fits of the base model and of all single effects, some of them others ``instead``; the best single effect."""
    singles = {names: instead.get(names, fit) for names, fit in search.fits.items() if len(names) < 2}
    return singles, min((fit for names, fit in singles.items() if names), key=lambda fit: fit.bic)


def _leads(fits: Mapping[Names, Fit], names: Names, criteria: Criteria) -> bool:
    """Whether an effect earns its place and is clearly better than every other."""
    if names not in fits or not earns_place(dict(fits), names, (), criteria):
        return False
    margin = criteria.clearly * overdispersion(fits[names])
    return all(fit.bic - fits[names].bic > margin for key, fit in fits.items() if key and key != names and sound(fit))


def repairs(fits: Mapping[Names, Fit], names: Names, criteria: Criteria) -> bool:
    """Whether a set shows no lack of fit, or leaves only a small rest of what the base model misses."""
    return leaves_nothing(fits[names], criteria) or _share_removed(fits, names) >= criteria.all_but_a_rest


def _share_removed(fits: Mapping[Names, Fit], names: Names) -> float:
    """Fraction of the base model's excess deviance that a set removes."""
    return (fits[()].deviance - fits[names].deviance) / max(_excess(fits[()]), 1e-9)


def _miss(cells: Cells, fit: Fit, observable: Observable) -> Miss:
    """The misfit of an observable, by a fit that may not include it."""
    gap = cells.mean[:, observable] - fit.predicted[:, observable]
    z = gap / np.sqrt(cells.covariance[:, observable, observable])
    clear = fit.problem.away_from_switch(fit.problem.widening(fit.state.covariance[0])) & np.isfinite(gap)
    return Miss(observable.name, *(float(np.sqrt(np.mean(values[clear] ** 2))) for values in (gap, z)))


def _because(found: Partial, at: Fit) -> str:
    holds = ", ".join(Observable[name].label for name in found.holds) or "no observable by itself"
    fails = ", ".join(
        f"{Observable[miss.observable].label} by {CM * miss.rms:.2g} {Observable[miss.observable].readers_unit} rms "
        f"({miss.z:.1f} standard errors)"
        for miss in found.fails
    )
    there = " there" if len(found.fails) == 1 else ""
    beyond = "".join(f"; but {_out_of_range(at, name)}" for name in dict.fromkeys(doubtful_parameters(at)))
    return (
        f"{found.effect} holds in {holds} and removes {min(found.share, 1.0):.0%} of what the base model misses{there} "
        f"{p_in_words(at)}" + (f"; it fails in {fails}" if fails else "") + beyond
    )


def _out_of_range(fit: Fit, name: str) -> str:
    """The value of a doubtful parameter, its plausible range, and whether the search ended there."""
    parameter = fit.model.parameter(name)
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    value = f"{fit.parameters[name].value:.3g}{unit}"
    ended = ", where the search ended," if name in fit.stopped else ""
    return f"{name} = {value}{ended} is at or beyond the end of {parameter.low:g} to {parameter.high:g}{unit}"
