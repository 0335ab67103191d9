"""Between yes and no: one effect repairs most of what the base model misses, and what it does not is said.

Any one observable may be wrong: another convention, a camera. Each is left out in turn. Where an effect of the
catalogue then leaves replicates nothing to explain, it is named, unless the base model does so too (then the observable
is all that is wrong) or another effect does about as well with the same or another observable left out. Without such an
observable an effect is named if a small rest is left, and it leads clearly whichever observable is left out.

So is an effect that leaves nothing, and no other comes near, but only with a number beyond what is believed of it: its
formula may have another form here, or the range be too narrow.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sandbot_model.data.conditions import Cells
from sandbot_model.discovery import conventions
from sandbot_model.discovery.criteria import Criteria
from sandbot_model.discovery.effect_search import EffectSearch, Names
from sandbot_model.discovery.verdict import (
    Verdict,
    doubtful_parameters,
    earns_place,
    gains_enough,
    leaves_nothing,
    overdispersion,
    passes,
    sound,
)
from sandbot_model.fitting.fit import Fit, fitted_at
from sandbot_model.fitting.global_minimum import solve_near
from sandbot_model.fitting.jacobian import project_out, tangent_basis
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.physics.observables import CM, Observable
from sandbot_model.physics.variants import NEW

LEAST_SHARE = 0.5
"""Share of the excess deviance that an effect must remove at least, where one observable is at fault."""
LEAST_OBSERVABLES = 3
"""Observables from which one may be left out and the others still tell effects apart."""
TRIED = 4
"""Single effects that are fitted with an observable left out, those that come nearest to the others."""
HOPELESS = 4.0
"""χ² a degree of freedom, to first order, from which no fit to the other observables will leave nothing."""


@dataclass(frozen=True)
class Miss:
    """An observable in which the effect fails: rms of measured minus model [SI], and in standard errors."""

    observable: str
    rms: float
    z: float


@dataclass(frozen=True)
class Partial:
    """What the leading effect does: where it holds, the ``share`` of the excess deviance there that it removes (of all
    of it where no single observable is at fault), and where it fails."""

    effect: str
    share: float
    holds: tuple[str, ...]
    fails: tuple[Miss, ...]


LeftOut = Mapping[Observable, Mapping[Names, Fit]]
"""Fits of single effects and of the base model with an observable left out."""
Found = tuple[Mapping[Names, Fit], Names, list[Observable]]
"""Fits, the set among them that is named, and the observables in which it fails."""
Finder = Callable[[EffectSearch, Sequence[Observable]], Found | None]


def mostly_repaired(search: EffectSearch) -> tuple[Verdict, Partial] | None:
    """The verdict where one effect repairs most; None where none does, or several might."""
    # What leaves nothing in any observable comes before what fails in one.
    return beyond_its_range(search) or _verdict_from(search, _with_an_exception)


def beyond_its_range(search: EffectSearch) -> tuple[Verdict, Partial] | None:
    """The verdict where one effect leaves nothing and no other comes near, but with a number nobody believes."""
    return _verdict_from(search, lambda search, _: _all_but_plausibility(search))


def _verdict_from(search: EffectSearch, finds: Finder) -> tuple[Verdict, Partial] | None:
    observables = [one for one in Observable if one.name in search.cells.observables]
    if len(observables) < LEAST_OBSERVABLES or len(search.fits) == 1 or (found := finds(search, observables)) is None:
        return None
    fits, names, failing = found
    at, share = fits[names], _share_removed(fits, names)
    misses = tuple(_miss(search.cells, at, one) for one in failing)
    holds = tuple(one.name for one in observables if one not in failing)
    partial = Partial(at.effects[0], share, holds, misses)
    return Verdict("partial", at.effects, (at.effects,), _because(partial, at)), partial


def _with_an_exception(search: EffectSearch, observables: Sequence[Observable]) -> Found | None:
    """The effect that leaves nothing without one observable, or a small rest."""
    found = _all_but_one_observable(_fits_without_each(search, observables, HOPELESS), search.criteria)
    if (
        found is not None
        and not _is_clearly_beaten(search, found[1])
        and not _another_convention_does_better(search, found)
    ):
        return found
    return _all_but_a_rest(search, observables)


def without(cells: Cells, observable: Observable) -> Cells:
    """Cells in which one observable was not measured."""
    mean, count = cells.mean.copy(), cells.n.copy()
    mean[:, observable], count[:, observable] = np.nan, 0
    return replace(cells, mean=mean, n=count)


def _fits_without_each(search: EffectSearch, observables: Sequence[Observable], hopeless: float) -> LeftOut:
    """The base model and the most hopeful single effects with each observable left out in turn."""
    singles = [fit for names, fit in search.fits.items() if len(names) == 1]
    found = {}
    for one in observables:
        cells = without(search.cells, one)
        hopeful = _hopeful(cells, singles, hopeless)
        some = [search.fits[()], *hopeful] if hopeful else []
        found[one] = {fit.effects: fit for fit in _fitted_to(search, cells, some)}
    return found


def _hopeful(cells: Cells, fits: Iterable[Fit], hopeless: float = HOPELESS) -> list[Fit]:
    """Those that come nearest to other cells than they were made to, and not hopelessly far."""
    missed = sorted(((_reduced_chi2(fit, cells), fit) for fit in fits), key=lambda one: one[0])
    return [fit for miss, fit in missed[:TRIED] if miss < hopeless]


def _fitted_to(search: EffectSearch, cells: Cells, fits: Sequence[Fit]) -> list[Fit]:
    """The same models, fitted to other cells."""
    points = search.fit_all(solve_near, [(fit.model, cells, (fit.warm_start,), None) for fit in fits])
    return [fitted_at(fit.model, cells, point) for fit, point in zip(fits, points, strict=True)]


def _reduced_chi2(fit: Fit, cells: Cells) -> float:
    """χ² a degree of freedom of other cells than a fit was made to, its parameters following to first order."""
    problem = Problem(fit.model, cells)
    state = problem.states(fit.state.theta, fit.state.ln_k, fit.state.slope)
    left = project_out(state.all_residuals[0], tangent_basis(problem, state))
    return float(left @ left) / max(int(problem.measured.sum()) - len(fit.stderr), 1)


def _all_but_one_observable(spared: LeftOut, criteria: Criteria) -> Found | None:
    """The effect that leaves nothing to explain without one observable, and which that is."""
    passing = [(one, names) for one, fits in spared.items() for names in fits if _explains(fits, names, criteria)]
    if not passing or any(not names for _, names in passing):
        return None
    excess = {(one, names): _excess(spared[one][names]) for one, names in passing}
    odd, best = min(passing, key=lambda key: excess[key])
    rivals = [key for key in passing if key[1] != best and excess[key] - excess[odd, best] < criteria.clearly]
    return None if rivals else (spared[odd], best, [odd])


def _is_clearly_beaten(search: EffectSearch, names: Names) -> bool:
    """Whether another effect is clearly better with no observable left out: then it leads, if any does."""
    singles, leader = _singles(search)
    named = singles[names]
    return leader.bic < named.bic - search.criteria.clearly * overdispersion(named)


def _another_convention_does_better(search: EffectSearch, found: Found) -> bool:
    """Whether another family under a convention of its own does better where one observable is left out; clearly so
    where it does with a number that nobody believes."""
    fits, names, _ = found
    named = fits[names]
    others = _hopeful(named.cells, (fit for fit in conventions.singles(search) if fit.effects != names))
    rivals = [fit for fit in _fitted_to(search, named.cells, others) if leaves_nothing(fit, search.criteria)]
    return any(fit.bic < named.bic - (0.0 if sound(fit) else search.criteria.clearly) for fit in rivals)


def _explains(fits: Mapping[Names, Fit], names: Names, criteria: Criteria) -> bool:
    earned = not names or (earns_place(dict(fits), names, (), criteria) and _share_removed(fits, names) > LEAST_SHARE)
    return earned and passes(fits[names], criteria)


def _excess(fit: Fit) -> float:
    """Deviance above what replicates alone would leave."""
    return fit.deviance - fit.goodness.dof


def _all_but_plausibility(search: EffectSearch) -> Found | None:
    """The effect that would be identified if the values of its own parameters were believable.

    A convention's number is none of them: beyond its range it is a formula that nobody would write.
    """
    singles, leader = _singles(search)
    (effect,) = leader.model.effects
    own = {f"{effect.identifier}.{one.name}" for one in effect.parameters if one.doc != NEW}
    beyond = doubtful_parameters(leader)
    if not beyond or not own.issuperset(beyond) or not leaves_nothing(leader, search.criteria):
        return None
    apart = search.criteria.clearly * overdispersion(leader)
    alone = all(fit.bic - leader.bic > apart for fit in singles.values() if fit is not leader)
    return (
        (singles, leader.effects, []) if alone and gains_enough(singles, leader.effects, (), search.criteria) else None
    )


def _all_but_a_rest(search: EffectSearch, observables: Sequence[Observable]) -> Found | None:
    """The effect that leads whichever observable is left out and leaves a small rest; where that is."""
    singles, leader = _singles(search)
    if _share_removed(singles, leader.effects) < search.criteria.all_but_a_rest:
        return None
    # A small share of what is missed by far is still far from nothing.
    spared = _fits_without_each(search, observables, np.inf)
    if not all(_leads(fits, leader.effects, search.criteria) for fits in (singles, *spared.values())):
        return None
    tests = leader.goodness.lack_of_fit
    failing = [one for one in spared if tests.get(one.name, 1.0) < search.criteria.lack_of_fit_of_one]
    return singles, leader.effects, failing


def _singles(search: EffectSearch) -> tuple[dict[Names, Fit], Fit]:
    """The base model and the single effects, and of these the best."""
    singles = {names: fit for names, fit in search.fits.items() if len(names) < 2}
    return singles, min((fit for names, fit in singles.items() if names), key=lambda fit: fit.bic)


def _leads(fits: Mapping[Names, Fit], names: Names, criteria: Criteria) -> bool:
    """Whether an effect earns its place and is clearly better than every other."""
    if names not in fits or not earns_place(dict(fits), names, (), criteria):
        return False
    apart = criteria.clearly * overdispersion(fits[names])
    return all(fit.bic - fits[names].bic > apart for key, fit in fits.items() if key and key != names and sound(fit))


def repairs(fits: Mapping[Names, Fit], names: Names, criteria: Criteria) -> bool:
    """Whether a set leaves nothing, or a small rest of what the base model misses."""
    return leaves_nothing(fits[names], criteria) or _share_removed(fits, names) >= criteria.all_but_a_rest


def _share_removed(fits: Mapping[Names, Fit], names: Names) -> float:
    """Share of the base model's excess deviance that a set removes."""
    return (fits[()].deviance - fits[names].deviance) / max(_excess(fits[()]), 1e-9)


def _miss(cells: Cells, fit: Fit, observable: Observable) -> Miss:
    """By a fit that need not have seen the observable."""
    gap = cells.mean[:, observable] - fit.predicted[:, observable]
    z = gap / np.sqrt(cells.covariance[:, observable, observable])
    clear = fit.problem.away_from_switch(fit.problem.widening(fit.state.covariance[0])) & np.isfinite(gap)
    return Miss(observable.name, *(float(np.sqrt(np.mean(values[clear] ** 2))) for values in (gap, z)))


def _because(found: Partial, at: Fit) -> str:
    holds = ", ".join(Observable[name].label for name in found.holds) or "no observable by itself"
    fails = " and ".join(
        f"{Observable[miss.observable].label} by {CM * miss.rms:.2g} {Observable[miss.observable].readers_unit} rms "
        f"({miss.z:.1f} standard errors)"
        for miss in found.fails
    )
    there = " there" if len(found.fails) == 1 else ""
    beyond = "".join(f"; but {_out_of_range(at, name)}" for name in dict.fromkeys(doubtful_parameters(at)))
    return (
        f"{found.effect} holds in {holds} and removes {min(found.share, 1.0):.0%} of what the base model misses{there} "
        f"(lack of fit p = {at.lack_of_fit_p:.2g})" + (f"; it fails in {fails}" if fails else "") + beyond
    )


def _out_of_range(fit: Fit, name: str) -> str:
    """What is not believed of a parameter."""
    parameter = fit.model.parameter(name)
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    value = f"{fit.parameters[name].value:.3g}{unit}"
    return f"{name} = {value} is at or beyond the end of {parameter.low:g} to {parameter.high:g}{unit}"
