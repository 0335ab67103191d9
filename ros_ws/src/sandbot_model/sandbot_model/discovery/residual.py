"""A formula for what the model misses where nothing in the catalogue fits, in the field's dimensionless groups.

Each term of a library (``terms``) on each lever of the chain is rated by a score test. The most promising are fitted to
all observables and the best is kept; then a second term on the same lever, if it earns its price. So every number
reported is that of a fit, and the formula is the effect that was fitted.
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
from sandbot_model.fitting.fit import Fit, fitted_at, scored
from sandbot_model.fitting.global_minimum import far_above, solve_near, solve_with_nuisances
from sandbot_model.fitting.parallel import Map, Progress
from sandbot_model.fitting.text import cm_s
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.model import model_of

NAME = "residual"
"""What the formula is called, or residual_2 and so on where the user has one of that name."""
MOST_TERMS = 2
LEAST_CHANGE = 0.5
"""Change of a lever that each term's range allows at least: far from the minimum, a score test gives at best a sign."""
SEARCHED_GLOBALLY = 4
"""Levers whose best term is searched globally after the local fits; of the best lever, all terms are."""


@dataclass(frozen=True)
class SuggestedFormula:
    """What is missing, as a ``sentence`` for a reader and a ``formula`` for ``--effect``, and what adding it does."""

    sentence: str
    formula: str
    effects: tuple[str, ...]
    """Effects of the catalogue on top of which the formula was fitted."""
    stage: str
    terms: tuple[tuple[str, float], ...]
    """In words, with their coefficients."""
    deviance: tuple[float, float]
    """Without the formula and with it, both with the nuisances that the sentence mentions."""
    cv_rmse_m_s: tuple[float, float]
    """The mean speed's error out of sample, without and with the formula."""
    lack_of_fit_p: float
    """With the formula."""
    leaves_nothing: bool
    """Whether the formula leaves no lack of fit, jointly and in each observable."""
    bic: float
    """With the formula, its thresholds counted as parameters."""

    @property
    def name(self) -> str:
        """The formula's name as an effect."""
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
    """The formula that gains most on top of this fit; None if no term of the library gains enough, or if local fits of
    single terms all stay far above the deviance ``hopeless``."""
    library, name = terms(fit), unused_name(NAME, effects)
    best: _FittedGuess | None = None
    rival: _FittedGuess | None = None
    for number in range(1, MOST_TERMS + 1):
        found, so_far = (fit, None) if best is None else (best.fit, best.guess)
        tried = _fit_guesses(
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
class _FittedGuess:
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


def _fit_guesses(
    fit: Fit,
    promising: Sequence[Guess],
    effects: Mapping[str, Effect],
    fit_all: Map,
    progress: Callable[[int, int], None],
    hopeless: float = np.inf,
) -> list[_FittedGuess]:
    """All guesses fitted locally, and the best of the leading levers globally, too; best first. Empty if all local fits
    stay far above the deviance ``hopeless``."""
    near = _fitted(fit, promising, effects, fit_all, progress, nearby=True)
    if near and min(attempt.fit.deviance for attempt in near) > far_above(hopeless):
        return []
    best = {attempt.guess.lever: attempt.guess for attempt in reversed(near)}
    leading = [attempt.guess for attempt in near if best[attempt.guess.lever] is attempt.guess][:SEARCHED_GLOBALLY]
    leading += [attempt.guess for attempt in near if leading and attempt.guess.lever == leading[0].lever][1:]
    searched = _fitted(fit, leading, effects, fit_all, progress, nearby=False)
    return sorted([*near, *searched], key=lambda attempt: attempt.score)


def _fitted(
    fit: Fit,
    some: Sequence[Guess],
    effects: Mapping[str, Effect],
    fit_all: Map,
    progress: Callable[[int, int], None],
    *,
    nearby: bool,
) -> list[_FittedGuess]:
    """The guesses on top of a fit whose coefficients the data determine, fitted locally or globally; best first."""
    base, robot, cells, nuisances = fit.model.base, fit.model.robot, fit.cells, fit.nuisances
    formulas = [formula_effect(guess.formula(LEAST_CHANGE), tried=True) for guess in some]
    models = [
        model_of(base, (*fit.effects, guess.name), {**effects, guess.name: formula}, robot)
        for guess, formula in zip(some, formulas, strict=True)
    ]
    solver, start = (solve_near, (fit.warm_start,)) if nearby else (solve_with_nuisances, fit.warm_start)
    found = []
    points = fit_all(solver, [(model, cells, start, nuisances) for model in models])
    for guess, model, point in zip(some, models, points, strict=True):
        end = fitted_at(model, cells, point, nuisances)
        values = tuple(end.parameters[f"{guess.name}.c{i}"].value for i in range(len(guess.terms)))
        found.append(_FittedGuess(replace(guess, coefficients=values), end))
        progress(len(found), len(some))
    determined = [attempt for attempt in found if all(np.isfinite(attempt.errors))]
    return sorted(determined, key=lambda attempt: attempt.score)


def _score(fit: Fit, guess: Guess | None) -> float:
    """Deviance plus the price of each number chosen from the data."""
    return fit.deviance + (guess.price if guess else 0.0)


def _allowances(found: Fit) -> str:
    """The nuisances of the fit, as the end of a sentence."""
    differ = found.nuisances is not None and batch_sd_of(found)
    words = [*(["batches that differ as the priors say"] if differ else []), *significant(found)]
    return f", allowing for {' and '.join(words)}" if words else ""


def _difference(fitted: _FittedGuess) -> str:
    """What differs from the model, and by how much."""
    found, guess = fitted.fit, fitted.guess
    parts = [
        term.words.format(f"({value:+.3g} ± {error:.2g})" if found.errors_hold else f"({value:+.3g})")
        for term, value, error in zip(guess.terms, guess.coefficients, fitted.errors, strict=True)
    ]
    return f"{guess.lever.words} differs from the model's by {' and '.join(parts)} ({guess.lever.unit})"


def _suggestion(fit: Fit, best: _FittedGuess, rival: _FittedGuess | None, criteria: Criteria) -> SuggestedFormula:
    found, guess = best.fit, best.guess
    on_top = f"on top of {' + '.join(fit.effects)}, " if fit.effects else ""
    cv = (fit.cv_rmse_m_s, found.cv_rmse_m_s)
    enough = leaves_nothing(found, criteria)
    remains = "is within" if enough else "exceeds"
    change = f"the error out of sample goes from {cm_s(cv[0])} to {cm_s(cv[1])}{scored(fit, found)}, "
    sentence = (
        f"{on_top}{_difference(best)}: the deviance falls from {fit.deviance:.0f} to {found.deviance:.0f} on "
        f"{found.goodness.dof} degrees of freedom, {change if np.isfinite(cv).all() else ''}and "
        f"what remains {remains} {fit.cells.scatter} (p = {found.lack_of_fit_p:.2g}){_allowances(found)}"
    )
    if rival is not None and rival.score < best.score + criteria.clearly:
        sentence += f"; alternatively {_difference(rival)}, which fits as well"
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
