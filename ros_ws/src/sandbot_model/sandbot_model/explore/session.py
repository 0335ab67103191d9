"""Fits of the explorer: each set of effects is fitted once, and sets one switch away are prefetched.

Fits run in worker processes and come back as a ``Point`` (plain arrays); the session rebuilds the ``Fit`` from it. All
methods may be called from any thread.
"""

import contextlib
import math
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_common.errors import InputError
from sandbot_common.parallel import Processes
from sandbot_model.data.conditions import Cells, noise_floor
from sandbot_model.discovery.criteria import DEFAULT, Criteria
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.reproduce import held_by_hand
from sandbot_model.discovery.result import Discovery
from sandbot_model.discovery.selection import Selection, name_of
from sandbot_model.fitting import global_minimum
from sandbot_model.fitting.errors import with_sampled_errors
from sandbot_model.fitting.fit import Fit, fit, fitted_at
from sandbot_model.fitting.global_minimum import Found, Point, WarmStart
from sandbot_model.fitting.parallel import Progress
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.model import Model, model_of
from sandbot_model.report.curves import steps as with_curves
from sandbot_model.report.view import Step

Key = tuple[str, frozenset[str], tuple[str, ...]]
"""Base model, effects, and the formulas that define some of them."""
Errors = dict[str, Floats | None]
"""The fields of a ``Fit`` that state its errors."""


PATIENCE_S = 0.15
"""How long a page waits for a fit that a worker has begun: about the duration of a fit."""


@dataclass(frozen=True)
class Solved:
    """The result sent back by a worker."""

    point: Point
    rmse_m_s: float
    bic: float


def solve(model: Model, cells: Cells, start: WarmStart | None) -> Solved:
    """Fit one model; runs in a worker process."""
    return solved(fit(model, cells, start))


def sampled_errors(model: Model, cells: Cells, point: Point) -> Errors:
    """Errors of a fit, sampled where the deviance is no parabola; runs in a worker process."""
    found = with_sampled_errors(fitted_at(model, cells, point))
    return {"stderr": found.stderr, "covariance": found.covariance, "sample": found.sample}


def solved(found: Fit) -> Solved:
    """The part of a fit that is needed to rebuild it."""
    return Solved(found.point, found.rmse_m_s, found.bic)


class Session:
    """One data set and everything fitted to it so far."""

    def __init__(
        self, cells: Cells, workers: Executor, *, effect_files: Sequence[Path] = (), criteria: Criteria = DEFAULT
    ) -> None:
        self.cells, self._criteria = cells, criteria
        self.noise_floor_m_s = noise_floor(cells)["speed"]
        self._workers = workers
        self._files = tuple(effect_files)
        self._lock = threading.RLock()
        self._solved: dict[Key, Future[Solved]] = {}
        self._starts: dict[Key, WarmStart | None] = {}
        self._steps: dict[Key, Step] = {}
        self._errors: dict[Key, Future[Errors]] = {}
        self._catalogues: dict[tuple[str, ...], dict[str, Effect]] = {}

    def catalogue(self, formulas: Sequence[str] = ()) -> Mapping[str, Effect]:
        """All effects including the user's formulas. Raises InputError for an invalid formula."""
        key = tuple(formulas)
        with self._lock:
            if key not in self._catalogues:
                self._catalogues[key] = catalogue(self._files, key)
            return self._catalogues[key]

    def ladder(self, selection: Selection) -> tuple[Step, ...]:
        """The base model, then one more effect a step, as in ``compare``; fitted if necessary.

        Raises InputError for an unknown effect or parameter.
        """
        self.model(selection)
        return tuple(self._fitted_step(part) for part in _prefixes(selection))

    def step(self, selection: Selection) -> Step:
        """The step shown in the figures: the whole selection, with the values held by hand (k as fitted)."""
        fitted = self._fitted_step(replace(selection, by_hand=()))
        if not selection.by_hand:
            return fitted
        return with_curves([held_by_hand(fitted.fit, selection.by_hand)])[0]

    def with_final_errors(self, selection: Selection) -> Fit | None:
        """The fit shown, with final standard errors; None while a worker is sampling them. From then on ``step`` has
        them too."""
        step, key = self.step(selection), self._key(selection)
        found = step.fit
        if selection.by_hand or not found.model.effects:
            return found
        with self._lock:
            if _lost(self._errors.get(key)):
                self._errors[key] = self._workers.submit(sampled_errors, found.model, found.cells, found.point)
            future = self._errors[key]
            if not future.done() or _lost(future):
                return None
            if found.stderr is not (errors := future.result())["stderr"]:
                found = replace(found, **errors)  # type: ignore[arg-type]
                self._steps[key] = replace(step, fit=found)
        return found

    def fit_ahead(self, selection: Selection) -> None:
        """Submit a fit of every set that is one switch away; cancel earlier ones not yet begun."""
        wanted = {self._key(neighbour): neighbour for neighbour in self._neighbours(selection)}
        keep = {*wanted, *(self._key(part) for part in _prefixes(selection))}
        with self._lock:
            for key in [k for k, future in self._solved.items() if k not in keep and future.cancel()]:
                del self._solved[key]
        for neighbour in sorted(wanted.values(), key=self._bic_alone):
            self._submit(neighbour)

    def previews(self, selection: Selection) -> dict[str, tuple[float, float] | None]:
        """Effect → error in sample [m/s] and BIC if switched; None: not fitted yet, NaN: the fit failed."""
        found: dict[str, tuple[float, float] | None] = {}
        for neighbour in self._neighbours(selection):
            (name,) = set(neighbour.effects) ^ set(selection.effects)
            with self._lock:
                future = self._solved.get(self._key(neighbour))
            found[name] = _preview(future)
        return found

    def suggest(self, selection: Selection, progress: Progress) -> Discovery:
        """Run discovery over the catalogue and the user's formulas, reusing prefetched fits."""
        ended: list[Found] = []

        def fit_all(function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[Any]:
            known = [self._prefetched(function, task, selection, ended) for task in tasks]
            submitted = [
                self._workers.submit(function, task) if found is None else None
                for task, found in zip(tasks, known, strict=True)
            ]
            try:
                for found, later in zip(known, submitted, strict=True):
                    yield found if later is None else later.result()
            except BrokenExecutor:
                raise InputError(Processes.lost) from None

        return discover(
            self.cells,
            self.catalogue(selection.formulas),
            base=selection.model,
            criteria=self._criteria,
            fit_all=fit_all,
            progress=progress,
        )

    def _prefetched(
        self, function: Callable[[Any], Any], task: Any, selection: Selection, ended: list[Found]
    ) -> Point | Found | None:
        """The result of a task of discovery, if the page has made the same search from the same start; ``ended`` keeps
        the searches that need no further step."""
        if function in (global_minimum.solve, global_minimum.solve_first):
            model, cells, start = task
            point = self._fitted_ahead(model, start, selection) if cells is self.cells else None
            if point is None or function is global_minimum.solve:
                return point
            ended.append(Found(point, fitted_at(model, self.cells, point).deviance))
            return ended[-1]
        if function in (global_minimum.solve_further, global_minimum.solve_jumping):
            return next((found for found in ended if found.point is task[-1]), None)
        return None

    def model(self, selection: Selection) -> Model:
        """The model selected. Raises InputError for an unknown effect."""
        return model_of(selection.model, selection.effects, self.catalogue(selection.formulas), self.cells.robot)

    def _fitted_ahead(self, model: Model, start: WarmStart | None, selection: Selection) -> Point | None:
        """The minimum of a model that a prefetched fit found from the same start, if there is one."""
        key = self._key(replace(selection, model=model.base, effects=model.identifiers))
        with self._lock:
            future, begun = self._solved.get(key), self._starts.get(key)
        if model.held or _preview(future) is None or not _same_start(start, begun):
            return None
        assert future is not None
        return None if future.exception() else future.result().point

    def _bic_alone(self, selection: Selection) -> float:
        """BIC with only the last effect, if fitted; sorts prefetching by the most helpful effect."""
        alone = replace(selection, effects=selection.effects[-1:])
        with self._lock:
            previewed = _preview(self._solved.get(self._key(alone)))
        return previewed[1] if previewed and math.isfinite(previewed[1]) else math.inf

    def _neighbours(self, selection: Selection) -> Iterator[Selection]:
        inherent = {effect.identifier for effect in self.model(replace(selection, effects=())).walker.effects}
        for name in self.catalogue(selection.formulas):
            if name in selection.effects:
                yield selection.toggled([effect for effect in selection.effects if effect != name])
            elif name not in inherent:
                yield selection.toggled([*selection.effects, name])

    def _fitted_step(self, selection: Selection) -> Step:
        key = self._key(selection)
        with self._lock:
            if key in self._steps:
                return self._steps[key]
        try:
            fitted = self._fitted(selection)
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            raise InputError(f"{' + '.join(selection.effects)}: no fit to these trials: {error}") from error
        step = with_curves([fitted])[0]
        with self._lock:
            return self._steps.setdefault(key, step)

    def _fitted(self, selection: Selection) -> Fit:
        """The fit of a selection; computed here if no worker has begun it, or the worker takes too long."""
        future, model = self._submit(selection), self.model(selection)
        if not future.cancel():
            # A pool reports queued tasks as running, and workers have low priority.
            with contextlib.suppress(TimeoutError, BrokenExecutor):
                return fitted_at(model, self.cells, future.result(PATIENCE_S).point)
        start, key = self._warm_start(selection), self._key(selection)
        found = fit(model, self.cells, start)
        made: Future[Solved] = Future()
        made.set_result(solved(found))
        with self._lock:
            self._solved[key], self._starts[key] = made, start
        return found

    def _warm_start(self, selection: Selection) -> WarmStart | None:
        """The warm start given by the fit without the last effect, if there is one."""
        with self._lock:
            parent = self._steps.get(self._key(replace(selection, effects=selection.effects[:-1])))
        return parent.fit.warm_start if parent and selection.effects else None

    def _submit(self, selection: Selection) -> "Future[Solved]":
        """The fit of a selection, submitted if new, with a warm start from the fit without its last effect."""
        key = self._key(selection)
        with self._lock:
            if _lost(self._solved.get(key)):
                model, start = self.model(selection), self._warm_start(selection)
                self._solved[key], self._starts[key] = self._workers.submit(solve, model, self.cells, start), start
            return self._solved[key]

    def _key(self, selection: Selection) -> Key:
        catalogue = self.catalogue(selection.formulas)
        own = [text for text in selection.formulas if name_of(text) in selection.effects]
        return selection.model, frozenset(selection.effects) & set(catalogue), tuple(own)


def _same_start(first: WarmStart | None, second: WarmStart | None) -> bool:
    if first is None or second is None:
        return first is second
    return first.deviance == second.deviance and dict(first.parameters) == dict(second.parameters)


def _lost(future: "Future[Any] | None") -> bool:
    """Whether a task was never submitted, or its worker was killed."""
    return future is None or (
        future.done() and not future.cancelled() and isinstance(future.exception(), BrokenExecutor)
    )


def _preview(future: "Future[Solved] | None") -> tuple[float, float] | None:
    if future is None or _lost(future) or future.cancelled() or not future.done():
        return None
    if future.exception() is not None:
        return math.nan, math.nan
    return future.result().rmse_m_s, future.result().bic


def _prefixes(selection: Selection) -> list[Selection]:
    return [
        replace(selection, effects=selection.effects[:count], by_hand=()) for count in range(len(selection.effects) + 1)
    ]
