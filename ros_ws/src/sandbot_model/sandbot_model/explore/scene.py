"""One trial on a common time axis: the measurements, the state of the bed, and the model's legs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sandbot_common import topics
from sandbot_common.arrays import Floats
from sandbot_common.errors import InputError
from sandbot_common.suggest import did_you_mean
from sandbot_model.data.conditions import cell_of
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.geometry import stance_angle, step_from_lift
from sandbot_model.physics.observables import CM, Observable
from sandbot_model.report import waveforms
from sandbot_model.report.figures import as_json
from sandbot_model.report.waveforms import Waveform
from sandbot_record.bags.reader import Bag
from sandbot_record.trials.from_bags import start_ns
from sandbot_record.trials.table import Trials

BED = {"height_m": (topics.BED_HEIGHT.name, "range"), "blower": (topics.BED_BLOWER.name, "data"),
       "phi": (topics.BED_PHI.name, "data")}  # fmt: skip
"""Quantities of the bed → (topic, field)."""
MAX_POINTS = 600
"""Most points kept of a bed record."""
MARGIN = 0.1
"""Free space around the picture of the legs, in leg radii."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A trial with the model of its condition; t = 0 is the start of the legs."""

    waveform: Waveform
    cell: int
    model_m_s: Floats
    """v_x by the model, at the legs' times, (m,)."""
    reach_rad: float
    """Largest leg angle in stance by the model; 0 where it swims."""
    radius_m: float
    axle_height_m: float
    arc_rad: float
    """Arc of a c-leg, from the hip to the tip."""
    bed: Mapping[str, tuple[Floats, Floats]]
    """(times [s], values) of each recorded quantity of the bed."""
    tripods: tuple[int, int]
    """Index of a representative leg of the first and the second tripod."""

    @property
    def end_s(self) -> float:
        """Time of the last sample."""
        return float(self.waveform.time_s[-1])

    @property
    def turned(self) -> Floats:
        """Angles of both tripods from straight down, wrapped to ±π, (m, 2)."""
        return wrapped(self.waveform.leg_angle_rad[:, list(self.tripods)])

    @property
    def axle_m(self) -> Floats:
        """Height of the axle above the surface by the model, (m,): on a leg that holds, or with the belly down."""
        above = self.radius_m * (np.cos(self.turned) - np.cos(self.reach_rad))
        return np.asarray(self.axle_height_m + np.where(self.holds, above, 0.0).max(axis=1, initial=0.0))

    @property
    def frame(self) -> tuple[float, float, float]:
        """Half the width of a picture of the legs, and its height above and below the surface [leg radii]."""
        belly, highest = self.axle_height_m / self.radius_m, float(self.axle_m.max()) / self.radius_m
        return 2.0 + 5 * MARGIN, highest + 2.0 + MARGIN, 2.0 - belly + MARGIN

    @property
    def holds(self) -> np.ndarray[Any, np.dtype[np.bool_]]:
        """Whether each tripod's legs hold, (m, 2)."""
        return (np.abs(self.turned) <= self.reach_rad) & (self.reach_rad > 0)

    def to_dict(self) -> dict[str, Any]:
        """The scene as JSON for the page, in its units: s, cm, cm/s, rad."""
        shown = self.waveform
        return {
            "end": self.end_s,
            "time": as_json(shown.time_s), "speed": as_json(CM * shown.speed_m_s),
            "legTime": as_json(shown.leg_time_s), "legs": [as_json(row) for row in self.turned.T],
            "holds": self.holds.T.tolist(), "model": as_json(CM * self.model_m_s), "axle": as_json(CM * self.axle_m),
            "radius": CM * self.radius_m, "belly": CM * self.axle_height_m,
            "bed": {name: [as_json(times), as_json(values)] for name, (times, values) in self.bed.items()},
        }  # fmt: skip


def wrapped(angle_rad: Floats) -> Floats:
    """The angle wrapped to [-π, π)."""
    return np.mod(angle_rad + np.pi, 2 * np.pi) - np.pi


def scene_of(trials: Trials, bags: Mapping[str, Path], fit: Fit, trial_id: str) -> Scene:
    """The scene of a trial, which must have a bag and belong to a condition of the fit. Raises InputError."""
    cells = cell_of(trials, fit.cells)
    rows = np.flatnonzero(trials.trial_id == trial_id)
    if not len(rows) or cells[rows[0]] < 0:
        used = did_you_mean(trial_id, trials.trial_id[cells >= 0].tolist())
        raise InputError(f"trial {trial_id!r}: no trial of that name is used here{used}")
    if not bags:
        raise InputError(f"trial {trial_id!r} is of a table; {waveforms.NEEDS_BAGS}")
    found, missing = waveforms.read(bags, [trial_id])
    if not found:
        raise InputError(missing[0])
    shown, cell, robot = found[0], int(cells[rows[0]]), fit.model.robot
    if not len(shown.leg_time_s):
        raise InputError(f"{trial_id}: no leg states in its bag, so there is no leg to show")
    lift = fit.predicted[cell, Observable.lift]
    swims = not np.isfinite(lift) or lift <= 0
    model = np.where(shown.leg_time_s >= 0, waveforms.modelled(shown, fit, cell), 0.0)
    return Scene(
        shown, cell, model,
        0.0 if swims else float(stance_angle(step_from_lift(lift, robot.leg_radius_m), robot.leg_radius_m)),
        robot.leg_radius_m, robot.axle_height_m, np.pi + robot.arc_excess_rad, _bed(bags[trial_id]),
        (0, robot.legs_per_tripod),
    )  # fmt: skip


def _bed(path: Path) -> dict[str, tuple[Floats, Floats]]:
    """The recorded quantities of the bed."""
    bag = Bag.open(path)
    zero = start_ns(bag)
    found = {}
    for name, (topic, value) in BED.items():
        if topic in bag.topics:
            columns = bag.columns(topic, value)
            every = slice(None, None, max(1, len(columns.log_time_ns) // MAX_POINTS))
            found[name] = (columns.log_time_ns[every] - zero) / 1e9, np.asarray(columns[value][every], dtype=float)
    return {name: series for name, series in found.items() if len(series[0])}


def phases(waveform: Waveform, tripod: int) -> tuple[Floats, Floats]:
    """Leg angle [rad] of a tripod at the times of v_x, and v_x [m/s], from the second period on; NaN at each wrap."""
    turned = np.unwrap(waveform.leg_angle_rad[:, tripod])
    at = np.interp(waveform.time_s, waveform.leg_time_s, turned)
    walked = (waveform.time_s > 0) & (waveform.time_s <= waveform.leg_time_s[-1])
    later = walked & (at > turned[waveform.leg_time_s >= 0][0] + 2 * np.pi)
    phase, speed = wrapped(at[later]), waveform.speed_m_s[later].astype(float)
    speed[1:][np.diff(phase) < -np.pi] = np.nan
    return phase, speed


def replicates(trials: Trials, fit: Fit, cell: int) -> Sequence[str]:
    """Ids of the trials of a cell."""
    return [str(trials.trial_id[i]) for i in waveforms.trials_of(trials, fit.cells, cell)]
