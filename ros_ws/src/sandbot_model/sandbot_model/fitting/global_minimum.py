"""The global minimum of the deviance over θ and one k per level: wide search, descents, scans, basin hopping."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle, islice

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.data.conditions import Cells
from sandbot_model.fitting.levenberg_marquardt import bounds, descend
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.nuisances import Nuisances
from sandbot_model.fitting.scans import bounded, k_response, scan_bed, scan_k, scan_theta
from sandbot_model.fitting.starts import Start, resample, starts
from sandbot_model.fitting.states import States, joined
from sandbot_model.physics.averaging import slope_of
from sandbot_model.physics.geometry import critical_k_n_per_m
from sandbot_model.physics.model import Model

FIRST_ITERATIONS = 4
"""Steps of a first, short descent, after which the worse rows are dropped."""
HALVING = (4, 1)
"""How many rows are kept after each round of short descents."""
ROUNDS = 3
"""Rounds of descents and scans."""
SAME_MINIMUM = 1e-4
"""Rows that agree in every parameter to this tolerance are the same local minimum."""
MINIMA = 4
"""How many of the best local minima are scanned from."""
BASE_STARTS = 5
"""Starts of the base model whose descents are run to convergence."""
HOPELESS, SLACK = 1.5, 100.0
"""A deviance above ``HOPELESS`` times another one (of a nested model, another model or a better minimum) plus ``SLACK``
is not refined."""
NOT_EXCLUDED = 4.0
"""Rise of the deviance, that of two standard errors, up to which a plausible value is preferred."""
HOPS = (0.1, 0.2)
"""Standard deviations of the jumps, used in turn, in plausible ranges of an effect's parameter."""
HOP_SHARED = 0.03
"""The same for Δt and v_swim, relative."""
HOP_ROWS = 32
"""Jumps in random directions evaluated together."""
HOP_PATIENCE = 3
"""Hops without gain after which the search ends."""
HOPS_MOST = 12
HOP_WITHIN = 5.0
"""Deviance per measured value above which a set is not worth hopping: no other minimum would make it fit."""
HOP_GAIN = 0.5
"""Least fall of the deviance for which a hop is accepted."""


@dataclass(frozen=True)
class Point:
    """A point in the space of a model's unknowns, as plain arrays that are cheap to send between processes."""

    theta: Floats
    """``(parameters,)``."""
    ln_k: Floats
    """Of each level's k [N/m], ``(levels,)``."""
    slope: Floats
    """dk/dφ at each level [N/m], ``(levels,)``."""
    shared: Floats | None = None
    """Values of the nuisances ``(nuisances,)``; by default their initial values."""


@dataclass(frozen=True)
class WarmStart:
    """Where to begin: k of each level and the shared parameters by name, as fitted to a smaller model."""

    k_n_per_m: Floats
    parameters: Mapping[str, float]
    deviance: float


@dataclass(frozen=True)
class Found:
    """Intermediate result of a search."""

    point: Point
    deviance: float


def solve(task: tuple[Model, Cells, WarmStart | None]) -> Point:
    """The global minimum; its deviance is never above that of the warm start, a smaller model's fit."""
    return solve_with_nuisances((*task, None))


def solve_with_nuisances(task: tuple[Model, Cells, WarmStart | None, Nuisances | None]) -> Point:
    """The same with nuisances."""
    model, cells, near, nuisances = task
    problem = Problem(model, cells, nuisances)
    return point_at(problem, best_state(problem, near))


def solve_first(task: tuple[Model, Cells, WarmStart]) -> Found:
    """First part of ``solve``: a coarse search and short descents."""
    model, cells, near = task
    return _found(problem := Problem(model, cells), _first_look(problem, near))


def solve_further(task: tuple[Model, Cells, WarmStart, Point]) -> Found:
    """Second part of ``solve``, from the result of the first: descents and scans."""
    model, cells, near, point = task
    return _found(problem := Problem(model, cells), _refined(problem, _state_at(problem, point), near))


def solve_near_first(task: tuple[Model, Cells, tuple[WarmStart, ...]]) -> Found:
    """First part of a search near the fits of smaller models: descents."""
    model, cells, starts_at = task
    return _found(problem := Problem(model, cells), _descended(problem, starts_at))


def solve_near_further(task: tuple[Model, Cells, tuple[WarmStart, ...], Point]) -> Found:
    """Second part, from the result of the first: scans, and a descent."""
    model, cells, _, point = task
    problem = Problem(model, cells)
    return _found(problem, _plausible(problem, _scanned(problem, _state_at(problem, point))))


def solve_jumping(task: tuple[Model, Cells, Point]) -> Found:
    """Last part of ``solve``, from the result of the second: basin hopping, for models with many local minima."""
    model, cells, point = task
    return _found(problem := Problem(model, cells), _plausible(problem, _basin_hop(problem, _state_at(problem, point))))


def worth_jumps(model: Model, cells: Cells, deviance: float) -> bool:
    """Whether basin hopping is worth its time: the deviance is near enough to the noise, and the model may have many
    local minima, because step and depth feed back on each other where a leg meets ground disturbed before."""
    return model.walker.remembers and deviance < HOP_WITHIN * np.isfinite(cells.mean).sum()


def solve_near(task: tuple[Model, Cells, tuple[WarmStart, ...], Nuisances | None]) -> Point:
    """The best minimum near any of the smaller models' fits, with nuisances."""
    return solve_near_unless_hopeless((*task, np.inf))


def solve_near_unless_hopeless(task: tuple[Model, Cells, tuple[WarmStart, ...], Nuisances | None, float]) -> Point:
    """The same; where the first descents end above the task's last item, a deviance, they are not refined."""
    model, cells, starts_at, nuisances, hopeless = task
    problem = Problem(model, cells, nuisances)
    return point_at(problem, _plausible(problem, nearby_state(problem, starts_at, hopeless)))


def solve_from(task: tuple[Model, Cells, Point, Nuisances]) -> Point:
    """The minimum that a point descends to after a small change of the nuisances' initial values."""
    model, cells, point, nuisances = task
    problem = Problem(model, cells, nuisances)
    theta, ln_k = (np.repeat(part[None], 2, axis=0) for part in (point.theta, point.ln_k))
    # With the slopes dk/dφ of the point, and with those of its own k(φ).
    begin = problem.states(theta, ln_k, np.stack([point.slope, _slopes(problem, ln_k)[0]]))
    best = descend(problem, begin).lowest()
    return point_at(problem, _plausible(problem, _scanned(problem, best)))


def far_above(deviance: float, times: float = HOPELESS) -> float:
    """Deviance above which a fit is not worth refining, given the deviance of another one."""
    return times * deviance + SLACK


def point_at(problem: Problem, state: States) -> Point:
    """The point of a state. One row."""
    shared = None if problem.nuisances is None else problem.shared(state)[0]
    return Point(state.theta[0], state.ln_k[0], state.slope[0], shared)


def best_state(problem: Problem, near: WarmStart | None = None) -> States:
    """The global minimum as a state; never above that of ``near`` if this model contains that one. One row."""
    states = _refined(problem, _first_look(problem, near), near)
    if worth_jumps(problem.model, problem.cells, float(states.deviance[0])):
        states = _basin_hop(problem, states)
    return _plausible(problem, states)


def _found(problem: Problem, state: States) -> Found:
    return Found(point_at(problem, state), float(state.deviance[0]))


def _state_at(problem: Problem, point: Point) -> States:
    return problem.states(point.theta[None], point.ln_k[None], point.slope[None])


def _plausible(problem: Problem, states: States) -> States:
    """The same with parameters inside their plausible ranges, where the data do not exclude that. One row.

    The deviance is flat while a switch lies between two cells, so that only prior knowledge says where it is. A value
    outside the plausible range would count against a set that fits as well with one inside.
    """
    ranges = np.array([(parameter.low, parameter.high) for parameter in problem.model.parameters])
    inside = np.clip(states.theta, ranges[:, 0], ranges[:, 1])
    if (inside == states.theta).all():
        return states
    begin = problem.states(inside, states.ln_k, states.slope, problem.bed(states))
    # Held there: where the deviance does not depend on a parameter, a descent could move it out again.
    moved = descend(problem, begin, FIRST_ITERATIONS, fixed=np.flatnonzero((inside != states.theta)[0]).tolist())
    moved = moved if (np.clip(moved.theta, ranges[:, 0], ranges[:, 1]) == moved.theta).all() else states
    return moved if moved.deviance[0] < states.deviance[0] + NOT_EXCLUDED else states


def _first_look(problem: Problem, near: WarmStart | None) -> States:
    """Coarse search, and successive halving of descents. One row; several without a smaller model."""
    levels = len(problem.cells.level_phi)
    critical = critical_k_n_per_m(problem.model.robot)
    k_curve = near.k_n_per_m if near is not None else critical * np.linspace(1.04, 1.34, levels)
    also = None if near is None else _warm_starts(problem.model, near)
    found = starts(problem, slope_of(problem.cells.level_phi, k_curve), k_curve, also=also)
    begin = _states_of(problem, found)
    if near is None:
        # All other models are compared with this one: several descents are run to convergence.
        return _promising(_best_descended(problem, begin, BASE_STARTS), 10 * HOPELESS)
    states = _successively_halved(problem, begin)
    for _ in range(2):
        if states.deviance[0] > far_above(near.deviance, 10 * HOPELESS):
            return states
        more = resample(problem, states.theta[0], states.ln_k[0], states.slope[0])
        other = _successively_halved(problem, _states_of(problem, more)) if more else states
        if other.deviance[0] > states.deviance[0] - 1.0:
            break
        states = other
    return states


def _refined(problem: Problem, states: States, near: WarmStart | None) -> States:
    """Descents and scans from the result of ``_first_look``. One row."""
    if near is None:
        return _descended_and_scanned(problem, states, 2 * ROUNDS)
    found = states if states.deviance[0] > far_above(near.deviance) else _descended_and_scanned(problem, states)
    close = nearby_state(problem, (near,)) if found.deviance[0] > near.deviance else found
    return _plausible(problem, close if close.deviance[0] < found.deviance[0] else found)


def _basin_hop(problem: Problem, states: States) -> States:
    """Basin hopping (Wales & Doye 1997, J. Phys. Chem. A 101, 5111) at temperature zero, ``HOP_ROWS`` jumps a hop.

    One row; deterministic.
    """
    draw = np.random.default_rng(0)
    idle = 0
    for size in islice(cycle(HOPS), HOPS_MOST):
        landed = descend(problem, _jumps(problem, states, draw, size), FIRST_ITERATIONS)
        best = _descended_and_scanned(problem, landed.lowest())
        if best.deviance[0] < states.deviance[0] - HOP_GAIN:
            states, idle = best, 0
        elif (idle := idle + 1) == HOP_PATIENCE:
            break
    return states


def _jumps(problem: Problem, states: States, draw: np.random.Generator, size: float) -> States:
    """Random points about a state: θ scattered with the given size, ln k adjusted to first order."""
    low, high = bounds(problem)
    here = states.theta[0]
    named = zip(here, problem.model.names, problem.model.parameters, strict=True)
    width = np.array([size * parameter.width if "." in name else HOP_SHARED * at for at, name, parameter in named])
    theta = np.clip(here + width * draw.standard_normal((HOP_ROWS, len(here))), low, high)
    ln_k = np.repeat(states.ln_k, HOP_ROWS, axis=0)
    for moved, pull in zip((theta - here).T, k_response(problem, states), strict=True):
        ln_k = ln_k + bounded(moved[:, None] * pull)
    return problem.states(theta, ln_k, states.slope[0])


def _descended_and_scanned(problem: Problem, states: States, rounds: int = ROUNDS) -> States:
    """The best row after alternating descents and scans until neither lowers the deviance."""
    ends: list[States] = []
    moving: list[States] = []
    for _ in range(rounds):
        states = descend(problem, problem.states(states.theta, states.ln_k, _slopes(problem, states.ln_k)))
        moving = []
        states = _promising(states, HOPELESS)
        for row in _distinct_minima(states):
            end = states.take(np.array([row]))
            moved = scan_theta(problem, scan_k(problem, end))
            (ends if moved is end else moving).append(moved)
        if not moving:
            break
        states = joined(moving)
    return min([*ends, *moving], key=lambda end: float(end.deviance[0]))


def _distinct_minima(states: States) -> list[int]:
    """Indices of the rows at distinct local minima, best first."""
    at = np.concatenate([states.theta, states.ln_k], axis=1)
    found: list[int] = []
    for row in np.argsort(states.deviance, kind="stable").tolist():
        if not any(np.allclose(at[row], at[other], rtol=SAME_MINIMUM, atol=SAME_MINIMUM) for other in found):
            found.append(row)
    return found[:MINIMA]


def _promising(states: States, times: float) -> States:
    """Rows whose deviance is not ``far_above`` the lowest."""
    return states.take(np.flatnonzero(states.deviance <= far_above(states.deviance.min(), times)))


def nearby_state(problem: Problem, starts_at: Sequence[WarmStart], hopeless: float = np.inf) -> States:
    """The best minimum near the fits of smaller models, for an addition that can only be a small change. One row.

    Where the first descents end above a deviance that is ``hopeless``, they are not refined.
    """
    best = _descended(problem, starts_at, hopeless)
    return best if best.deviance[0] > hopeless else _scanned(problem, best)


def _descended(problem: Problem, starts_at: Sequence[WarmStart], hopeless: float = np.inf) -> States:
    """The best end of short descents from the fits of smaller models. One row."""
    thetas = [_warm_starts(problem.model, near) for near in starts_at]
    theta = np.concatenate(thetas)
    ln_k = np.repeat(np.log([near.k_n_per_m for near in starts_at]), [len(rows) for rows in thetas], axis=0)
    theta = np.clip(theta, *bounds(problem))
    # A parameter that is held has the same value in every start: each distinct row once, in order.
    some = np.sort(np.unique(np.concatenate([theta, ln_k], axis=1), axis=0, return_index=True)[1])
    theta, ln_k, bed = theta[some], ln_k[some], problem.bed_starts
    theta, ln_k, bed = np.tile(theta, (len(bed), 1)), np.tile(ln_k, (len(bed), 1)), np.repeat(bed, len(theta), axis=0)
    begin = problem.states(theta, ln_k, _slopes(problem, ln_k), bed)
    # Every k is adjusted to the new effect before the rows are compared.
    return descend(problem, begin, 2 * FIRST_ITERATIONS, hopeless=hopeless).lowest()


def _scanned(problem: Problem, state: States) -> States:
    """The result of scans along every unknown, and a descent from there with the slopes of its own k(φ). One row."""
    moved = scan_bed(problem, scan_theta(problem, scan_k(problem, state)))
    begin = problem.states(moved.theta, moved.ln_k, _slopes(problem, moved.ln_k), problem.bed(moved))
    return descend(problem, begin)


def _states_of(problem: Problem, found: Sequence[Start]) -> States:
    low, high = bounds(problem)
    ln_k = np.array([start.ln_k for start in found])
    return problem.states(np.clip([start.theta for start in found], low, high), ln_k, _slopes(problem, ln_k))


def _successively_halved(problem: Problem, states: States) -> States:
    """The best row after successive halving: rounds of short descents, each of which keeps fewer rows."""
    for count in HALVING:
        states = _best_descended(problem, states, count)
    return states


def _best_descended(problem: Problem, states: States, count: int) -> States:
    """The ``count`` lowest rows after a short descent."""
    states = descend(problem, states, FIRST_ITERATIONS)
    return states.take(np.argsort(states.deviance)[:count])


def _slopes(problem: Problem, ln_k: Floats) -> Floats:
    return np.array([slope_of(problem.cells.level_phi, k) for k in np.exp(ln_k)])


def _warm_starts(model: Model, near: WarmStart) -> Floats:
    """Starts at the fit of the smaller model, new parameters at their start, neutral, mild and strong values; one start
    if none is new."""
    starts_at = np.array([parameter.start for parameter in model.parameters])
    for index, name in enumerate(model.names):
        if name in near.parameters:
            starts_at[index] = near.parameters[name]
    if near.parameters.keys() >= set(model.names):
        return starts_at[None]
    none, mild, strong = starts_at.copy(), starts_at.copy(), starts_at.copy()
    for index, (name, parameter) in enumerate(zip(model.names, model.parameters, strict=True)):
        if name not in near.parameters:
            none[index] = parameter.start if parameter.neutral is None else parameter.neutral
            mild[index] = (
                parameter.start
                if parameter.neutral is None
                else parameter.neutral + 0.15 * (parameter.start - parameter.neutral)
            )
            strong[index] = parameter.low + 0.85 * parameter.width
    return np.stack([starts_at, none, mild, strong])
