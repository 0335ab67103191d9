"""Collects the material of an atlas from trials, fits and bags."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sandbot_common.errors import InputError
from sandbot_model.data.clustering import phi_levels
from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting.fit import Fit, fit
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.gait import clock_signal
from sandbot_model.physics.model import model_of
from sandbot_model.report import waveforms
from sandbot_model.report.atlas.material import Material, Motion, Published, usual
from sandbot_record.trials.table import Trials

LOOSE_PHI = 0.600
"""Loose volume fraction of the paper's pair of trials; the nearest in the data is used."""


def collect(
    trials: Trials, fits: Sequence[Fit], bags: Mapping[str, Path], published: Published | None = None
) -> Material:
    """The material of the plates. ``fits`` is the ladder; ``bags`` are the trials' by name, possibly empty.

    The simple and the full model are fitted as in the paper: to mean speeds up to the largest of each φ.
    """
    trials = trials.select(trials.usable)
    cells = fits[0].cells
    rising = cells_of(_speeds_only(trials.select(_up_to_the_fastest(trials))))
    effects = {effect.identifier: effect for effect in CATALOGUE}
    simple, full = (fit(model_of(base, (), effects, cells.robot), rising) for base in ("simple", "full"))
    return Material(trials, cells, tuple(fits), simple, full, _motions(bags, trials), published)


def _up_to_the_fastest(trials: Trials) -> NDArray[np.bool_]:
    """The trials at each φ up to the leg frequency of its largest mean speed, as fitted in the paper."""
    level = phi_levels(trials.phi)
    keep = np.zeros(len(trials), dtype=bool)
    for phi_level in np.unique(level):
        here = np.flatnonzero(level == phi_level)
        omegas = np.unique(np.round(trials.omega_rad_s[here], 3))
        means = [np.nanmean(trials.speed_m_s[here][np.isclose(trials.omega_rad_s[here], w, rtol=5e-3)]) for w in omegas]
        keep[here] = trials.omega_rad_s[here] <= omegas[int(np.nanargmax(means))] * 1.005
    return keep


def _speeds_only(trials: Trials) -> Trials:
    unknown = np.full(len(trials), np.nan)
    return replace(trials, lift_m=unknown, peak_speed_m_s=unknown, first_step_m=unknown)


def _motions(bags: Mapping[str, Path], trials: Trials) -> tuple[Motion, ...]:
    """Two trials with bags at one leg frequency: the closest packed, and the one nearest the paper's loose φ."""
    have = np.flatnonzero([str(name) in bags for name in trials.trial_id])
    if len(have) < 2:
        return ()
    omega = trials.omega_rad_s[have]
    have = have[np.isclose(omega, usual(omega), rtol=5e-3)]
    close = have[trials.phi[have].argmax()]
    loose = have[np.abs(trials.phi[have] - LOOSE_PHI).argmin()]
    if close == loose:
        return ()
    return tuple(_motion(trials, row, bags[str(trials.trial_id[row])]) for row in (close, loose))


def _motion(trials: Trials, row: int, bag: Path) -> Motion:
    trial_id = str(trials.trial_id[row])
    found, missing = waveforms.read({trial_id: bag}, [trial_id])
    if missing:
        raise InputError(missing[0])
    waveform = found[0]
    mount = 0.0 if trials.robot is None else trials.robot.leg_mount_rad
    return Motion(
        trial_id, float(trials.phi[row]), float(trials.omega_rad_s[row]), clock_signal(str(trials.gait[row])),
        waveform.time_s, waveform.speed_m_s, waveform.leg_time_s, waveform.leg_angle_rad[:, 0] - mount,
    )  # fmt: skip
