"""From trials to a verdict: is the base model adequate, and if not, which effects of the catalogue repair it.

None, then every single effect, then pairs (all among the survivors, the best with everybody), then triples: each set is
fitted to its global minimum and judged against the replicates. ``verdict`` draws the conclusion.
"""

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any

import numpy as np

from sandbot_model.cells import Cells, noise_floor
from sandbot_model.chain import Effect
from sandbot_model.describe import Description, describe_residual
from sandbot_model.fit import Fit, fitted_at
from sandbot_model.formula import formula_effect
from sandbot_model.minimise import solve
from sandbot_model.model import Model, model_of
from sandbot_model.next_trials import NextTrial, excluding, next_trials
from sandbot_model.parallel import Map, Progress
from sandbot_model.robot import Robot
from sandbot_model.stability import win_shares
from sandbot_model.stages import StageTest, stage_tests
from sandbot_model.verdict import Verdict, best_earned, claim, judge, passes, sound, worth

SCHEMA = "sandbot.discovery/1"
SURVIVORS = 9
"""Single effects that go into every pair among themselves."""
TELLING_SD = 0.5
"""Expected gap, in standard deviations of one trial, from which more trials are worth while."""
NOT_EXCLUDED = 4.0
"""Rise of the deviance up to which an effect of a given strength may be there: two standard deviations."""
LEADING = 8
"""Sets compared in the bootstrap."""
REFINED = 8
"""Larger sets that get a global search after a first look."""
NEARLY = 5.0
"""Deviance per degree of freedom up to which a formula may lack just one effect of the catalogue beside it."""
LEADERS = 3
"""Sets that are tried with one more effect of the whole catalogue."""

Sets = dict[tuple[str, ...], Fit]


@dataclass(frozen=True)
class Candidate:
    """What one effect changes when added to the base model (negative: better), and the weight of sets with it."""

    effect: str
    stage: str
    delta_chi2: float
    delta_bic: float
    cv_rmse_m_s: float
    weight: float


@dataclass(frozen=True, eq=False)
class Discovery:
    """Everything ``discover`` found. ``steps`` is the ladder: the base model, then one more effect a step."""

    model: str
    cells: Cells
    noise_floor_m_s: float
    noise_floor: Mapping[str, float]
    steps: tuple[Fit, ...]
    candidates: tuple[Candidate, ...]
    verdict: Verdict
    next_trials: tuple[NextTrial, ...]
    stability: float = float("nan")
    """Share of bootstrap draws in which the named set, or one of its alternatives, is best among the leading sets."""
    unseen: tuple[str, ...] = ()
    """If the base model is adequate: effects that could be there at their usual strength and not show in these data."""
    stages: tuple[StageTest, ...] = ()
    """Where in the chain the base model fails."""
    residual: Description | None = None
    """If nothing of the catalogue fits: what is left, in the field's terms, as a formula to try."""
    fits: tuple[Fit, ...] = field(default=(), repr=False)

    def to_json(self) -> dict[str, Any]:
        """Plain data of schema ``sandbot.discovery/1``; numbers that can't be told are None."""
        return {
            "schema": SCHEMA,
            "model": self.model,
            "data": data_summary(self.cells),
            "noise_floor_m_s": _number(self.noise_floor_m_s),
            "noise_floor": {name: _number(value) for name, value in self.noise_floor.items()},
            "steps": [fit_summary(step) for step in self.steps],
            "candidates": [_plain(candidate) for candidate in self.candidates],
            "verdict": {
                "status": self.verdict.status,
                "effects": list(self.verdict.effects),
                "alternatives": [list(one) for one in self.verdict.alternatives],
                "because": self.verdict.because,
            },
            "next_trials": [_plain(trial) for trial in self.next_trials],
            "unseen": list(self.unseen),
            "stability": _number(self.stability),
            "stages": [_plain(one) for one in self.stages],
            "residual": None if self.residual is None else _plain(self.residual),
        }


def discover(
    cells: Cells,
    effects: Mapping[str, Effect],
    *,
    base: str = "simple",
    max_effects: int = 3,
    robot: Robot | None = None,
    fit_all: Map = map,
    progress: Progress = lambda _stage, _done, _total: None,
) -> Discovery:
    """Search the catalogue; ``fit_all`` maps the fits (see ``parallel``), ``progress`` hears (stage, done, total)."""
    search = _Search(cells, effects, base, robot or Robot(), fit_all, progress)
    search.run(max_effects)
    verdict = judge(search.fits)
    ladder = search.ladder(verdict)
    floor = noise_floor(cells)
    unseen = search.unseen() if verdict.status == "adequate" else []
    if unseen:
        trials = excluding(search.fits[()], unseen)
        verdict = replace(verdict, because=f"{verdict.because}; {_not_excluded(unseen, trials)}")
    else:
        trials = next_trials([search.fits[one] for one in verdict.alternatives])
    if verdict.status == "ambiguous":
        verdict = replace(verdict, because=f"{verdict.because}; {_split(trials)}")
    return Discovery(
        model=base,
        cells=cells,
        noise_floor_m_s=floor["speed"],
        noise_floor=floor,
        steps=tuple(ladder),
        candidates=tuple(search.candidates()),
        verdict=verdict,
        next_trials=tuple(trials),
        unseen=tuple(one.effects[0] for one in unseen),
        stability=_stability(search.fits, verdict),
        stages=stage_tests(search.fits[()]),
        residual=search.residual() if verdict.status == "unexplained" else None,
        fits=tuple(sorted(search.fits.values(), key=lambda one: one.bic)),
    )


def _split(trials: Sequence[NextTrial]) -> str:
    """What would tell the alternatives apart."""
    telling = [trial for trial in trials if trial.expected_gap_sd > TELLING_SD]
    if not telling:
        return "no trial within this range of φ and ω tells them apart by these observables: another kind is needed"
    best = telling[0]
    return f"most telling: {best.observable} at {best.where} ({best.expected_gap_sd:.1f} standard deviations of one)"


def _not_excluded(unseen: Sequence[Fit], trials: Sequence[NextTrial]) -> str:
    """Which effects could hide in these data, and what would show them."""
    names = ", ".join(one.effects[0] for one in unseen)
    shown = {trial.separates[1]: trial for trial in reversed(trials) if trial.expected_gap_sd > TELLING_SD}
    how = "; ".join(f"{name}: {trial.observable} at {trial.where}" for name, trial in shown.items())
    return f"at their usual strength these would not show in it: {names}" + (f" (what would show {how})" if how else "")


def _stability(fits: Sets, verdict: Verdict) -> float:
    named = verdict.alternatives or ((),)
    leading = sorted((one for one in fits.values() if sound(one)), key=lambda one: one.bic)[:LEADING]
    leading += [fits[one] for one in named if fits[one] not in leading]
    shares = win_shares(leading, np.random.default_rng(0))
    return sum(share for fit, share in zip(leading, shares, strict=True) if fit.effects in named)


class _Search:
    """The sets tried so far and what to try next."""

    def __init__(
        self, cells: Cells, effects: Mapping[str, Effect], base: str, robot: Robot, fit_all: Map, progress: Progress
    ) -> None:
        self.cells, self.effects, self.base, self.robot = cells, effects, base, robot
        self.fit_all, self.progress = fit_all, progress
        self.fits: Sets = {}
        inherent = {effect.identifier for effect in self._model(()).walker.effects}
        self.names = [name for name in effects if name not in inherent]

    def run(self, max_effects: int) -> None:
        """Grow the sets while that is worth it."""
        self._try("base", [()])
        if max_effects > 0:
            self._try("singles", [(name,) for name in self.names])
        for size in range(2, max_effects + 1):
            if self._settled(size - 1):
                return
            self._try(f"sets of {size}", self._larger(size))

    def ladder(self, verdict: Verdict) -> list[Fit]:
        """From the base to the chosen set, each step the effect that helps most."""
        steps, left = [self.fits[()]], list(verdict.effects)
        while left:
            have = steps[-1].effects
            options = [self._sorted((*have, name)) for name in left]
            self._try("ladder", [one for one in options if one not in self.fits])
            best = min(options, key=lambda one: self.fits[one].deviance)
            steps.append(self.fits[best])
            left = [name for name in left if name not in best]
        return steps

    def unseen(self) -> list[Fit]:
        """The base model with each effect at its usual strength, where the data can't exclude it."""
        base = self.fits[()]
        names = [name for name in self.names if not worth(self.fits, (name,), ())]
        models = [model_of(self.base, (name,), self._at_start(name), self.robot) for name in names]
        points = self.fit_all(solve, [(model, self.cells, base.known, True) for model in models])
        found = [fitted_at(model, self.cells, point) for model, point in zip(models, points, strict=True)]
        return [one for one in found if one.deviance < base.deviance + NOT_EXCLUDED]

    def residual(self) -> Description | None:
        """What is left as a formula: on top of nothing if that is enough, or of effects that go with it."""
        if np.isnan(self.fits[()].lack_of_fit_p):
            return None  # without replicates nothing says what is noise
        found = []
        for effects in dict.fromkeys(((), best_earned(self.fits).effects)):
            if (one := self._described(effects)) is not None:
                if one.enough:
                    return one
                found.append(one)
        if not found:
            return None
        best = min(found, key=lambda one: one.bic)
        if best.deviance[1] > NEARLY * self.fits[best.effects].dof:
            return best
        more = self._described(beside) if (beside := self._beside(best)) else None
        return more if more is not None and more.bic < best.bic else best

    def _described(self, effects: tuple[str, ...]) -> Description | None:
        if effects not in self.fits:
            self._fit("formula, beside an effect", [effects], nearby=False)
        return describe_residual(self.fits[effects], self.effects, self.fit_all, self.progress)

    def _beside(self, left: Description) -> tuple[str, ...]:
        """The formula's set with the effect more that goes with it best; empty if none is worth it.

        An effect of the catalogue beside a strong one of another kind may not be seen before that is described.
        """
        effects = {**self.effects, left.name: formula_effect(left.formula)}
        sets = [self._sorted((*left.effects, name)) for name in self.names if name not in left.effects]
        with_it = [(*left.effects, left.name), *((*one, left.name) for one in sets)]
        models = [model_of(self.base, names, effects, self.robot) for names in with_it]
        alone = fitted_at(models[0], self.cells, solve((models[0], self.cells, self.fits[left.effects].known, False)))
        points = self.fit_all(solve, [(model, self.cells, alone.known, True) for model in models[1:]])
        fits = [fitted_at(model, self.cells, point) for model, point in zip(models[1:], points, strict=True)]
        helpful = [
            (one.bic, effects)
            for effects, one in zip(sets, fits, strict=True)
            if sound(one) and alone.deviance - one.deviance > claim(one)
        ]
        return min(helpful, default=(0.0, ()))[1]

    def _at_start(self, name: str) -> Mapping[str, Effect]:
        """The catalogue with one effect's parameters held where they usually are."""
        held = copy(self.effects[name])
        held.__dict__["parameters"] = tuple(
            replace(one, low=one.start, high=one.start, hard_low=one.start, hard_high=one.start)
            for one in held.parameters
        )
        return {**self.effects, name: held}

    def candidates(self) -> list[Candidate]:
        """Every single effect against the base model, the most useful first."""
        base = self.fits[()]
        weights = bic_weights(self.fits)
        found = []
        for name in self.names:
            if (single := self.fits.get((name,))) is not None:
                weight = sum(value for key, value in weights.items() if name in key)
                change, stage = single.deviance - base.deviance, self.effects[name].stage
                found.append(Candidate(name, stage, change, single.bic - base.bic, single.cv_rmse_m_s, weight))
        return sorted(found, key=lambda one: one.delta_bic)

    def _settled(self, size: int) -> bool:
        """Whether sets of this size, or the base model, leave nothing to explain."""
        done = [one for key, one in self.fits.items() if len(key) <= size and passes(one)]
        if not done:
            return False
        best = min(done, key=lambda one: one.bic)
        more = [self._sorted((*best.effects, name)) for name in self.names if name not in best.effects]
        self._try(f"beyond {' + '.join(best.effects) or 'base'}", [one for one in more if one not in self.fits])
        return not any(worth(self.fits, one, best.effects) for one in more)

    def _larger(self, size: int) -> list[tuple[str, ...]]:
        """Sets one larger: all among the survivors, and the leaders with everybody."""
        smaller = sorted((one for key, one in self.fits.items() if len(key) == size - 1), key=lambda one: one.bic)
        wanted = {self._sorted((*one.effects, name)) for one in smaller[:LEADERS] for name in self.names}
        if size == 2:
            survivors = [one.effects[0] for one in smaller[:SURVIVORS]]
            wanted |= {self._sorted(pair) for pair in combinations(survivors, 2)}
        return [one for one in sorted(wanted) if len(one) == size and one not in self.fits]

    def _try(self, stage: str, sets: Sequence[tuple[str, ...]]) -> None:
        """Fit sets: near what a smaller set has found where that fits already, globally elsewhere.

        Sets of two and more are first looked at near their best smaller set, then the best of them globally.
        """
        quick = [one for one in sets if len(one) > 1 or self._parent_passes(one)]
        self._fit(stage, [one for one in sets if one not in quick], nearby=False)
        self._fit(stage, quick, nearby=True)
        hopeful = [one for one in quick if not self._parent_passes(one)]
        hopeful.sort(key=lambda one: self.fits[one].deviance)
        self._fit(f"{stage}, closer", hopeful[:REFINED], nearby=False)

    def _fit(self, stage: str, sets: Sequence[tuple[str, ...]], *, nearby: bool) -> None:
        tasks = []
        for one in sets:
            parent = self._parent(one)
            known = None if parent is None else parent.known
            tasks.append((self._model(one), self.cells, known, nearby))
        for done, (one, task, point) in enumerate(zip(sets, tasks, self.fit_all(solve, tasks), strict=True), start=1):
            found = fitted_at(task[0], self.cells, point)
            if one not in self.fits or found.deviance < self.fits[one].deviance:
                self.fits[one] = found
            self.progress(stage, done, len(sets))

    def _parent(self, one: tuple[str, ...]) -> Fit | None:
        """The best set with one effect less that has been fitted, or the base model's fit."""
        parents = [self.fits[key] for key in combinations(one, len(one) - 1) if key in self.fits] if one else []
        return min(parents, key=lambda parent: parent.deviance, default=self.fits.get(()))

    def _parent_passes(self, one: tuple[str, ...]) -> bool:
        parent = self._parent(one)
        return parent is not None and one != () and passes(parent)

    def _model(self, names: tuple[str, ...]) -> Model:
        return model_of(self.base, names, self.effects, self.robot)

    def _sorted(self, names: Iterable[str]) -> tuple[str, ...]:
        wanted = set(names)
        return tuple(name for name in self.effects if name in wanted)


def bic_weights(fits: Sets) -> dict[tuple[str, ...], float]:
    """exp(-ΔBIC/2), normalised over all sets tried."""
    scores = np.array([one.bic for one in fits.values()])
    weights = np.exp(-0.5 * np.minimum(scores - scores.min(), 1400.0))
    return dict(zip(fits, (weights / weights.sum()).tolist(), strict=True))


def data_summary(cells: Cells) -> dict[str, Any]:
    """How much data there is."""
    return {
        "trials": cells.trials,
        "excluded_trials": cells.excluded,
        "cells": len(cells),
        "replicated_cells": int((cells.n.max(axis=1) > 1).sum()),
        "observables": list(cells.observables),
    }


def fit_summary(fit: Fit) -> dict[str, Any]:
    """One step of the ladder as plain data."""
    return {
        "effects": list(fit.effects),
        "rmse_m_s": _number(fit.rmse_m_s),
        "cv_rmse_m_s": _number(fit.cv_rmse_m_s),
        "rmse": {name: _number(value) for name, value in fit.rmse.items()},
        "cv_rmse": {name: _number(value) for name, value in fit.cv_rmse.items()},
        "cv_cells": fit.cv_cells,
        "cv_deviance": _number(fit.cv_deviance),
        "chi2": _number(fit.chi2),
        "dof": fit.dof,
        "lack_of_fit_p": _number(fit.lack_of_fit_p),
        "lack_of_fit": {name: _number(value) for name, value in fit.lack_of_fit.items()},
        "parameters": {
            name: {"value": _number(one.value), "stderr": _number(one.stderr)} for name, one in fit.parameters.items()
        },
        "k_n_per_m": [
            {"phi": _number(phi), "value": _number(k), "stderr": _number(error)}
            for phi, k, error in zip(fit.level_phi, fit.k_n_per_m, fit.k_stderr_n_per_m, strict=True)
        ],
        "at_bounds": list(fit.at_bounds),
        "implausible": list(fit.implausible),
        "fails": [_plain(fail) for fail in fit.fails],
    }


def _plain(one: Any) -> dict[str, Any]:
    return {
        name: _number(value) if isinstance(value, float) else list(value) if isinstance(value, tuple) else value
        for name, value in vars(one).items()
    }


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
