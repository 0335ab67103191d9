"""Trials read directly from the simulated motion, without video: rows of the trials table, for blind benchmarks.

The readings are those of docs/architecture.md with the errors of tracked video added.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, nan, pi

import numpy as np

from sandbot_clock.gait import Gait, leg_angles
from sandbot_common.arrays import Floats
from sandbot_common.errors import InputError
from sandbot_lab.robot import Trace, simulate
from sandbot_lab.week import Occasion, batch_seed, seen_x_m
from sandbot_lab.world import World

Row = dict[str, float | int | str]

COLUMNS = (
    "trial_id",
    "phi",
    "phi_sd",
    "omega_rad_s",
    "gait",
    "replicate",
    "speed_m_s",
    "speed_sd_m_s",
    "lift_m",
    "peak_speed_m_s",
    "first_step_m",
    "batch",
    "run_order",
    "status",
)
ORDERS = ("as_listed", "randomised")
BATCHES = ("none", "omega", "phi", "condition", "replicate")
RATE_HZ = 200.0
SHORTEST_S = 2.5
PERIODS = 4


@dataclass(frozen=True)
class ReadingErrors:
    """Standard deviations of the measurement errors of tracked video, and of φ from the height sensor."""

    phi: float = 0.0003
    speed_m_s: float = 0.0003
    lift_m: float = 0.00005
    peak: float = 0.003
    peak_m_s: float = 0.001
    first_step_m: float = 0.0001


def direct_trials(
    world: World,
    phis: Sequence[float],
    omegas: Sequence[float],
    gait: str = "UNIFORM",
    replicates: int = 3,
    seed: int = 0,
    errors: ReadingErrors | None = None,
    order: str | None = None,
    batches: str = "none",
) -> list[Row]:
    """One row (`COLUMNS`) for each φ × ω × replicate, always listed ω by ω; ``run_order`` says when each was run.

    ``batches`` says what the trials of one batch have in common ("omega": one frequency per day); batches are run one
    after the other, and ``order`` is that of the batches and of the trials within each (None: as listed, with
    ``run_order`` left out of the table). The true φ of a trial differs from its level by the world's preparation error.
    Raises InputError for an unknown gait, order or kind of batch, a frequency that isn't positive or an impossible
    volume fraction.
    """
    if replicates < 1 or not len(phis) or not len(omegas):
        raise InputError(f"trials: {len(phis)} phi x {len(omegas)} omega x {replicates}: at least one of each")
    errors = errors or ReadingErrors()
    listed = [(omega, level, replicate) for omega in omegas for level in phis for replicate in range(replicates)]
    batch = [_batch(batches, *condition) for condition in listed]
    place = _run_order(batch, order or "as_listed", seed)
    rows: list[Row] = []
    for when, (omega, level, number) in enumerate(listed):
        occasion = Occasion(batch_seed(seed, batch[when]), 0, place[when] / max(len(listed) - 1, 1))
        row = direct_trial(world, level, omega, gait, number, seed, occasion, errors)
        row |= {"batch": batch[when], "run_order": nan if order is None else place[when] + 1}
        rows.append({name: row[name] for name in COLUMNS})
    return rows


def direct_trial(
    world: World,
    level: float,
    omega: float,
    gait: str,
    replicate: int,
    seed: int,
    occasion: Occasion,
    errors: ReadingErrors,
) -> Row:
    """One row without ``batch`` and ``run_order``; its trial seed is derived from the arguments."""
    if not 0.0 < omega < 1000.0:
        raise InputError(f"omega_rad_s: {omega} is outside (0, 1000) rad/s")
    t_s = np.arange(ceil(max(SHORTEST_S, PERIODS * 2 * pi / omega) * RATE_HZ) + 1) / RATE_HZ
    angles, rates = leg_angles(Gait.from_name(gait), omega, t_s, world.body.legs_per_tripod)
    # Independent of the order and number of the other trials.
    rng = np.random.default_rng([seed, round(level * 1e6), round(omega * 1e3), replicate])
    phi = level + world.noise.scale * world.noise.phi_sd * float(rng.standard_normal())
    trial_seed = int(rng.integers(2**62))
    occasion = replace(occasion, trial_seed=trial_seed)
    trace = simulate(world.at(occasion), phi - world.week.phi_zero, t_s, angles, rates, seed=trial_seed)
    biased = _with_bias(readings(trace, world.body.leg_mount_rad), world, occasion)
    return {
        "trial_id": f"phi{level:.3f}_omega{omega:g}_{replicate}",
        "phi": phi + errors.phi * float(rng.standard_normal()),
        "phi_sd": errors.phi,
        "omega_rad_s": float(omega),
        "gait": gait,
        "replicate": replicate,
        **_with_noise(biased, errors, rng),
        "status": "ok",
    }


def _batch(kind: str, omega: float, phi: float, replicate: int) -> str:
    labels = {
        "none": "",
        "omega": f"omega{omega:g}",
        "phi": f"phi{phi:.3f}",
        "condition": f"phi{phi:.3f}_omega{omega:g}",
        "replicate": f"block{replicate + 1}",
    }
    if kind not in labels:
        raise InputError(f"batches: {kind!r} is not one of {', '.join(BATCHES)}")
    return labels[kind]


def _run_order(batch: Sequence[str], order: str, seed: int) -> list[int]:
    """The position (from 0) of each listed trial in the run order."""
    if order not in ORDERS:
        raise InputError(f"order: {order!r} is not one of {', '.join(ORDERS)}")
    rng = np.random.default_rng([seed, 0x0DE12])
    names, within = list(dict.fromkeys(batch)), list(range(len(batch)))
    if order == "randomised":
        rng.shuffle(names)
        rng.shuffle(within)
    sequence = sorted(within, key=lambda trial: names.index(batch[trial]))
    return [int(place) for place in np.argsort(sequence)]


@dataclass(frozen=True)
class Readings:
    """The four observables of one trial (docs/architecture.md); NaN where the trial is too short."""

    speed_m_s: float
    lift_m: float
    peak_speed_m_s: float
    first_step_m: float


def readings(trace: Trace, leg_mount_rad: float = 0.0) -> Readings:
    """Speed over whole periods after the first, median rise per step, median peak per period, first step's advance.

    A step ends where the mean actual angle of the legs is a multiple of π: then both tripods are equally far from
    straight below. The first step is the one whose beginning is nearest to the start.
    """
    turned = (trace.leg_angle_rad.mean(axis=1) + leg_mount_rad) / pi
    begun = round(turned[0])
    steps = int(turned[-1] - begun + 1e-9)
    edges = np.interp(begun + np.arange(steps + 1), np.maximum.accumulate(turned), trace.t_s)
    first_step = _at(trace, trace.x_m, edges[1]) - trace.x_m[0] if steps else nan
    whole = steps // 2
    if whole < 2:
        return Readings(nan, nan, nan, float(first_step))
    steady = edges[2 : 2 * whole + 1]
    travelled = _at(trace, trace.x_m, steady[-1]) - _at(trace, trace.x_m, steady[0])
    return Readings(
        speed_m_s=travelled / float(steady[-1] - steady[0]),
        lift_m=_largest(trace, trace.z_m, steady) - float(trace.z_m[0]),
        peak_speed_m_s=_largest(trace, trace.v_x_m_s, steady[::2]),
        first_step_m=float(first_step),
    )


def _with_bias(truth: Readings, world: World, occasion: Occasion) -> Readings:
    """The readings of instruments with an offset and a scale error."""
    off = world.week.scale_error(occasion)
    along = {name: seen_x_m(getattr(truth, name), 0.0, off) for name in ("speed_m_s", "peak_speed_m_s", "first_step_m")}
    return Readings(**along, lift_m=truth.lift_m + world.week.lift_offset_m(occasion))


def _with_noise(truth: Readings, errors: ReadingErrors, rng: np.random.Generator) -> dict[str, float]:
    chance = rng.standard_normal(4).tolist()
    return {
        "speed_m_s": truth.speed_m_s + errors.speed_m_s * chance[0],
        "speed_sd_m_s": errors.speed_m_s,
        "lift_m": truth.lift_m + errors.lift_m * chance[1],
        "peak_speed_m_s": truth.peak_speed_m_s
        + float(np.hypot(errors.peak * truth.peak_speed_m_s, errors.peak_m_s)) * chance[2],
        "first_step_m": truth.first_step_m + errors.first_step_m * chance[3],
    }


def _at(trace: Trace, values: Floats, t_s: float) -> float:
    return float(np.interp(t_s, trace.t_s, values))


def _largest(trace: Trace, values: Floats, edges_s: Floats) -> float:
    """Median over the intervals (steps or periods) between edges [s] of the largest value in each."""
    edges = np.searchsorted(trace.t_s, edges_s)
    return float(np.median([values[low:high].max() for low, high in itertools.pairwise(edges)]))
