"""Nothing in the catalogue fits: what the model misses, in the field's terms, as a formula to try.

Each term of a short library on each lever of the chain (``terms``) is judged by a score test. The most promising are
fitted in earnest, the best is kept; then a second term on the same lever, if that is worth it. So every number reported
is that of a fit to all observables, and the formula is the very effect that was fitted.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sandbot_model.discovery.batch_sd import batch_sd_of
from sandbot_model.discovery.criteria import DEFAULT, Criteria
from sandbot_model.discovery.nuisances_in_words import significant
from sandbot_model.discovery.scored_terms import Guess, guesses, unused_name
from sandbot_model.discovery.term_library import terms
from sandbot_model.discovery.verdict import leaves_nothing
from sandbot_model.fitting.fit import Fit, fitted_at
from sandbot_model.fitting.global_minimum import far_above, solve_near, solve_with_nuisances
from sandbot_model.fitting.parallel import Map, Progress
from sandbot_model.fitting.text import cm_s
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.model import model_of

NAME = "residual"
"""What the formula is called, or residual_2 and so on where the user has one of that name."""
MOST_TERMS = 2
SPAN = 0.5
"""How far a fit may take what a term stands for; a score test far from the minimum predicts the sign at best."""
SEARCHED_GLOBALLY = 4
"""Levers whose best term gets a global search after a first look, and of the best lever all."""


@dataclass(frozen=True)
class SuggestedFormula:
    """What is missing, ``sentence`` for a person and ``formula`` for ``--effect``, and what adding it does."""

    sentence: str
    formula: str
    effects: tuple[str, ...]
    """Of the catalogue, on top of which the formula was fitted."""
    stage: str
    terms: tuple[tuple[str, float], ...]
    """In words, with their coefficients."""
    deviance: tuple[float, float]
    """Without the formula and with it, both beside what the sentence says is granted."""
    cv_rmse_m_s: tuple[float, float]
    """The same of the mean speed's error out of sample."""
    lack_of_fit_p: float
    """With the formula: whether the replicates leave anything to explain."""
    leaves_nothing: bool
    """Whether that is so, jointly and in each observable."""
    bic: float
    """With the formula, its thresholds counted as parameters."""

    @property
    def name(self) -> str:
        """Of the formula as an effect."""
        return self.formula.split(":")[0]

    @property
    def options(self) -> str:
        """The options of ``compare`` that add it."""
        return f"--effect '{self.formula}' --effects {','.join((*self.effects, self.name))}"


def suggest_formula(
    fit: Fit,
    effects: Mapping[str, Effect],
    criteria: Criteria = DEFAULT,
    *,
    fit_all: Map = map,
    progress: Progress = lambda _stage, _done, _total: None,
    hopeless: float = np.inf,
) -> SuggestedFormula | None:
    """The formula that repairs most of what this fit misses; None if no term of the library gains enough, or if none
    that stands for itself comes near a deviance above which all is ``hopeless``."""
    library, name = terms(fit), unused_name(NAME, effects)
    best: _Tried | None = None
    rival: _Tried | None = None
    for number in range(1, MOST_TERMS + 1):
        found, so_far = (fit, None) if best is None else (best.fit, best.guess)
        tried = _tried(
            fit,
            guesses(found, name, library, so_far, criteria.term),
            effects,
            fit_all,
            partial(progress, f"formula, term {number}"),
            hopeless,
        )
        if not tried or tried[0].score > _score(found, so_far) - criteria.term:
            break
        best = tried[0]
        if number == 1:
            rival = next((attempt for attempt in tried if attempt.guess.lever != best.guess.lever), None)
    return None if best is None else _suggestion(fit, best, rival, criteria)


@dataclass(frozen=True, eq=False)
class _Tried:
    """A guess with the coefficients of its fit."""

    guess: Guess
    fit: Fit

    @property
    def errors(self) -> list[float]:
        """Standard errors of the coefficients, NaN where the data do not determine one."""
        return [self.fit.parameters[f"{self.guess.name}.c{i}"].stderr for i in range(len(self.guess.terms))]

    @property
    def score(self) -> float:
        """See ``_score``."""
        return _score(self.fit, self.guess)


def _tried(
    fit: Fit,
    promising: Sequence[Guess],
    effects: Mapping[str, Effect],
    fit_all: Map,
    progress: Callable[[int, int], None],
    hopeless: float = np.inf,
) -> list[_Tried]:
    """All guesses fitted near this fit, the best of each lever once more anywhere; best first. None where all of them
    stay far above a deviance that is ``hopeless``."""

    def fitted(some: Sequence[Guess], *, nearby: bool) -> list[_Tried]:
        models = [
            model_of(
                fit.model.base,
                (*fit.effects, guess.name),
                {**effects, guess.name: formula_effect(guess.formula(SPAN))},
                fit.model.robot,
            )
            for guess in some
        ]
        found = []
        if nearby:
            points = fit_all(solve_near, [(model, fit.cells, (fit.warm_start,), fit.nuisances) for model in models])
        else:
            points = fit_all(
                solve_with_nuisances, [(model, fit.cells, fit.warm_start, fit.nuisances) for model in models]
            )
        for guess, model, point in zip(some, models, points, strict=True):
            end = fitted_at(model, fit.cells, point, fit.nuisances)
            values = tuple(end.parameters[f"{guess.name}.c{i}"].value for i in range(len(guess.terms)))
            found.append(_Tried(replace(guess, coefficients=values), end))
            progress(len(found), len(some))
        determined = [attempt for attempt in found if all(np.isfinite(attempt.errors))]
        return sorted(determined, key=lambda attempt: attempt.score)

    near = fitted(promising, nearby=True)
    if near and min(attempt.fit.deviance for attempt in near) > far_above(hopeless):
        return []
    best = {attempt.guess.lever: attempt.guess for attempt in reversed(near)}
    leading = [attempt.guess for attempt in near if best[attempt.guess.lever] is attempt.guess][:SEARCHED_GLOBALLY]
    leading += [attempt.guess for attempt in near if leading and attempt.guess.lever == leading[0].lever][1:]
    return sorted([*near, *fitted(leading, nearby=False)], key=lambda attempt: attempt.score)


def _score(fit: Fit, guess: Guess | None) -> float:
    """Deviance, and what each number taken from the data must bring."""
    return fit.deviance + (guess.price if guess else 0.0)


def _granted(found: Fit) -> str:
    """What the fit takes for granted, as the end of a sentence."""
    differ = found.nuisances is not None and batch_sd_of(found)
    words = [*(["batches that differ as the priors say"] if differ else []), *significant(found)]
    return f", granted {' and '.join(words)}" if words else ""


def _suggestion(fit: Fit, best: _Tried, rival: _Tried | None, criteria: Criteria) -> SuggestedFormula:
    found, guess = best.fit, best.guess
    parts = [
        term.words.format(f"({value:+.3g} ± {error:.2g})")
        for term, value, error in zip(guess.terms, guess.coefficients, best.errors, strict=True)
    ]
    on_top = f"on top of {' + '.join(fit.effects)}, " if fit.effects else ""
    cv = (fit.cv_rmse_m_s, found.cv_rmse_m_s)
    enough = leaves_nothing(found, criteria)
    left = "leave nothing to explain" if enough else "still leave something to explain"
    scored = f"the error out of sample goes from {cm_s(cv[0])} to {cm_s(cv[1])}, " if np.isfinite(cv).all() else ""
    sentence = (
        f"{on_top}{guess.lever.words} differs from the model's by {' and '.join(parts)} ({guess.lever.unit}): the "
        f"deviance falls from {fit.deviance:.0f} to {found.deviance:.0f} on {found.goodness.dof} degrees of freedom, "
        f"{scored}and replicates {left} "
        f"(p = {found.lack_of_fit_p:.2g}){_granted(found)}"
    )
    if rival is not None and rival.score < best.score + criteria.clearly:
        sentence += f"; {rival.guess.lever.words}, by {rival.guess.terms[0].words.format('so much')}, does as well"
    return SuggestedFormula(
        sentence=sentence,
        formula=guess.formula(),
        effects=fit.effects,
        stage=guess.lever.stage,
        terms=tuple(
            (term.words.format("").strip(), value) for term, value in zip(guess.terms, guess.coefficients, strict=True)
        ),
        deviance=(fit.deviance, found.deviance),
        cv_rmse_m_s=cv,
        lack_of_fit_p=found.lack_of_fit_p,
        leaves_nothing=enough,
        bic=found.bic + float(np.log(found.problem.measured.sum())) * sum(term.switches for term in guess.terms),
    )
