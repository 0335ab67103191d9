"""A posterior sample, for a deviance with cliffs and many local minima.

The condition at which the robot stops walking determines k for a given Δt, but neither alone: at another Δt every k and
bed offset has to cross cliffs, where a descent stops. An ensemble crosses them: each walker moves by the difference of
two others (ter Braak 2006, Stat. Comput. 16, 239; emcee: Foreman-Mackey et al. 2013, PASP 125, 306), under a flat prior
within the search ranges. Walkers start all over the plausible range of each parameter whose deviance is not parabolic:
it is held, and all else fitted with so much scatter of k that no single condition near a switch dominates.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from sandbot_common.arrays import Bools, Floats
from sandbot_model.fitting.jacobian import slope_by_ln_k
from sandbot_model.fitting.levenberg_marquardt import bounds, descend
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.nuisances import Nuisances
from sandbot_model.fitting.states import States, joined

if TYPE_CHECKING:
    import emcee

SCATTERS = (0.02, 0.01, 0.005)
"""Additional scatter of ln k between conditions, reduced from fit to fit."""
ITERATIONS = 15
HELD = 2.0 ** -np.arange(2, 8)
"""Distances to either side at which a parameter is held, in plausible ranges."""
MAX_EXCESS = 2.0
"""Deviance above the minimum, per unknown, above which no walker starts: twice the expected value."""
LN_K_REACH = 0.5
"""Largest change of ln k of a level, or of an offset of it."""
JITTER = 5e-4
"""Standard deviation of the walkers' initial positions, in search ranges."""
MEMBERS = 24
"""Least number of walkers; also more than twice the unknowns."""
BURN_IN, STEPS = 120, 200
"""Steps of each half of the burn-in, between which stray walkers are replaced, and steps that are kept."""
STRAY = 5.0
"""Deviance above the walkers' median, in standard deviations of its expected distribution, that makes one a stray."""
SEED = 1


def posterior_points(problem: Problem, begin: States, free: Bools, along: Sequence[int]) -> Floats:
    """Posterior points ``(points, n)``, relative to a state (one row), of the n unknowns of θ and ln k that are ``free
    (parameters + levels,)``.

    ``along`` are the parameters, by index in θ, along which the deviance is not parabolic.
    """
    problem, begin = _single_cell_offsets_marginalised(problem, begin)
    ensemble = _Ensemble(problem, begin, free)
    members = ensemble.initial(joined([begin, *(_held(problem, begin, index) for index in along)]))
    sampler = ensemble.sampler(len(members))
    members = ensemble.strays_replaced(sampler.run_mcmc(members, BURN_IN, skip_initial_state_check=True))
    members = sampler.run_mcmc(members, BURN_IN, skip_initial_state_check=True)
    sampler.reset()
    sampler.run_mcmc(members, STEPS, skip_initial_state_check=True)
    return np.asarray((sampler.get_chain(flat=True) - ensemble.here)[:, : np.count_nonzero(free)])


def moments(points: Floats) -> Floats:
    """Second moments ``(n, n)`` of such points about the state."""
    return np.asarray(points.T @ points / len(points))


def _single_cell_offsets_marginalised(problem: Problem, begin: States) -> tuple[Problem, States]:
    """The same with the bed offsets of single cells marginalised, so that they need not be sampled: to first order they
    widen the covariance of the cell mean; near a switch they become the sd of ln k that the cell's replicates share."""
    nuisances = problem.nuisances
    if nuisances is None or not nuisances.of_one_cell.any():
        return problem, begin
    single = nuisances.of_one_cell
    ln_k_sd = np.sqrt(nuisances.by_ln_k[:, single] ** 2 @ nuisances.sd[single] ** 2)
    slope = ln_k_sd[:, None] * slope_by_ln_k(problem, begin)
    cells = replace(problem.cells, covariance=problem.cells.covariance + slope[:, :, None] * slope[:, None, :])
    others = replace(nuisances.only(~single), ln_k_sd=np.where(ln_k_sd > 0, ln_k_sd, nuisances.ln_k_sd))
    found = Problem(problem.model, cells, others)
    return found, found.states(begin.theta, begin.ln_k, begin.slope, problem.bed(begin)[:, ~single])


def _held(problem: Problem, begin: States, index: int) -> States:
    """Fits with θ[index] held at values to both sides, all else fitted with ever less additional scatter of k."""
    parameter = problem.model.parameters[index]
    away = np.concatenate([-HELD, HELD]) * parameter.width
    values = np.unique(np.clip(begin.theta[0, index] + away, *parameter.search))
    rows = np.zeros(len(values), dtype=np.int64)
    theta, ln_k, slope, bed = begin.theta[rows], begin.ln_k[rows], begin.slope[rows], problem.bed(begin)[rows]
    theta[:, index] = values
    for stage in (*(_with_k_scatter(problem, ln_k_sd) for ln_k_sd in SCATTERS), problem):
        found = descend(stage, stage.states(theta, ln_k, slope, bed), ITERATIONS, fixed=[index])
        theta, ln_k, bed = found.theta, found.ln_k, stage.bed(found)
    return found


def _with_k_scatter(problem: Problem, ln_k_sd: float) -> Problem:
    own = problem.nuisances or _no_nuisances(problem.measured)
    return replace(problem, nuisances=own.with_k_scatter(ln_k_sd))


def _no_nuisances(measured: Bools) -> Nuisances:
    cells = len(measured)
    slope, by_ln_k = np.zeros((*measured.shape, 0)), np.zeros((cells, 0))
    return Nuisances((), np.zeros(0), slope, np.zeros(cells), np.zeros(0), by_ln_k)


@dataclass(frozen=True, eq=False)
class _Ensemble:
    """Walkers ``(members, unknowns)``: the ``free`` ones of θ and ln k, then the offsets of the bed. Zero offsets and
    scale errors of the readings take their most likely values."""

    problem: Problem
    begin: States
    free: Bools

    @cached_property
    def here(self) -> Floats:
        """The unknowns at the state ``(unknowns,)``."""
        return np.asarray(self._packed(self.begin)[0])

    @cached_property
    def bed(self) -> Bools:
        """Which nuisances are offsets of the bed."""
        nuisances = self.problem.nuisances
        return np.zeros(0, dtype=bool) if nuisances is None else nuisances.moves_k

    @cached_property
    def ends(self) -> tuple[Floats, Floats]:
        """Lower and upper ends of the search ranges ``(unknowns,)``."""
        low, high = (end[self.free[: len(end)]] for end in bounds(self.problem))
        others = self.here[len(low) :]
        return np.concatenate([low, others - LN_K_REACH]), np.concatenate([high, others + LN_K_REACH])

    def initial(self, places: States) -> Floats:
        """Initial positions, scattered about randomly chosen ``places`` of low deviance."""
        near = np.flatnonzero(places.deviance < places.deviance.min() + MAX_EXCESS * len(self.here))
        jitter = JITTER * np.subtract(*self.ends[::-1])
        random, count = np.random.default_rng(SEED), max(MEMBERS, 2 * len(jitter) + 2)
        members = self._packed(places)[random.choice(near, count)]
        return np.asarray(np.clip(members + jitter * random.normal(size=members.shape), *self.ends))

    def sampler(self, members: int) -> "emcee.EnsembleSampler":
        """The emcee sampler."""
        # Imported here: commands that need no sample do not wait for it.
        import emcee

        moves = [(emcee.moves.DEMove(), 0.7), (emcee.moves.StretchMove(), 0.3)]
        made = emcee.EnsembleSampler(members, len(self.here), self.ln_probability, vectorize=True, moves=moves)
        made.random_state = np.random.RandomState(SEED).get_state()
        return made

    def ln_probability(self, members: Floats) -> Floats:
        """ln posterior of each ``(members,)``."""
        inside = np.clip(members, *self.ends)
        rows, unknowns = np.zeros(len(members), dtype=np.int64), np.count_nonzero(self.free)
        every = np.concatenate([self.begin.theta, self.begin.ln_k], axis=1)[rows]
        every[:, self.free] = inside[:, :unknowns]
        bed = np.full((len(members), len(self.bed)), np.nan)
        bed[:, self.bed] = inside[:, unknowns:]
        theta, ln_k = np.split(every, [self.begin.theta.shape[1]], axis=1)
        deviance = self.problem.states(theta, ln_k, self.begin.slope[rows], bed).deviance
        possible = np.isfinite(deviance) & (inside == members).all(axis=1)
        return np.where(possible, -0.5 * deviance, -np.inf)

    def strays_replaced(self, state: "emcee.State") -> Floats:
        """Positions of the walkers, strays moved to those of randomly chosen others."""
        deviance = -2 * state.log_prob
        far = deviance > np.median(deviance) + STRAY * np.sqrt(2 * len(self.here))
        random, members = np.random.default_rng(SEED), np.array(state.coords)
        members[far] = members[random.choice(np.flatnonzero(~far), np.count_nonzero(far))]
        return members

    def _packed(self, states: States) -> Floats:
        unknowns = np.concatenate([states.theta, states.ln_k], axis=1)[:, self.free]
        return np.concatenate([unknowns, self.problem.bed(states)[:, self.bed]], axis=1)
