"""Score tests (Rao 1948) of a library of terms: how far would the deviance fall if a term were added to a lever?

To first order, and with all parameters of the fit readjusted; no term is fitted here.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain, count

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.discovery.term_library import LEVERS, Lever, Term
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.jacobian import cell_jacobian, project_out, tangent_basis
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.model import model_of

PER_LEVER = 4
"""Most terms of one lever that are fitted."""
LEAST_GAIN = 0.2
"""Fraction of the largest predicted gain below which a term is not fitted."""
COLLINEAR = 0.98
"""Correlation from which two terms count as the same."""


@dataclass(frozen=True, eq=False)
class Guess:
    """Terms on a lever, with start values of their coefficients and the gain predicted for the last of them."""

    name: str
    lever: Lever
    terms: tuple[Term, ...]
    coefficients: tuple[float, ...]
    gain: float
    direction: Floats
    per_number: float
    """See ``Criteria.term``."""

    def formula(self, least_change: float = 0.0) -> str:
        """The effect as text. Each coefficient c may range from -c to 3c, and at least so far that its term changes the
        lever by ``least_change``.
        """
        body = " + ".join(term.times(f"c{i}") for i, term in enumerate(self.terms))
        ranges = ""
        for i, (c, term) in enumerate(zip(self.coefficients, self.terms, strict=True)):
            span = max(2 * abs(c), least_change / max(float(np.abs(term.values).max()), 1e-9))
            ranges += f"; c{i} [1] in {c - span:.3g}..{c + span:.3g}"
        return f"{self.name}: {self.lever.stage}: {self.lever.assignment(body)}{ranges}"

    @property
    def price(self) -> float:
        """Gain in deviance required of all numbers chosen from the data: coefficients and thresholds."""
        return self.per_number * (len(self.terms) + sum(term.switches for term in self.terms))


def unused_name(name: str, names: Iterable[str]) -> str:
    """The name, with a number if it is taken."""
    taken = set(names)
    numbered = (f"{name}_{number}" for number in count(2))
    return next(candidate for candidate in chain([name], numbered) if candidate not in taken)


def guesses(found: Fit, name: str, library: Sequence[Term], so_far: Guess | None, per_number: float) -> list[Guess]:
    """What to fit next: the best few terms of every lever, or one more on the lever of ``so_far``."""
    basis = tangent_basis(found.problem, found.state)
    residual = project_out(found.state.all_residuals[0], basis)
    promising = []
    for lever in LEVERS if so_far is None else (so_far.lever,):
        slopes = _slopes(found, lever)
        usable = [term for term in library if not (term.needs_depth and lever.stage == "clock")]
        tried = [_guess(name, lever, term, slopes, residual, basis, so_far, per_number) for term in usable]
        promising += _distinct([guess for guess in tried if guess is not None], per_number)
    most = max((guess.gain for guess in promising), default=0.0)
    return [guess for guess in promising if guess.gain > LEAST_GAIN * most]


def _guess(
    name: str,
    lever: Lever,
    term: Term,
    slopes: Floats,
    residual: Floats,
    basis: Floats,
    so_far: Guess | None,
    per_number: float,
) -> Guess | None:
    """One more term on a lever; None where the data hardly constrain it."""
    column = np.zeros(len(residual))
    column[: slopes.size] = (slopes * term.values[:, None]).ravel()
    direction = project_out(column, basis)
    length = float(direction @ direction)
    if length < 1e-6 * float(column @ column) or length < 1.0:
        return None
    coefficient = float(residual @ direction) / length
    before = ((), ()) if so_far is None else (so_far.terms, so_far.coefficients)
    return Guess(
        name=name,
        lever=lever,
        terms=(*before[0], term),
        coefficients=(*before[1], coefficient),
        gain=length * coefficient**2,
        direction=direction / np.sqrt(length),
        per_number=per_number,
    )


def _distinct(tried: Sequence[Guess], per_number: float) -> list[Guess]:
    """The most promising guesses, no two of them nearly collinear."""
    # The constant term is always tried: it moves the fit most, so its gain is predicted worst.
    chosen = [guess for guess in tried if guess.gain > per_number and guess.terms[-1].expression == "1"]
    for guess in sorted(tried, key=lambda guess: guess.gain - guess.price, reverse=True):
        if guess.gain > per_number and all(
            abs(float(guess.direction @ other.direction)) < COLLINEAR for other in chosen
        ):
            chosen.append(guess)
        if len(chosen) >= PER_LEVER:
            break
    return chosen


def _slopes(found: Fit, lever: Lever) -> Floats:
    """d(whitened prediction)/d(relative change of the lever), ``(cells, 4)``."""
    catalogue = found.model.catalogue
    name = unused_name("lever", catalogue)
    change = formula_effect(f"{name}: {lever.stage}: {lever.assignment('c')}; c [1] in -1..1", tried=True)
    model = model_of(found.model.base, (*found.effects, name), {**catalogue, name: change}, found.model.robot)
    at = model.names.index(f"{name}.c")
    theta = np.insert(found.state.theta[0], at, 0.0)
    problem = Problem(model, found.cells, found.nuisances)
    states = problem.states(theta[None], found.state.ln_k, found.state.slope, found.problem.shared(found.state))
    return np.asarray(cell_jacobian(problem, states)[0][..., at])
