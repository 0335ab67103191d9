"""Trials used, trials excluded and why, what these data can't show, and what is odd about them."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from sandbot_common.errors import InputError
from sandbot_common.files import base_name
from sandbot_model.data.conditions import Cells
from sandbot_model.data.quality import checked
from sandbot_model.physics.gait import assumption
from sandbot_model.physics.observables import Observable
from sandbot_model.report.view import Provenance
from sandbot_record.bags.reader import is_bag
from sandbot_record.trials import from_bags as table
from sandbot_record.trials.table import Trials


def bags_of(data: Sequence[Path]) -> dict[str, Path]:
    """Trial id (the bag's name) → bag, for all bags given or in the campaign folders given; empty for tables."""
    bags: list[Path] = []
    for path in data:
        bags += [path] if is_bag(path) else table.bags_in(path)
    return {base_name(bag): bag for bag in bags}


def lost_bags(bags: Mapping[str, Path], trials: Trials) -> tuple[tuple[str, str], ...]:
    """(name, reason) of each bag that yielded no trial."""
    known = {str(name) for name in trials.trial_id}
    lost = []
    for name, bag in bags.items():
        if name not in known:
            try:
                table.row_from_bag(bag)
            except InputError as error:
                lost.append((name, str(error)))
    return tuple(lost)


def provenance(trials: Trials, cells: Cells, lost: Sequence[tuple[str, str]] = ()) -> Provenance:
    """Used and excluded trials, and one sentence for each limit or oddity of these data.

    ``lost`` are (bag, reason) of recordings that yielded no trial.
    """
    rows = zip(trials.trial_id, trials.phi, trials.omega_rad_s, trials.speed_m_s, trials.status, strict=True)
    excluded = list(lost)
    for trial_id, phi, omega, speed, status in rows:
        if reason := _reason({"phi": phi, "omega_rad_s": omega, "speed_m_s": speed}, str(status)):
            excluded.append((str(trial_id), reason))
    return Provenance(cells.trials, tuple(excluded), limits(cells), checked(trials) + cells.notes)


def _reason(needed: Mapping[str, float], status: str) -> str:
    """Why a trial was excluded; empty if it was used."""
    missing = [name for name, value in needed.items() if not np.isfinite(value)]
    if status not in ("", "ok"):
        return f"status: {status}"
    return f"{', '.join(missing)} not measured" if missing else ""


def limits(cells: Cells) -> tuple[str, ...]:
    """What these cells can't show, and why: one sentence each; empty for a full campaign."""
    notes = []
    if len(cells.level_phi) == 1:
        notes.append(
            f"How walking depends on volume fraction: every trial is at φ = {cells.level_phi[0]:.3f}, so effects that "
            "differ only in φ look alike."
        )
    if len(np.unique(cells.omega)) == 1:
        notes.append(
            f"How walking depends on leg frequency: every trial is at ω = {cells.omega[0]:.4g} rad/s, so Δt can't be "
            "separated from k."
        )
    if cells.pure_error_dof[Observable.speed] == 0:
        notes.append(
            "Noise floor, error bars and the lack-of-fit test: no condition was repeated, so scatter can't be "
            "separated from model error. Two or more trials at one (φ, ω) would do."
        )
    if assumed := assumption(cells.gait):
        notes.append(
            f"How fast legs turn while they stand: {assumed}. A table's column gait names "
            "another: HGCS, UNIFORM or CUSTOM(θ_s θ_0 d_c), in rad."
        )
    absent = [observable.label for observable in Observable if observable.name not in cells.observables]
    if absent:
        lock = "" if "lift" in cells.observables else "; without lift there is no geometry lock to check"
        notes.append(f"{', '.join(absent).capitalize()}: not measured in these trials{lock}.")
    return tuple(notes)
