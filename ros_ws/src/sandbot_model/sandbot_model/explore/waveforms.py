"""The trials behind a cell: their rows of the table and, where there are bags, v_x(t) of each replicate."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from sandbot_common import topics
from sandbot_common.errors import InputError
from sandbot_model.cells import Cells, Floats
from sandbot_model.fit import Fit
from sandbot_model.report.figures import as_json
from sandbot_model.report.theme import LIGHT, Spec, Theme, axis, layout
from sandbot_model.report.view import CM
from sandbot_record import table
from sandbot_record.reader import Bag, is_bag
from sandbot_record.trials import Trials

NEAR_OMEGA = 5e-3
MAX_POINTS = 1500


@dataclass(frozen=True)
class Waveform:
    """v_x(t) of one trial; (n,) each, NaN where a marker was lost."""

    trial_id: str
    time_s: Floats = field(metadata={"doc": "from the first sample"})
    speed_m_s: Floats


def bags_of(data: Sequence[Path]) -> dict[str, Path]:
    """Trial id (the bag's name) → bag, for all bags in campaign folders and bags given; empty for tables."""
    bags: list[Path] = []
    for path in data:
        bags += [path] if is_bag(path) else table.bags_in(path)
    # Trial names hold dots (phi0.6000_…): only a file has an ending to take off.
    return {bag.stem if bag.is_file() else bag.name: bag for bag in bags}


def trials_of(trials: Trials, cells: Cells, cell: int) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Rows of the table that belong to a cell, excluded ones too."""
    level = np.abs(trials.phi[:, None] - cells.level_phi).argmin(axis=1)
    near = np.abs(trials.omega_rad_s - cells.omega[cell]) <= NEAR_OMEGA * cells.omega[cell]
    same_gait = np.array([str(gait) == cells.gait[cell] for gait in trials.gait])
    return np.flatnonzero((level == cells.level[cell]) & near & same_gait & np.isfinite(trials.phi))


def read(bags: Mapping[str, Path], trial_ids: Sequence[str]) -> tuple[list[Waveform], list[str]]:
    """Waveforms of the trials, and one line for each that has none and why."""
    if not bags:
        return [], ["These trials come from a table, not from bags: v_x(t) can't be shown."]
    found, missing = [], []
    for trial_id in trial_ids:
        if trial_id not in bags:
            missing.append(f"{trial_id}: no bag of that name")
            continue
        try:
            found.append(_read_one(trial_id, bags[trial_id]))
        except InputError as error:
            missing.append(f"{trial_id}: {error}")
    return found, missing


@lru_cache(maxsize=64)
def _read_one(trial_id: str, bag: Path) -> Waveform:
    columns = Bag.open(bag).columns(topics.SPEED.name, "twist.twist.linear.x")
    if not len(columns.log_time_ns):
        raise InputError(f"{bag}: no messages on {topics.SPEED.name}")
    time = (columns.log_time_ns - columns.log_time_ns[0]) / 1e9
    every = max(1, len(time) // MAX_POINTS)
    return Waveform(trial_id, time[::every], columns["twist.twist.linear.x"][::every])


def figure(waveforms: Sequence[Waveform], fit: Fit, cell: int, theme: Theme = LIGHT) -> Spec:
    """v_x(t) of each replicate with the model's mean and peak speed in that cell."""
    colours = theme.phi_colours(max(len(waveforms), 2))
    data: list[Spec] = [
        {"type": "scatter", "mode": "lines", "name": one.trial_id, "x": as_json(one.time_s),
         "y": as_json(CM * one.speed_m_s), "line": {"color": colour, "width": 1.3}}
        for one, colour in zip(waveforms, colours, strict=False)
    ]  # fmt: skip
    ends = [min(w.time_s[0] for w in waveforms), max(w.time_s[-1] for w in waveforms)]
    for name, column, dash in (("model, mean speed", 0, "solid"), ("model, peak speed", 2, "dash")):
        value = CM * float(fit.predicted[cell, column])
        data.append(
            {"type": "scatter", "mode": "lines", "name": name, "x": as_json(np.array(ends)), "y": [value, value],
             "line": {"color": theme.ink, "width": 2, "dash": dash}}
        )  # fmt: skip
    return {
        "data": data,
        "layout": layout(theme, 320, xaxis=axis(theme, "time (s)"), yaxis=axis(theme, "v_x (cm/s)")),
    }
