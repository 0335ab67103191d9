"""Nothing in the catalogue fits: what is left, in the field's terms, as a formula to try.

Each term of a short library on each lever of the chain (``terms``) is judged by a score test (Rao 1948): to first
order, how far would the deviance fall if it were added and all parameters of the fit adjusted? The most promising are
fitted in earnest, the best is kept; then a second term on the same lever, if that is worth it. So every number reported
is that of a fit to all observables, and the formula is the very effect that was fitted.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, count

import numpy as np

from sandbot_model.discovery.criteria import DEFAULT, Criteria
from sandbot_model.discovery.term_library import LEVERS, Lever, Term, terms
from sandbot_model.fitting.fit import Fit, fitted_at
from sandbot_model.fitting.global_minimum import solve
from sandbot_model.fitting.levenberg_marquardt import project_out, tangent_basis
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.parallel import Map, Progress
from sandbot_model.physics.arrays import Array
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.model import model_of

NAME = "residual"
"""What the formula is called, or residual_2 and so on where the user has one of that name."""
MOST_TERMS = 2
EACH = 3
"""Terms of one lever that are fitted."""
FREE = 0.5
"""How far a fit may take what a term stands for; a score test far from the minimum predicts the sign at best."""
HOPELESS = 0.2
"""Share of the largest gain predicted below which a term is not fitted."""
CLOSER = 4
"""Levers whose best term gets a global search after a first look, and of the best lever all."""
CLOSE = 0.98
"""Correlation from which two terms say the same."""


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
    """Without the formula and with it."""
    cv_rmse_m_s: tuple[float, float]
    """The same of the mean speed's error out of sample."""
    lack_of_fit_p: float
    """With the formula: whether the replicates leave anything to explain."""
    bic: float
    """With the formula, its thresholds counted as parameters."""

    def passes(self, criteria: Criteria = DEFAULT) -> bool:
        """Whether replicates leave nothing to explain."""
        return self.lack_of_fit_p >= criteria.lack_of_fit

    @property
    def name(self) -> str:
        """Of the formula as an effect."""
        return self.formula.split(":")[0]

    @property
    def options(self) -> str:
        """The options of ``compare`` that add it."""
        return f"--effect '{self.formula}' --effects {','.join((*self.effects, self.name))}"


@dataclass(frozen=True, eq=False)
class _Guess:
    """Terms on a lever, with coefficients to start from, and the gain expected of it."""

    name: str
    lever: Lever
    terms: tuple[Term, ...]
    coefficients: tuple[float, ...]
    gain: float
    direction: Array
    per_number: float
    """See ``Criteria.term``."""

    def formula(self, least_change: float = 0.0) -> str:
        """The effect. Coefficients may go to minus themselves or thrice as far, at least so far that what they stand
        for changes by ``least_change``.
        """
        body = " + ".join(term.times(f"c{i}") for i, term in enumerate(self.terms))
        ranges = ""
        for i, (c, term) in enumerate(zip(self.coefficients, self.terms, strict=True)):
            span = max(2 * abs(c), least_change / max(float(np.abs(term.values).max()), 1e-9))
            ranges += f"; c{i} [1] in {c - span:.3g}..{c + span:.3g}"
        return f"{self.name}: {self.lever.stage}: {self.lever.assignment(body)}{ranges}"

    @property
    def price(self) -> float:
        """Gain in deviance that all numbers taken from the data, coefficients and thresholds, must bring."""
        return self.per_number * (len(self.terms) + sum(term.switches for term in self.terms))


def suggest_formula(
    fit: Fit,
    effects: Mapping[str, Effect],
    criteria: Criteria = DEFAULT,
    *,
    fit_all: Map = map,
    progress: Progress = lambda _stage, _done, _total: None,
) -> SuggestedFormula | None:
    """The formula that repairs most of what this fit misses; None if no term of the library gains enough."""
    library, name = terms(fit), _unused_name(NAME, effects)
    best: _Tried | None = None
    rival: _Tried | None = None
    for number in range(1, MOST_TERMS + 1):
        found, so_far = (fit, None) if best is None else (best.fit, best.guess)
        tried = _tried(
            fit,
            _guesses(found, name, library, so_far, criteria.term),
            effects,
            fit_all,
            partial(progress, f"formula, term {number}"),
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

    guess: _Guess
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
    guesses: Sequence[_Guess],
    effects: Mapping[str, Effect],
    fit_all: Map,
    progress: Callable[[int, int], None],
) -> list[_Tried]:
    """All guesses fitted near this fit, the best of each lever once more anywhere; best first."""

    def fitted(some: Sequence[_Guess], *, nearby: bool) -> list[_Tried]:
        models = [
            model_of(
                fit.model.base,
                (*fit.effects, guess.name),
                {**effects, guess.name: formula_effect(guess.formula(FREE))},
                fit.model.robot,
            )
            for guess in some
        ]
        found = []
        points = fit_all(solve, [(model, fit.cells, fit.warm_start, nearby) for model in models])
        for guess, model, point in zip(some, models, points, strict=True):
            end = fitted_at(model, fit.cells, point)
            values = tuple(end.parameters[f"{guess.name}.c{i}"].value for i in range(len(guess.terms)))
            found.append(_Tried(replace(guess, coefficients=values), end))
            progress(len(found), len(some))
        determined = [attempt for attempt in found if all(np.isfinite(attempt.errors))]
        return sorted(determined, key=lambda attempt: attempt.score)

    near = fitted(guesses, nearby=True)
    best = {attempt.guess.lever: attempt.guess for attempt in reversed(near)}
    leading = [attempt.guess for attempt in near if best[attempt.guess.lever] is attempt.guess][:CLOSER]
    leading += [attempt.guess for attempt in near if leading and attempt.guess.lever == leading[0].lever][1:]
    return sorted([*near, *fitted(leading, nearby=False)], key=lambda attempt: attempt.score)


def _unused_name(name: str, names: Iterable[str]) -> str:
    """The name, with a number if it is taken."""
    taken = set(names)
    numbered = (f"{name}_{number}" for number in count(2))
    return next(candidate for candidate in chain([name], numbered) if candidate not in taken)


def _guesses(found: Fit, name: str, library: Sequence[Term], so_far: _Guess | None, per_number: float) -> list[_Guess]:
    """What to fit next: the best few terms of every lever, or of the one there is."""
    basis = tangent_basis(found.problem, found.state)
    residual = project_out(found.state.missed[0], basis)
    guesses = []
    for lever in LEVERS if so_far is None else (so_far.lever,):
        slopes = _slopes(found, lever)
        usable = [term for term in library if not (term.needs_depth and lever.stage == "clock")]
        tried = [_guess(name, lever, term, slopes, residual, basis, so_far, per_number) for term in usable]
        guesses += _distinct([guess for guess in tried if guess is not None], per_number)
    most = max((guess.gain for guess in guesses), default=0.0)
    return [guess for guess in guesses if guess.gain > HOPELESS * most]


def _guess(
    name: str,
    lever: Lever,
    term: Term,
    slopes: Array,
    residual: Array,
    basis: Array,
    so_far: _Guess | None,
    per_number: float,
) -> _Guess | None:
    """One more term on a lever; None where the data say too little of it."""
    column = np.zeros(len(residual))
    column[: slopes.size] = (slopes * term.values[:, None]).ravel()
    direction = project_out(column, basis)
    length = float(direction @ direction)
    if length < 1e-6 * float(column @ column) or length < 1.0:
        return None
    coefficient = float(residual @ direction) / length
    before = ((), ()) if so_far is None else (so_far.terms, so_far.coefficients)
    return _Guess(
        name=name,
        lever=lever,
        terms=(*before[0], term),
        coefficients=(*before[1], coefficient),
        gain=length * coefficient**2,
        direction=direction / np.sqrt(length),
        per_number=per_number,
    )


def _distinct(guesses: Sequence[_Guess], per_number: float) -> list[_Guess]:
    """The most promising that do not all say the same."""
    # The plainest is always tried: what is the same everywhere moves the fit most, and is predicted worst.
    chosen = [guess for guess in guesses if guess.gain > per_number and guess.terms[-1].expression == "1"]
    for guess in sorted(guesses, key=lambda guess: guess.gain - guess.price, reverse=True):
        if guess.gain > per_number and all(abs(float(guess.direction @ other.direction)) < CLOSE for other in chosen):
            chosen.append(guess)
        if len(chosen) > EACH:
            break
    return chosen


def _slopes(found: Fit, lever: Lever) -> Array:
    """d(whitened prediction)/d(relative change of the lever), ``(cells, 4)``."""
    catalogue = found.model.catalogue
    name = _unused_name("lever", catalogue)
    change = formula_effect(f"{name}: {lever.stage}: {lever.assignment('c')}; c [1] in -1..1")
    model = model_of(found.model.base, (*found.effects, name), {**catalogue, name: change}, found.model.robot)
    at = model.names.index(f"{name}.c")
    theta = np.insert(found.state.theta[0], at, 0.0)
    problem = Problem(model, found.cells)
    states = problem.states(theta[None], found.state.ln_k, found.state.slope)
    return np.asarray(problem.jacobian(states)[0][..., at])


def _score(fit: Fit, guess: _Guess | None) -> float:
    """Deviance, and what each number taken from the data must bring."""
    return fit.deviance + (guess.price if guess else 0.0)


def _suggestion(fit: Fit, best: _Tried, rival: _Tried | None, criteria: Criteria) -> SuggestedFormula:
    found, guess = best.fit, best.guess
    parts = [
        term.words.format(f"({value:+.3g} ± {error:.2g})")
        for term, value, error in zip(guess.terms, guess.coefficients, best.errors, strict=True)
    ]
    on_top = f"on top of {' + '.join(fit.effects)}, " if fit.effects else ""
    cv = (fit.cv_rmse_m_s, found.cv_rmse_m_s)
    enough = (
        "leave nothing to explain"
        if found.lack_of_fit_p >= criteria.lack_of_fit
        else "still leave something to explain"
    )
    sentence = (
        f"{on_top}{guess.lever.words} differs from the model's by {' and '.join(parts)} ({guess.lever.unit}): the "
        f"deviance falls from {fit.deviance:.0f} to {found.deviance:.0f} on {found.goodness.dof} degrees of freedom, "
        f"the error out of sample goes from {100 * cv[0]:.2f} to {100 * cv[1]:.2f} cm/s, and replicates {enough} "
        f"(p = {found.lack_of_fit_p:.2g})"
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
        bic=found.bic + float(np.log(found.problem.measured.sum())) * sum(term.switches for term in guess.terms),
    )
