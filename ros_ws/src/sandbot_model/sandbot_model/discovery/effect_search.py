"""The search over sets of effects: none, singles, pairs, triples, each fitted to its global minimum.

For each size:

1. Choose the sets: every single effect; pairs among the best singles; the best sets with each further effect.
2. Fit each: singles globally; larger sets, and singles where the base model passes, from a warm start at a part.
3. Search globally for the best of those warm-started, and for those that extend the best part of all.
4. Refit the parts of the best sets from the minima of these sets.
5. Stop if some set passes and no further effect earns its place.

A *part* of a set is the set with one effect less.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import wraps
from itertools import combinations
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np

from sandbot_model.data.conditions import Cells
from sandbot_model.discovery.criteria import DEFAULT, Criteria
from sandbot_model.discovery.verdict import RESPONSE_TIME, Names, Verdict, earns_place, leaves_nothing, parts_of, passes
from sandbot_model.fitting.errors import with_sampled_errors
from sandbot_model.fitting.finite import check_finite
from sandbot_model.fitting.fit import Fit, fitted_at
from sandbot_model.fitting.global_minimum import (
    HOPELESS,
    Found,
    Point,
    WarmStart,
    far_above,
    solve,
    solve_first,
    solve_further,
    solve_jumping,
    solve_near,
    solve_near_first,
    solve_near_further,
    worth_jumps,
)
from sandbot_model.fitting.nuisances import Nuisances
from sandbot_model.fitting.parallel import Map, Progress
from sandbot_model.physics.effect import Effect, Parameter, of_robot
from sandbot_model.physics.model import Model, model_of

SURVIVORS = 9
"""Single effects, the best by BIC, that are all paired with one another."""
REFINED = 8
"""Warm-started sets, the best by deviance, that also get a global search."""
LEADERS = 3
"""Sets of a size, the best by BIC, that are extended by each effect of the catalogue."""

P = ParamSpec("P")
Result = TypeVar("Result")


class EffectSearch:
    """The best fit of each set tried so far (``fits``), and which sets to try next."""

    def __init__(
        self,
        cells: Cells,
        effects: Mapping[str, Effect],
        base: str,
        *,
        criteria: Criteria = DEFAULT,
        fit_all: Map = map,
        progress: Progress = lambda _stage, _done, _total: None,
    ) -> None:
        self.cells, self.effects, self.base = cells, of_robot(effects, cells.robot), base
        self.criteria, self.fit_all, self.progress = criteria, fit_all, progress
        self.fits: dict[Names, Fit] = {}
        self.tried: list[Fit] = []
        """Every set fitted under another convention than the catalogue's, also those that are none of ``fits``."""
        self.computed: dict[tuple[object, ...], Any] = {}
        """What functions of this search returned, by function and arguments (``once_per_search``)."""
        inherent = {effect.identifier for effect in self.model(()).walker.effects}
        self.names = [name for name in effects if name not in inherent]
        for name in self.names:
            check_finite(self.model((name,)), cells)

    def judged(self, fits: dict[Names, Fit], effects: Mapping[str, Effect]) -> "EffectSearch":
        """The same search with the ``fits`` that its verdict rests on, of ``effects`` in the conventions chosen."""
        other = copy(self)
        other.fits, other.effects = fits, {**self.effects, **effects}
        return other

    def run(self, max_effects: int, enough: Callable[[int], bool] = lambda _size: False) -> None:
        """Try ever larger sets until a size suffices (see ``_size_suffices``), or ``enough`` says so."""
        self._fit_sets("base", [()])
        if max_effects > 0:
            self._fit_sets("singles", [(name,) for name in self.names])
            self._refit_parts(1)
        for size in range(2, max_effects + 1):
            if self._size_suffices(size - 1) or enough(size - 1):
                return
            self._fit_sets(f"sets of {size}", self._larger_sets(size))
            self._refit_parts(size)

    def ladder(self, verdict: Verdict) -> list[Fit]:
        """Fits from the base model to the verdict's set; each step adds the effect that lowers the deviance most."""
        steps, remaining = [self.fits[()]], list(verdict.effects)
        while remaining:
            options = self.extended(steps[-1].effects, remaining)
            new = self.near([self.model(names) for names in self._not_yet_fitted(options)], steps[-1])
            known = [self.fits[names] for names in options if names in self.fits]
            steps.append(min([*known, *new], key=lambda fit: fit.deviance))
            remaining = [name for name in remaining if name not in steps[-1].effects]
        return steps

    def ranked(self, size: int) -> list[Fit]:
        """The sets of a size, the lowest BIC first."""
        return sorted((fit for names, fit in self.fits.items() if len(names) == size), key=lambda fit: fit.bic)

    def extended(self, names: Names, more: Iterable[str] | None = None) -> list[Names]:
        """The set extended by one effect, for each effect of the catalogue or of ``more``."""
        return [self._sorted((*names, name)) for name in more or self.names if name not in names]

    def strengths(self, beside: Names) -> list[tuple[str, Parameter]]:
        """Effects outside a set that have exactly one parameter with a neutral value, and that parameter."""
        found = []
        for name in self.names:
            own = [parameter for parameter in self.effects[name].parameters if parameter.neutral is not None]
            found += [(name, own[0])] if name not in beside and len(own) == 1 else []
        return found

    def model(self, names: Names, held: Mapping[str, float] | None = None) -> Model:
        """The model of a set, with some parameters held at given values."""
        return model_of(self.base, names, self.effects, self.cells.robot, held)

    def near(
        self,
        models: Sequence[Model],
        smaller: Fit,
        nuisances: Nuisances | None = None,
        also: Sequence[Sequence[WarmStart]] = (),
    ) -> list[Fit]:
        """Models fitted from a warm start at the fit of a smaller model, with its nuisances if no others are given, and
        from further starts of each (``also``)."""
        shared = smaller.nuisances if nuisances is None else nuisances
        more = also or [()] * len(models)
        tasks = [
            (model, self.cells, (smaller.warm_start, *its), shared) for model, its in zip(models, more, strict=True)
        ]
        return self.solved(tasks)

    def solved(self, tasks: Sequence[Any], solver: Callable[[Any], Point] = solve_near) -> list[Fit]:
        """Fits at the minima that a solver finds for tasks (model, cells, where to start, nuisances)."""
        points = self.fit_all(solver, tasks)
        return [fitted_at(model, cells, at, own) for (model, cells, _, own), at in zip(tasks, points, strict=True)]

    def fit(self, stage: str, sets: Sequence[Names], *, nearby: bool) -> None:
        """Fit sets, from warm starts only or globally; the better of an earlier fit and this one is kept."""
        if not sets:
            return
        models = [self.model(names) for names in sets]
        points = (
            self._search_in_stages(stage, models, [self._starts(names) for names in sets], nearby=nearby)
            if self.fits
            else self._map(stage, solve, [(model, self.cells, None) for model in models])
        )
        self._keep_better(sets, self.fits_with_plausible_delta_t(models, points))

    def fits_with_plausible_delta_t(self, models: Sequence[Model], points: Iterable[Point]) -> list[Fit]:
        """Fits at these points, with a plausible Δt where the data allow one.

        If a set of effects fits with Δt beyond its plausible range, Δt is held at the end of that range, provided the
        deviance rises by less than ``not_excluded``: k and effects fitted with an implausible Δt are not credible.
        """
        found = [fitted_at(model, self.cells, point) for model, point in zip(models, points, strict=True)]
        beyond = [at for at, fit in enumerate(found) if fit.effects and leaves_nothing(fit, self.criteria)]
        ends = {at: end for at in beyond if (end := _nearest_plausible_end(found[at])) is not None}
        if not ends:
            return found
        held = [replace(found[at].model, held={RESPONSE_TIME: end}) for at, end in ends.items()]
        tasks = [(model, self.cells, (found[at].warm_start,), None) for model, at in zip(held, ends, strict=True)]
        for at, fit in zip(ends, self.solved(tasks), strict=True):
            if fit.deviance - found[at].deviance < self.criteria.not_excluded:
                found[at] = fit
        return found

    def resolve_unknown_errors(self) -> None:
        """Sample the standard errors that the curvature does not determine, for the best set without lack of fit, if an
        implausible parameter lacks one: whether its value is compatible with the plausible range depends on its error.
        """
        enough = [fit for fit in self.fits.values() if leaves_nothing(fit, self.criteria)]
        best = min(enough, key=lambda fit: fit.bic, default=None)
        if best is not None and any(np.isnan(best.parameters[name].stderr) for name in best.implausible):
            stderr = np.where(np.isnan(best.stderr), with_sampled_errors(best).stderr, best.stderr)
            self.fits[best.effects] = replace(best, stderr=stderr)

    def _starts(self, names: Names) -> tuple[WarmStart, ...]:
        """Warm starts for a set: its best part, and the best part with all its parameter-free effects, which replace a
        formula of the model and change k (see ``_fit_sets``)."""
        best = self._parent(names)
        assert best is not None
        instead = {name for name in names if not self.effects[name].parameters}
        others = [self.fits[part] for part in parts_of(names, self.fits) if instead <= set(part)]
        other = min(others, key=lambda fit: fit.deviance, default=best)
        return (best.warm_start,) if other is best else (best.warm_start, other.warm_start)

    def _search_in_stages(
        self,
        stage: str,
        models: Sequence[Model],
        starts: Sequence[tuple[WarmStart, ...]],
        *,
        nearby: bool,
    ) -> list[Point]:
        """Minima found for these models; a search is abandoned once it is far above the best of all models."""
        look, refine = (solve_near_first, solve_near_further) if nearby else (solve_first, solve_further)
        begun = [near if nearby else near[0] for near in starts]
        tasks = [(model, self.cells, near) for model, near in zip(models, begun, strict=True)]
        found: list[Found] = self._map(stage, look, tasks)
        some = self._hopeful(found, 2 * HOPELESS)
        refined = self._map(f"{stage}, refined", refine, [(*tasks[at], found[at].point) for at in some])
        found = _replaced(found, some, refined)
        if not nearby:
            some = self._hopeful(found, HOPELESS)
            some = [at for at in some if worth_jumps(models[at], self.cells, found[at].deviance)]
            jumps = [(models[at], self.cells, found[at].point) for at in some]
            found = _replaced(found, some, self._map(f"{stage}, other minima", solve_jumping, jumps))
        return [result.point for result in found]

    def _hopeful(self, found: Sequence[Found], times: float) -> list[int]:
        """Indices of results that are not so many times above the best of all models."""
        limit = far_above(min(self._lowest_deviance(), *(result.deviance for result in found)), times)
        return [at for at, result in enumerate(found) if result.deviance <= limit]

    def _map(self, stage: str, function: Callable[[Any], Any], tasks: Sequence[Any]) -> list[Any]:
        """Results of a function for each task, reporting progress."""
        found = []
        for result in self.fit_all(function, tasks):
            found.append(result)
            self.progress(stage, len(found), len(tasks))
        return found

    def _lowest_deviance(self) -> float:
        return min((fit.deviance for fit in self.fits.values()), default=math.inf)

    def _size_suffices(self, size: int) -> bool:
        """Whether a set of up to this size passes, and extending the best of these earns nothing."""
        self.resolve_unknown_errors()
        done = [fit for names, fit in self.fits.items() if len(names) <= size and passes(fit, self.criteria)]
        if not done:
            return False
        best = min(done, key=lambda fit: fit.bic)
        larger = self.extended(best.effects)
        self._fit_sets(f"beyond {' + '.join(best.effects) or 'base'}", self._not_yet_fitted(larger))
        self._refit_parts(size + 1)
        return not any(earns_place(self.fits, names, best.effects, self.criteria) for names in larger)

    def _larger_sets(self, size: int) -> list[Names]:
        """Sets of a size to fit next: pairs among the survivors, and the leaders extended by every effect."""
        smaller = self.ranked(size - 1)
        wanted = {names for fit in smaller[:LEADERS] for names in self.extended(fit.effects)}
        if size == 2:
            survivors = [fit.effects[0] for fit in smaller[:SURVIVORS]]
            wanted |= {self._sorted(pair) for pair in combinations(survivors, 2)}
        return self._not_yet_fitted(sorted(wanted))

    def _not_yet_fitted(self, sets: Iterable[Names]) -> list[Names]:
        return [names for names in sets if names not in self.fits]

    def _fit_sets(self, stage: str, sets: Sequence[Names]) -> None:
        """Fit sets: singles globally; larger ones, and singles where the base model passes, first from warm starts.

        The best of the warm-started sets whose best part does not pass are then searched globally. A single effect
        without a parameter replaces a formula of the model and changes k, so it is always searched globally.
        """
        quick = [names for names in sets if len(names) > 1 or self._is_small_change(names)]
        self.fit(stage, [names for names in sets if names not in quick], nearby=False)
        self.fit(stage, quick, nearby=True)
        hopeful = [names for names in quick if not self._parent_passes(names)]
        hopeful.sort(key=lambda names: (self._gains_nothing(names), self.fits[names].deviance))
        # No descent finds the effect of a threshold from where it has none, so the best set's extensions are included.
        closer = list(dict.fromkeys((*hopeful[:REFINED], *self._beside_the_best(hopeful))))
        self.fit(f"{stage}, closer", closer, nearby=False)
        if not any(passes(self.fits[names], self.criteria) for names in sets):
            # A set that fits worse than a part of it is not at its minimum yet.
            lost = [names for names in hopeful if names not in closer and self._is_worse(names)]
            self.fit(f"{stage}, worse than a part", lost, nearby=False)

    def _refit_parts(self, size: int) -> None:
        """Refit the parts of the best sets of a size from the minima of these sets, also parts not tried before.

        A set may gain only because it was fitted in the basin of a deeper minimum, where its part fits as well.
        """
        ranked = self.ranked(size)
        wholes = [fit for fit in ranked[:REFINED] if leaves_nothing(fit, self.criteria)] or ranked[:1]
        starts = [(part, whole.warm_start) for whole in wholes for part in combinations(whole.effects, size - 1)]
        tasks = [(self.model(part), self.cells, (start,), None) for part, start in starts]
        found = self.fits_with_plausible_delta_t([model for model, *_ in tasks], self.fit_all(solve_near, tasks))
        self._keep_better([part for part, _ in starts], found)

    def _keep_better(self, sets: Sequence[Names], found: Sequence[Fit]) -> None:
        """Keep each new fit that is better than the present one of its set."""
        for names, fit in zip(sets, found, strict=True):
            if names not in self.fits or fit.deviance < self.fits[names].deviance:
                self.fits[names] = fit

    def _parent(self, names: Names) -> Fit | None:
        """The best part that has been fitted, or else the base model."""
        parents = [self.fits[part] for part in parts_of(names, self.fits)]
        return min(parents, key=lambda parent: parent.deviance, default=self.fits.get(()))

    def _beside_the_best(self, sets: Sequence[Names]) -> list[Names]:
        """Those of these sets that extend the best of all their parts."""
        parents = [parent for names in sets if (parent := self._parent(names)) is not None]
        best = min(parents, key=lambda parent: parent.deviance, default=None)
        return [names for names in sets if best is not None and set(best.effects) < set(names)]

    def _gains_nothing(self, names: Names) -> bool:
        """Whether the added effect stays neutral: a dozen sets of equal deviance must not fill the global search."""
        parent = self._parent(names)
        return parent is not None and math.isclose(self.fits[names].deviance, parent.deviance, rel_tol=1e-6)

    def _is_worse(self, names: Names) -> bool:
        """Whether a set of three or more fits worse than its best part, so that it cannot be at its minimum."""
        parent = self._parent(names)
        return parent is not None and len(names) > 2 and self.fits[names].deviance > parent.deviance * (1 + 1e-6)

    def _parent_passes(self, names: Names) -> bool:
        parent = self._parent(names)
        return parent is not None and names != () and passes(parent, self.criteria)

    def _is_small_change(self, names: Names) -> bool:
        """Whether a single effect can only be a small change: the base model passes, and the effect has a parameter."""
        return self._parent_passes(names) and bool(self.effects[names[0]].parameters)

    def _sorted(self, names: Iterable[str]) -> Names:
        wanted = set(names)
        return tuple(name for name in self.effects if name in wanted)


def once_per_search(
    function: Callable[Concatenate[EffectSearch, P], Result],
) -> Callable[Concatenate[EffectSearch, P], Result]:
    """A function of a search and hashable arguments that is computed once for each search, whatever has been fitted
    since."""

    @wraps(function)
    def cached(search: EffectSearch, /, *arguments: P.args, **options: P.kwargs) -> Result:
        key = function, *arguments, *options.items()
        if key not in search.computed:
            search.computed[key] = function(search, *arguments, **options)
        found: Result = search.computed[key]
        return found

    return cached


def _nearest_plausible_end(fit: Fit) -> float | None:
    """The end of the plausible range of Δt beyond which a fit lies; None if it is inside."""
    value = fit.parameters[RESPONSE_TIME].value
    parameter = fit.model.parameter(RESPONSE_TIME)
    inside = float(np.clip(value, parameter.low, parameter.high))
    return inside if inside != value else None


def _replaced(found: Sequence[Found], at: Sequence[int], better: Sequence[Found]) -> list[Found]:
    """A copy with the results at some indices replaced."""
    changed = dict(zip(at, better, strict=True))
    return [changed.get(index, result) for index, result in enumerate(found)]
