"""The trials of a cell: their table rows and, where there are bags, v_x(t) of each replicate with the model's."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from sandbot_common import topics
from sandbot_common.arrays import Floats
from sandbot_common.errors import InputError
from sandbot_common.legs import leg_mount_rad
from sandbot_common.robot import SANDBOT, Robot
from sandbot_model.data.conditions import Cells, cell_of
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.observables import CM, Observable
from sandbot_model.physics.predictor import Predictor
from sandbot_model.report import text
from sandbot_model.report.figures import as_json
from sandbot_model.report.theme import LIGHT, Spec, Theme, axis, layout
from sandbot_record.bags.reader import FIELD_STAMP, Bag
from sandbot_record.trials.cache import file_state
from sandbot_record.trials.from_bags import plan_of, start_ns
from sandbot_record.trials.legs import leg_columns
from sandbot_record.trials.setting import of_bag
from sandbot_record.trials.table import Trials

MAX_POINTS = 1500
DASHES = ("solid", "dot", "dash", "dashdot")
"""Replicates differ in both colour and dash."""


@dataclass(frozen=True, eq=False)
class Waveform:
    """v_x(t) and leg angles of one trial; t = 0 is the start of the legs."""

    trial_id: str
    time_s: Floats  # (n,)
    speed_m_s: Floats
    """NaN where a marker was lost, (n,)."""
    leg_time_s: Floats
    """Empty without leg states, (m,)."""
    leg_angle_rad: Floats
    """Angle of each c-leg's centre, (m, legs)."""
    leg_rate_rad_s: Floats  # (m, legs)


NEEDS_BAGS = "v_x(t) and film need a campaign folder or bags"


def files_of(bag: Path) -> dict[str, Path]:
    """The recording's files, by name."""
    inside = [bag] if bag.is_file() else sorted(bag.iterdir())
    return {path.name: path for path in inside if path.suffix in (".mcap", ".db3")}


def trials_of(trials: Trials, cells: Cells, cell: int) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Row indices of a cell's trials, including excluded ones."""
    return np.flatnonzero(cell_of(trials, cells) == cell)


def read(bags: Mapping[str, Path], trial_ids: Sequence[str]) -> tuple[list[Waveform], list[str]]:
    """Waveforms of the trials, and one line of explanation for each trial without."""
    if not bags:
        return [], [f"These trials come from a table: {NEEDS_BAGS}."]
    found, missing = [], []
    for trial_id in trial_ids:
        if trial_id not in bags:
            missing.append(f"{trial_id}: no bag of that name")
            continue
        try:
            found.append(_read_waveform(trial_id, bags[trial_id], file_state(bags[trial_id])))
        except InputError as error:
            missing.append(f"{trial_id}: {error}")
    return found, missing


@lru_cache(maxsize=64)
def _read_waveform(trial_id: str, path: Path, _state: str) -> Waveform:
    bag = Bag.open(path)
    speed = bag.columns(topics.SPEED.name, "twist.twist.linear.x", *FIELD_STAMP)
    if not len(speed.log_time_ns):
        raise InputError(f"{path}: no messages on {topics.SPEED.name}")
    start = _start_ns(bag, int(speed.stamp_ns[0]))
    every = max(1, len(speed.log_time_ns) // MAX_POINTS)
    time = (speed.stamp_ns - start) / 1e9
    robot = _robot(bag)
    legs = np.empty(0), *np.empty((2, 0, len(robot.leg_order)))
    if topics.LEG_STATES.name in bag.topics:
        states = leg_columns(bag, topics.LEG_STATES.name, robot.leg_order, "position", "velocity", *FIELD_STAMP)
        sparse = slice(None, None, max(1, len(states.log_time_ns) // MAX_POINTS))
        angles = states["position"][sparse] + robot.leg_mount_rad
        legs = (states.stamp_ns[sparse] - start) / 1e9, angles, states["velocity"][sparse]
    return Waveform(trial_id, time[::every], speed["twist.twist.linear.x"][::every], *legs)


def _start_ns(bag: Bag, otherwise: int) -> int:
    """Start of the legs: the sync LED's edge if recorded, else ``otherwise``."""
    try:
        return start_ns(bag)
    except InputError:
        return otherwise


def _robot(bag: Bag) -> Robot:
    """The trial's robot; SandBot if the bag does not state one."""
    try:
        plan = plan_of(bag)
        robot = of_bag(bag, plan, math.nan).robot
        return robot or replace(SANDBOT, leg_mount_rad=leg_mount_rad(plan, topics.TRIAL.name))
    except InputError:
        return SANDBOT


def modelled(waveform: Waveform, fit: Fit, cell: int) -> Floats:
    """The model's v_x [m/s] at the measured leg angles, (m,): along the leg's arc while it holds, 0 otherwise."""
    predictor = Predictor(fit.model, fit.point.theta, fit.level_phi, fit.k_n_per_m)
    cells = fit.cells
    phi, omega, gait = float(cells.level_phi[cells.level[cell]]), float(cells.omega[cell]), cells.gait[cell]
    legs = zip(waveform.leg_angle_rad, waveform.leg_rate_rad_s, strict=True)
    return np.array([predictor.velocity(phi, omega, gait, angle, rate).v_x for angle, rate in legs])


def figure(waveforms: Sequence[Waveform], fit: Fit, cell: int, theme: Theme = LIGHT) -> Spec:
    """v_x(t) of each replicate, and the model's for the leg angles of the first."""
    colours = theme.phi_colours(max(len(waveforms), 2))
    data: list[Spec] = [
        {"type": "scatter", "mode": "lines", "name": waveform.trial_id, "x": as_json(waveform.time_s),
         "y": as_json(CM * waveform.speed_m_s),
         "line": {"color": colour, "width": 1.5, "dash": DASHES[i % len(DASHES)]}}
        for i, (waveform, colour) in enumerate(zip(waveforms, colours, strict=False))
    ]  # fmt: skip
    first = waveforms[0]
    if len(first.leg_time_s):
        speed = np.where(first.leg_time_s >= 0, modelled(first, fit, cell), 0.0)
        data.insert(
            0,
            {"type": "scatter", "mode": "lines", "name": "model", "x": as_json(first.leg_time_s),
             "y": as_json(CM * speed), "line": {"color": theme.faint, "width": 5}},
        )  # fmt: skip
    end = max(float(waveform.time_s[-1]) for waveform in waveforms)
    across = axis(theme, "time from the start of the legs (s)", range=[-0.02 * end, end])
    up = axis(theme, "forward speed v<sub>x</sub> (cm/s)")
    return {"data": data, "layout": layout(theme, 360, xaxis=across, yaxis=up)}


def caption(waveforms: Sequence[Waveform], fit: Fit, cell: int) -> str:
    """Caption of ``figure``."""
    peaks = "; ".join(
        f"{waveform.trial_id} {text.cm_s(float(np.nanmax(waveform.speed_m_s)))}" for waveform in waveforms
    )
    mean, peak = fit.predicted[cell, Observable.speed], fit.predicted[cell, Observable.peak_speed]
    return (
        f"Forward speed against time of {len(waveforms)} replicates. Largest: {peaks}. The model: mean "
        f"{text.cm_s(mean)}, peak {text.cm_s(peak)}. Its waveform (thick grey) is for the first trial's leg angles: "
        "the body follows the leg's arc while the leg holds, and rests in between."
    )
