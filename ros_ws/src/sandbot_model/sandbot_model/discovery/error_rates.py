"""The verdict's error rates for one design, from campaigns simulated from a fit and judged as the real one was.

A simulated campaign has the trials of the real one, each at its φ and ω, with the scatter of its replicates. Its
nuisances are the fitted drift, offsets drawn for each batch where the fit has them, and a lift zero and a speed scale
drawn from their priors. Penetrometer readings are redrawn, too.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.data.conditions import Cells, cell_of, cells_of
from sandbot_model.data.distributions import beta_ppf
from sandbot_model.data.penetrometer import Readings
from sandbot_model.discovery.batch_sd import BATCH, BATCH_SCALE, BATCH_ZERO, batch_sd_of
from sandbot_model.discovery.criteria import DEFAULT, Criteria
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.nuisances_about import ALONG, DRIFT
from sandbot_model.discovery.verdict import NAMES_EFFECTS
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.parallel import Map, Progress
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.gait import clock
from sandbot_model.physics.observables import COLUMNS, Observable, shared_variance
from sandbot_record.trials.table import Trials

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Rate:
    """A count of simulated campaigns, with its 95 % confidence interval (Clopper & Pearson 1934)."""

    count: int
    campaigns: int

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper end."""
        tail, k, n = 0.5 * (1 - CONFIDENCE), self.count, self.campaigns
        low = beta_ppf(tail, k, n - k + 1) if k else 0.0
        return low, beta_ppf(1 - tail, k + 1, n - k) if k < n else 1.0

    def __str__(self) -> str:
        return f"{self.count} of {self.campaigns} ({100 * self.interval[0]:.0f} to {100 * self.interval[1]:.0f} %)"


@dataclass(frozen=True)
class ErrorRates:
    """Verdicts on simulated campaigns of one design in which the ``hidden`` effects are present."""

    hidden: tuple[str, ...]
    statuses: Mapping[str, int]
    named: Rate
    """Verdicts that name the hidden set or list it among the alternatives; if nothing is hidden, ``adequate`` ones."""
    false_claims: Rate
    """Verdicts that name effects, but do not have the hidden set among their alternatives."""

    def to_dict(self) -> dict[str, Any]:
        """Plain data, as ``discover --json`` has it."""
        rates = {"named": self.named, "false_claims": self.false_claims}
        return {
            "hidden": list(self.hidden),
            "statuses": dict(self.statuses),
            **{
                name: {"count": rate.count, "of": rate.campaigns, "at_95": rate.interval}
                for name, rate in rates.items()
            },
        }

    def __str__(self) -> str:
        what = f"with {' + '.join(self.hidden)} hidden: named" if self.hidden else "with nothing hidden: adequate"
        return f"{what} in {self.named}, false claims in {self.false_claims}"


def error_rates(
    trials: Trials,
    truth: Fit,
    effects: Mapping[str, Effect],
    *,
    campaigns: int,
    max_effects: int = 3,
    criteria: Criteria = DEFAULT,
    fit_all: Map = map,
    progress: Progress = lambda _stage, _done, _total: None,
) -> ErrorRates:
    """Judge this many simulated ``campaigns``, in each of which ``truth`` is the true model."""
    hidden, statuses = frozenset(truth.effects), Counter[str]()
    named = claimed = 0
    for done, child in enumerate(np.random.SeedSequence(0).spawn(campaigns), start=1):
        rng = np.random.default_rng(child)
        cells = cells_of(simulated(trials, truth, rng), redrawn_readings(truth, rng))
        verdict = discover(
            cells,
            effects,
            base=truth.model.base,
            max_effects=max_effects,
            criteria=criteria,
            fit_all=fit_all,
            with_limits=False,
        ).verdict
        statuses[verdict.status] += 1
        right = hidden in map(frozenset, verdict.alternatives) if hidden else verdict.status == "adequate"
        named += right
        claimed += verdict.status in NAMES_EFFECTS and not right
        progress("simulated campaigns", done, campaigns)
    return ErrorRates(truth.effects, dict(statuses), Rate(named, campaigns), Rate(claimed, campaigns))


def simulated(trials: Trials, truth: Fit, rng: np.random.Generator) -> Trials:
    """The trials of a campaign with observables redrawn from a fit; NaN where the real ones were not measured."""
    cell = np.where(trials.usable, cell_of(trials, truth.cells), -1)
    known = cell >= 0
    drawn = np.full((len(trials), len(Observable)), np.nan)
    drawn[known] = _observed(trials.select(known), cell[known], truth, rng)
    measured = np.stack([np.asarray(getattr(trials, column), dtype=float) for column in COLUMNS], axis=-1)
    drawn[~np.isfinite(measured)] = np.nan
    columns: dict[str, Any] = {column: drawn[:, index] for index, column in enumerate(COLUMNS)}
    return replace(trials, **columns)


def redrawn_readings(truth: Fit, rng: np.random.Generator) -> Readings | None:
    """Penetrometer readings redrawn from a fit, at the φ, depths and uncertainties of the real ones; None without any.

    As in the fit, each reading has an independent error and all share one scale error; batch offsets do not enter.
    """
    real = truth.cells.pressed
    if real is None:
        return None
    state = truth.state
    force = real.force - truth.problem.missed_forces(state.theta, state.ln_k, state.slope)[0]
    drawn = force + np.linalg.solve(real.whiten, rng.standard_normal(len(real)))
    return Readings(truth.level_phi[real.level] + real.away, real.depth, drawn, real.sd)


def _observed(trials: Trials, cell: Floats, truth: Fit, rng: np.random.Generator) -> Floats:
    """Simulated observables ``(trials, 4)``, with the scatter of single trials and the nuisances that trials share."""
    offset = _ln_k_offset(trials, cell, truth, rng)
    values = np.empty((len(trials), len(Observable)))
    clocks = clock(tuple(str(gait) for gait in trials.gait))
    for value in np.unique(offset):
        at = offset == value
        shifted = replace(truth, point=replace(truth.point, ln_k=truth.point.ln_k + value))
        values[at] = shifted.predict(trials.phi[at], trials.omega_rad_s[at], clocks[at]).observables
    values += np.einsum("tij,tj->ti", _root(truth.cells)[cell], rng.standard_normal(values.shape))
    accuracy = truth.cells.accuracy
    values[:, Observable.lift] += accuracy.lift_zero_m * rng.standard_normal()
    values[:, ALONG] *= 1 + accuracy.speed_scale * rng.standard_normal()
    values[:, Observable.lift] += _batch_offsets(trials, cell, truth, BATCH_ZERO, rng)
    values[:, ALONG] *= 1 + _batch_offsets(trials, cell, truth, BATCH_SCALE, rng)[:, None]
    return values


def _ln_k_offset(trials: Trials, cell: Floats, truth: Fit, rng: np.random.Generator) -> Floats:
    """Offset of each trial's ln k: the fitted drift, and an offset drawn for its batch."""
    offset = np.zeros(len(trials))
    nuisances = truth.nuisances
    if nuisances is None:
        return offset
    offset += _batch_offsets(trials, cell, truth, BATCH, rng)
    for name, (value, _) in zip(nuisances.names, truth.shared, strict=True):
        if name == DRIFT and truth.cells.order is not None:
            offset += value * truth.cells.order[cell]
    return offset


def _batch_offsets(trials: Trials, cell: Floats, truth: Fit, name: str, rng: np.random.Generator) -> Floats:
    """An offset of the nuisance ``name`` drawn for each trial's batch; 0 where the fit has no such nuisance."""
    sd = batch_sd_of(truth)[name] if truth.nuisances is not None else 0.0
    if not sd:
        return np.zeros(len(trials))
    labels = cell if truth.cells.batch_share is None else np.asarray(trials.batch)
    _, batch = np.unique(labels, return_inverse=True)
    return sd * rng.standard_normal(int(batch.max()) + 1)[batch]


def _root(cells: Cells) -> Floats:
    """A root A of the covariance A Aᵀ of one trial in each cell ``(n, 4, 4)``, without what replicates share."""
    shared = shared_variance(cells.accuracy, np.nan_to_num(cells.mean))[:, :, None] * np.eye(len(Observable))
    count = np.sqrt(np.maximum(cells.n, 1).astype(float))
    both = np.isfinite(cells.mean[:, :, None]) & np.isfinite(cells.mean[:, None, :])
    single = np.where(both, (cells.covariance - shared) * count[:, :, None] * count[:, None, :], 0.0)
    variance, axes = np.linalg.eigh(single)
    return np.asarray(axes * np.sqrt(np.maximum(variance, 0.0))[:, None, :])
