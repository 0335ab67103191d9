"""From trials to a verdict: is the base model adequate, and if not, which effects of the catalogue repair it.

None, then every single effect, then pairs (all among the survivors, the best with everybody), then triples: each set is
fitted to its global minimum and judged against the replicates. ``verdict`` draws the conclusion.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from sandbot_model.data.conditions import Cells, noise_floor
from sandbot_model.discovery.effect_search import Candidate, EffectSearch, Sets
from sandbot_model.discovery.next_trials import NextTrial, excluding, next_trials
from sandbot_model.discovery.residual import Description
from sandbot_model.discovery.stability import win_shares
from sandbot_model.discovery.verdict import Verdict, judge, sound
from sandbot_model.fitting.diagnose import StageTest, stage_tests
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.parallel import Map, Progress
from sandbot_model.fitting.plain import data_summary, number, plain
from sandbot_model.physics.effect import Effect

SCHEMA = "sandbot.discovery/1"
TELLING_SD = 0.5
"""Expected gap, in standard deviations of one trial, from which more trials are worth while."""
LEADING = 8
"""Sets compared in the bootstrap."""


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
            "noise_floor_m_s": number(self.noise_floor_m_s),
            "noise_floor": {name: number(value) for name, value in self.noise_floor.items()},
            "steps": [step.to_dict() for step in self.steps],
            "candidates": [plain(candidate) for candidate in self.candidates],
            "verdict": {
                "status": self.verdict.status,
                "effects": list(self.verdict.effects),
                "alternatives": [list(one) for one in self.verdict.alternatives],
                "because": self.verdict.because,
            },
            "next_trials": [plain(trial) for trial in self.next_trials],
            "unseen": list(self.unseen),
            "stability": number(self.stability),
            "stages": [plain(one) for one in self.stages],
            "residual": None if self.residual is None else plain(self.residual),
        }


def discover(
    cells: Cells,
    effects: Mapping[str, Effect],
    *,
    base: str = "simple",
    max_effects: int = 3,
    fit_all: Map = map,
    progress: Progress = lambda _stage, _done, _total: None,
) -> Discovery:
    """Search the catalogue; ``fit_all`` maps the fits (see ``parallel``), ``progress`` hears (stage, done, total)."""
    search = EffectSearch(cells, effects, base, fit_all, progress)
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
