"""The search over sets of effects: none, singles, pairs, triples, each fitted to its global minimum."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from sandbot_model.data.conditions import Cells
from sandbot_model.discovery.residual import Description, describe_residual
from sandbot_model.discovery.verdict import Verdict, best_earned, claim, passes, sound, worth
from sandbot_model.fitting.fit import Fit, fitted_at
from sandbot_model.fitting.global_minimum import solve
from sandbot_model.fitting.parallel import Map, Progress
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.model import Model, model_of

SURVIVORS = 9
"""Single effects that go into every pair among themselves."""
NOT_EXCLUDED = 4.0
"""Rise of the deviance up to which an effect of a given strength may be there: two standard deviations."""
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


class EffectSearch:
    """The sets tried so far and what to try next."""

    def __init__(
        self, cells: Cells, effects: Mapping[str, Effect], base: str, fit_all: Map, progress: Progress
    ) -> None:
        self.cells, self.effects, self.base, self.robot = cells, effects, base, cells.robot
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
        models = [model_of(self.base, (name,), self.effects, self.robot, self._at_start(name)) for name in names]
        points = self.fit_all(solve, [(model, self.cells, base.warm_start, True) for model in models])
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
        if best.deviance[1] > NEARLY * self.fits[best.effects].goodness.dof:
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
        alone = fitted_at(
            models[0], self.cells, solve((models[0], self.cells, self.fits[left.effects].warm_start, False))
        )
        points = self.fit_all(solve, [(model, self.cells, alone.warm_start, True) for model in models[1:]])
        fits = [fitted_at(model, self.cells, point) for model, point in zip(models[1:], points, strict=True)]
        helpful = [
            (one.bic, effects)
            for effects, one in zip(sets, fits, strict=True)
            if sound(one) and alone.deviance - one.deviance > claim(one)
        ]
        return min(helpful, default=(0.0, ()))[1]

    def _at_start(self, name: str) -> dict[str, float]:
        """Where one effect's parameters usually are."""
        return {f"{name}.{one.name}": one.start for one in self.effects[name].parameters}

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
            known = None if parent is None else parent.warm_start
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
