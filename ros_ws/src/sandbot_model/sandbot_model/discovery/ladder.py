"""A ladder of fits as a table in a reader's units, as ``compare`` prints it and results display it."""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

from sandbot_model.data.conditions import noise_floor
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.goodness import cells_missed
from sandbot_model.fitting.text import Rows, to_error
from sandbot_model.physics.observables import CM, Observable


def ladder_rows(steps: Sequence[Fit]) -> Rows:
    """Each step's error per observable, in and out of sample, over the noise floor; a step names what it adds."""
    cells = steps[0].cells
    measured = [observable for observable in Observable if observable.name in cells.observables]
    heads = (f"{observable.name.replace('_', chr(10))}\n[{observable.readers_unit}]" for observable in measured)
    floor = noise_floor(cells)
    errors = {o.name: error_of_rms(floor[o.name], int(cells.pure_error_dof[o])) for o in measured}
    names = [_label(steps[0].effects) or steps[0].model.base]
    # A step that adds no effect repeats the previous one with parameters held by hand.
    names += [_label(_added(step, last)) or "the same,\nheld by hand" for last, step in pairwise(steps)]
    rows = [
        ["model", *heads, "speed\nout of\nsample", "lack\nof fit\np", "cells\nmissed"],
        *(_row(step, name, errors) for step, name in zip(steps, names, strict=True)),
    ]
    if any(map(math.isfinite, floor.values())):
        floors = [to_error(CM * floor[name], error) for name, error in errors.items()]
        rows.append(["noise floor", *floors, to_error(CM * floor["speed"], errors["speed"]), "", ""])
    return rows


def error_of_rms(floor: float, dof: int) -> float:
    """Standard error of an rms near the noise floor [cm, cm/s], 1/√(2n) of it; NaN without replicates."""
    return CM * floor / math.sqrt(2 * dof) if dof else math.nan


def _added(step: Fit, last: Fit) -> Sequence[str]:
    return [name for name in step.effects if name not in last.effects]


def _label(added: Sequence[str]) -> str:
    return "\n+ ".join(["", *added])[1:]


def _row(step: Fit, label: str, errors: Mapping[str, float]) -> Sequence[str]:
    return [
        label,
        *(to_error(CM * step.rmse[name], error) for name, error in errors.items()),
        to_error(CM * step.cv_rmse_m_s, errors["speed"]),
        f"{step.lack_of_fit_p:.2g}" if math.isfinite(step.lack_of_fit_p) else "–",
        str(cells_missed(step.fails)) if math.isfinite(step.lack_of_fit_p) else "–",
    ]
