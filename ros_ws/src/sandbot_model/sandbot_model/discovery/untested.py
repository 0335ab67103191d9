"""Whether the data can test a model at all, decided before any search: enough cell means, pure error known."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.data.clustering import OMEGA_TOLERANCE
from sandbot_model.data.conditions import Cells
from sandbot_model.discovery.criteria import Criteria
from sandbot_model.discovery.next_trials import NextTrial, known_gait
from sandbot_model.discovery.verdict import Verdict, doubtful_values
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.goodness import undetected_miss
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.text import counted
from sandbot_model.physics.model import Model
from sandbot_model.physics.observables import CM, Observable, usual_noise

CONDITIONS, MORE = 6, 2
"""Conditions to repeat or to add, and degrees of freedom of pure error that each of them gives."""
SCATTER_OR_MISS = ("scatter of replicates", "a model that fails")
"""What repetitions separate."""
PLAINLY = 2.0
"""Misfit, in usual standard deviations of a trial, that replicates will probably confirm."""


def untested(cells: Cells, model: Model, criteria: Criteria) -> Verdict | None:
    """The verdict ``untested`` if the cell means can't test the model, or a gross lack of fit would pass the test; None
    if the data can refuse a model."""
    known = int(cells.pure_error_dof.max())
    if missing := _missing_means(problem := Problem(model, cells)):
        means, unknowns = counted(problem.values, "cell mean"), counted(problem.fitted, "parameter")
        where = f"{max(CONDITIONS, missing)} new conditions"
        return _verdict(f"{means} can't test the {unknowns} of the base model; {MORE + 1} trials at each of {where}")
    if (passing := undetected_miss(known, criteria.lack_of_fit)) <= criteria.gross:
        return None
    what = (
        f"{cells.pure_error_from} give {counted(known, 'degree')} of freedom of pure "
        f"error, on which a model that misses every cell mean by {passing:.0f} standard errors would pass"
        if known
        else f"{_no_replicates(cells)}, so pure error is unknown and nothing can be tested"
    )
    return _verdict(f"{what}; {MORE} more trials at each of {counted(min(CONDITIONS, len(cells)), 'condition')}")


def plainly_missed(fit: Fit) -> str:
    """What a model that can't be tested misses by far more than a trial usually scatters, and its implausible values;
    empty if there is nothing."""
    usual = dict(zip(Observable, CM * usual_noise(fit.cells.accuracy), strict=True))
    missed = {observable: CM * fit.goodness.rmse[observable.name] for observable in Observable}
    found = [
        f"{at.label} is missed by {missed[at]:.2g} {at.readers_unit} rms (a trial usually scatters by {usual[at]:.2g})"
        for at in Observable
        if missed[at] > PLAINLY * usual[at]
    ]
    found += [doubtful_values(fit)] if fit.implausible and not fit.undetermined else []
    return f"{'; '.join(found)}: expect lack of fit" if found else ""


def _verdict(why: str) -> Verdict:
    return Verdict("untested", (), (), f"{why} would suffice (next trials)")


def _missing_means(problem: Problem) -> int:
    """Cell means without which no degree of freedom is left to test the model."""
    return max(0, problem.fitted + 1 - problem.values)


def _no_replicates(cells: Cells) -> str:
    if (cells.n > 1).any():
        return "replicates agree to the last digit, as copies or a noise-free computation would"
    return f"no cell has replicates and {_no_error_bars(cells)}"


def _no_error_bars(cells: Cells) -> str:
    """Why error bars do not give pure error either."""
    if not cells.bars_of_trials:
        return "no error bars are given"
    return (
        "the error bars of the speed are those of measuring a single trial, for their rows have a replicate number "
        "or n_trials 1 (a row that is the mean of a condition has none)"
    )


def to_run(cells: Cells, model: Model) -> list[NextTrial]:
    """The trials by which the model can be tested: new conditions if it has too few cell means, else repetitions."""
    missing = _missing_means(Problem(model, cells))
    return _new_conditions(cells, max(CONDITIONS, missing)) if missing else repeats(cells)


def repeats(cells: Cells) -> list[NextTrial]:
    """Conditions to repeat, spread as widely as possible over φ and ω."""
    at = _conditions(cells)
    first = int(np.argmin(_scaled(at).sum(axis=1)))
    chosen = [first, *_farthest(at, [first], min(CONDITIONS, len(cells)) - 1)]
    return [_trial(at[cell], MORE, cells.gait[cell]) for cell in sorted(chosen)]


def repeat_of(cells: Cells, cell: int, separates: tuple[str, str], observable: str = "speed") -> NextTrial:
    """One condition run again."""
    return replace(_trial(_conditions(cells)[cell], MORE, cells.gait[cell], separates), observable=observable)


def _new_conditions(cells: Cells, count: int) -> list[NextTrial]:
    """So many conditions at the same φ and other ω of the same range; if that is too narrow, of half to all of ω."""
    low, high, grid_size = cells.omega.min(), cells.omega.max(), 2 * count
    wide = high - low > grid_size * OMEGA_TOLERANCE * high
    omega = np.asarray(np.round(np.linspace(low if wide else high / 2, high, grid_size), 2), dtype=float)
    return new_conditions(cells, grid_of(cells.level_phi, omega), count)


def grid_of(phi: Floats, omega: Floats) -> Floats:
    """All pairs of φ and ω ``(n, 2)``."""
    return np.stack(np.meshgrid(phi, omega, indexing="ij"), axis=-1).reshape(-1, 2)


def new_conditions(
    cells: Cells, grid: Floats, count: int = CONDITIONS, separates: tuple[str, str] = SCATTER_OR_MISS
) -> list[NextTrial]:
    """``count`` of the conditions ``grid (n, 2)``, as far as possible from those already run and from each other."""
    run = _conditions(cells)
    chosen = _farthest(at := np.concatenate([run, grid]), list(range(len(run))), min(count, len(grid)))
    nearest = {one: int(np.argmin(_distance(at, [one])[: len(run)])) for one in chosen}
    return [_trial(at[one], MORE + 1, cells.gait[nearest[one]], separates) for one in sorted(chosen)]


def _conditions(cells: Cells) -> Floats:
    """φ and ω of each cell ``(n, 2)``."""
    return np.stack([cells.level_phi[cells.level], cells.omega], axis=-1)


def _scaled(at: Floats) -> Floats:
    """The same conditions, with φ and ω each scaled to the range 0 to 1."""
    width = np.ptp(at, axis=0)
    return np.asarray((at - at.min(axis=0)) / np.where(width > 0, width, 1.0))


def _distance(at: Floats, chosen: Sequence[int]) -> Floats:
    """Distance of each condition to the nearest of those chosen."""
    places = _scaled(at)
    return np.asarray(np.linalg.norm(places[:, None] - places[chosen], axis=-1).min(axis=1))


def _farthest(at: Floats, given: Sequence[int], count: int) -> list[int]:
    """Indices of ``count`` conditions, each as far as possible from those ``given`` and from those chosen before it."""
    chosen: list[int] = []
    for _ in range(count):
        distance = _distance(at, [*given, *chosen])
        distance[[*given, *chosen]] = -1.0
        chosen.append(int(np.argmax(distance)))
    return chosen


def _trial(at: Floats, replicates: int, gait: str, separates: tuple[str, str] = SCATTER_OR_MISS) -> NextTrial:
    return NextTrial(
        phi=float(at[0]),
        omega_rad_s=float(at[1]),
        observable="speed",
        separates=separates,
        expected_gap_sd=float("nan"),
        replicates=replicates,
        gait=known_gait(gait),
    )
