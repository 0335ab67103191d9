"""A sample of what data do not exclude, where the deviance has cliffs and many valleys.

Where robots stop walking says how stiff ground is for a Δt, and little of either: held at another Δt every k and offset
has cliffs to cross, at which a descent stops. An ensemble walks across: each member moves by what two others differ by
(ter Braak 2006, Stat. Comput. 16, 239; emcee: Foreman-Mackey et al. 2013, PASP 125, 306), under a flat prior within
what a fit may search. Members begin all over the plausible range of the parameters that are no parabolas, each held
there and all else fitted on a bed so rough that no single condition beside a switch can pull.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from sandbot_model.fitting.jacobian import slope_by_ln_k
from sandbot_model.fitting.levenberg_marquardt import bounds, descend
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.nuisances import Nuisances
from sandbot_model.fitting.states import States, joined
from sandbot_model.physics.arrays import Array, Bool

if TYPE_CHECKING:
    import emcee

ROUGH = (0.02, 0.01, 0.005)
"""How far ln k of a condition scatters on rough beds, one after the other."""
ITERATIONS = 15
HELD = 2.0 ** -np.arange(2, 8)
"""How far to either side a parameter is held, in plausible ranges."""
AWAY = 2.0
"""Deviance above the least, for each unknown, from which no member begins: twice what is usual."""
LN_K_REACH = 0.5
"""How far ln k of a level, or an offset of it, may be from where it is."""
APART = 5e-4
"""How far apart members begin, in what may be searched."""
MEMBERS = 24
"""At least; more than twice the unknowns as well."""
BEFORE, STEPS = 120, 200
"""Steps until members that are still far off are put where others are, and again until they count; those that count."""
LOST = 5.0
"""Standard deviations of a usual deviance above the members' median from which a member is far off."""
SEED = 1


def moments(problem: Problem, begin: States, free: Bool, along: Sequence[int]) -> Array:
    """Mean products ``(n, n)`` of how far the n unknowns that are ``free (parameters + levels,)``, of θ and ln k, are
    from a state, one row.

    ``along`` are the parameters, by index in θ, that are no parabolas.
    """
    problem, begin = _beside_single_conditions(problem, begin)
    ensemble = _Ensemble(problem, begin, free)
    members = ensemble.begun(joined([begin, *(_held(problem, begin, index) for index in along)]))
    sampler = ensemble.sampler(len(members))
    members = ensemble.found_again(sampler.run_mcmc(members, BEFORE, skip_initial_state_check=True))
    members = sampler.run_mcmc(members, BEFORE, skip_initial_state_check=True)
    sampler.reset()
    sampler.run_mcmc(members, STEPS, skip_initial_state_check=True)
    away = (sampler.get_chain(flat=True) - ensemble.here)[:, : np.count_nonzero(free)]
    return np.asarray(away.T @ away / len(away))


def _beside_single_conditions(problem: Problem, begin: States) -> tuple[Problem, States]:
    """The same without offsets of the bed under single conditions, which need not be sampled: to first order about a
    state they widen the covariance of what was measured there, and beside a switch replicates walk by what they share.
    """
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
    """Fits with θ[index] held at values to both sides, all else found on ever less rough beds."""
    parameter = problem.model.parameters[index]
    away = np.concatenate([-HELD, HELD]) * parameter.width
    values = np.unique(np.clip(begin.theta[0, index] + away, *parameter.search))
    rows = np.zeros(len(values), dtype=np.int64)
    theta, ln_k, slope, bed = begin.theta[rows], begin.ln_k[rows], begin.slope[rows], problem.bed(begin)[rows]
    theta[:, index] = values
    for one in (*(_with_k_scatter(problem, ln_k_sd) for ln_k_sd in ROUGH), problem):
        found = descend(one, one.states(theta, ln_k, slope, bed), ITERATIONS, fixed=[index])
        theta, ln_k, bed = found.theta, found.ln_k, one.bed(found)
    return found


def _with_k_scatter(problem: Problem, ln_k_sd: float) -> Problem:
    own = problem.nuisances or _none(len(problem.cells))
    return replace(problem, nuisances=own.with_k_scatter(ln_k_sd))


def _none(cells: int) -> Nuisances:
    return Nuisances((), np.zeros(0), np.zeros((cells, 4, 0)), np.zeros(cells), np.zeros(0), np.zeros((cells, 0)))


@dataclass(frozen=True, eq=False)
class _Ensemble:
    """Members ``(members, unknowns)``: of θ and ln k those that are ``free``, and the offsets of the bed. Readings off
    their zero or scale are what suits best at each place."""

    problem: Problem
    begin: States
    free: Bool

    @cached_property
    def here(self) -> Array:
        """The state ``(unknowns,)``."""
        return np.asarray(self._packed(self.begin)[0])

    @cached_property
    def bed(self) -> Bool:
        """Which nuisances are the bed's."""
        nuisances = self.problem.nuisances
        return np.zeros(0, dtype=bool) if nuisances is None else nuisances.moves_k

    @cached_property
    def ends(self) -> tuple[Array, Array]:
        """What may be searched ``(unknowns,)``."""
        low, high = (end[self.free[: len(end)]] for end in bounds(self.problem))
        others = self.here[len(low) :]
        return np.concatenate([low, others - LN_K_REACH]), np.concatenate([high, others + LN_K_REACH])

    def begun(self, places: States) -> Array:
        """Members about some of the places."""
        near = np.flatnonzero(places.deviance < places.deviance.min() + AWAY * len(self.here))
        apart = APART * np.subtract(*self.ends[::-1])
        random, count = np.random.default_rng(SEED), max(MEMBERS, 2 * len(apart) + 2)
        members = self._packed(places)[random.choice(near, count)]
        return np.asarray(np.clip(members + apart * random.normal(size=members.shape), *self.ends))

    def sampler(self, members: int) -> "emcee.EnsembleSampler":
        """Moves them."""
        # Imported now: no command that needs no sample waits for it.
        import emcee

        moves = [(emcee.moves.DEMove(), 0.7), (emcee.moves.StretchMove(), 0.3)]
        made = emcee.EnsembleSampler(members, len(self.here), self.ln_probability, vectorize=True, moves=moves)
        made.random_state = np.random.RandomState(SEED).get_state()
        return made

    def ln_probability(self, members: Array) -> Array:
        """Of each ``(members,)``."""
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

    def found_again(self, state: "emcee.State") -> Array:
        """The members, those that are far off where others are."""
        deviance = -2 * state.log_prob
        far = deviance > np.median(deviance) + LOST * np.sqrt(2 * len(self.here))
        random, members = np.random.default_rng(SEED), np.array(state.coords)
        members[far] = members[random.choice(np.flatnonzero(~far), np.count_nonzero(far))]
        return members

    def _packed(self, states: States) -> Array:
        unknowns = np.concatenate([states.theta, states.ln_k], axis=1)[:, self.free]
        return np.concatenate([unknowns, self.problem.bed(states)[:, self.bed]], axis=1)
