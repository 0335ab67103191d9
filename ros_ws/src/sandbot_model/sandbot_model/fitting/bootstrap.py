"""Standard errors by a bootstrap over trials: how much the parameters would vary with other replicates.

Batches are drawn whole, so that what their trials share varies too, if each of them has trials at every level of φ
(Davison & Hinkley 1997, sec. 3.8). Otherwise trials are drawn with replacement within their cell (Efron &
Tibshirani 1993, ch. 6), so that every condition stays in.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import partial

import numpy as np

from sandbot_common.arrays import Ints
from sandbot_common.errors import InputError
from sandbot_model.data.clustering import conditions, phi_levels
from sandbot_model.data.conditions import cells_of
from sandbot_model.data.penetrometer import Readings
from sandbot_model.fitting.fit import fit
from sandbot_model.fitting.global_minimum import WarmStart
from sandbot_model.fitting.parallel import Map
from sandbot_model.physics.model import Model
from sandbot_record.trials.table import Trials

Values = dict[str, float]
LEAST_BATCHES = 3
"""With fewer, batches are not drawn: they say too little about how far batches differ."""


def bootstrap(
    trials: Trials,
    model: Model,
    draws: int,
    *,
    readings: Readings | None = None,
    near: WarmStart | None = None,
    seed: int = 0,
    fit_all: Map = map,
    each: Callable[[Iterable[Values]], Iterable[Values]] = iter,
) -> Values:
    """Standard error of every parameter, and of k at each level as ``k[i]``, from ``draws`` refits.

    ``readings`` are a penetrometer's, the same in every draw; ``near`` is where the fits begin, ``fit_all`` maps them
    (see ``parallel``) and ``each`` wraps the results, as a progress bar does. Every draw has a seed of its own, so that
    the result does not depend on the number of workers. The variance of draws of n trials from n is (n - 1)/n of that
    of new trials; the result is corrected for it. Raises InputError if draws < 2 or no cell has replicates.
    """
    if draws < 2:
        raise InputError(f"--bootstrap: {draws} draws give no spread; 2 or more are needed")
    trials = trials.select(trials.usable)
    batches = _batches(trials)
    groups = batches or _cells(trials)
    sizes = [len(batches)] if batches else [len(group) for group in groups]
    if max(sizes) < 2:
        raise InputError("--bootstrap: no condition has replicates to draw from")
    redraw = partial(_redraw, trials, groups, bool(batches), model, readings, near)
    found = list(each(fit_all(redraw, np.random.SeedSequence(seed).spawn(draws))))
    size = float(np.mean([size for size in sizes if size > 1]))
    names = [name for name in found[0] if all(name in draw for draw in found)]
    spread = np.std([[draw[name] for name in names] for draw in found], axis=0, ddof=1)
    return dict(zip(names, (spread * np.sqrt(size / (size - 1))).tolist(), strict=True))


def _redraw(
    trials: Trials,
    groups: Sequence[Ints],
    whole: bool,
    model: Model,
    readings: Readings | None,
    near: WarmStart | None,
    seed: np.random.SeedSequence,
) -> Values:
    """The parameters fitted to one draw of whole groups, or of trials from each."""
    rng = np.random.default_rng(seed)
    if whole:
        parts = [groups[at] for at in rng.integers(len(groups), size=len(groups))]
    else:
        parts = [rng.choice(group, len(group)) for group in groups]
    drawn = np.concatenate(parts)
    best = fit(model, cells_of(trials.select(drawn), readings), near)
    ks = {f"k[{i}]": float(k) for i, k in enumerate(best.k_n_per_m)}
    return {name: estimate.value for name, estimate in best.parameters.items()} | ks


def _batches(trials: Trials) -> list[Ints]:
    """Indices of the trials of each batch, in the table's order, if batches are exchangeable; otherwise none."""
    names, batch = np.unique(np.asarray(trials.batch, dtype=str), return_inverse=True)
    level = np.asarray(phi_levels(np.asarray(trials.phi, dtype=float)))
    everywhere = len(set(zip(batch.tolist(), level.tolist(), strict=True))) == len(names) * len(np.unique(level))
    if len(names) < LEAST_BATCHES or "" in names or not everywhere:
        return []
    return sorted((np.flatnonzero(batch == index) for index in range(len(names))), key=lambda group: int(group[0]))


def _cells(trials: Trials) -> list[Ints]:
    """Indices of the trials of each cell."""
    cell, keys = conditions(trials.phi, trials.gait, trials.omega_rad_s)
    return [np.flatnonzero(cell == index) for index in range(keys.shape[1])]
