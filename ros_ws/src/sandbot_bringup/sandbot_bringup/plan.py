"""The plan of a campaign: campaign.yaml to a list of trials. Pure; nothing moves here.

name: demo
seed: 2009
order: randomised
gait: UNIFORM
phi: [0.580, 0.600, 0.611, 0.622, 0.633]
omega_rad_s: [4, 8, 12, 16, 20, 24, 30]
replicates: 3
"""

import dataclasses
import math
import zlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbot_bed.protocol import ProtocolParameters
from sandbot_bringup.run_order import ORDERS, in_blocks, interspersed, sentinel_of
from sandbot_clock.gait import PRESETS, Gait
from sandbot_common.errors import InputError
from sandbot_common.files import read_json
from sandbot_common.parameters import from_mapping, parameter
from sandbot_common.yaml_text import dump_yaml, read_yaml
from sandbot_lab.week import FIRST, Occasion, batch_seed
from sandbot_model.discovery.criteria import DEFAULT, WIDEST

PHI_LOW, PHI_HIGH = 0.57, 0.64
SCHEMAS = ("sandbot.discovery/1", "sandbot.discovery/2")
"""Schemas of the discoveries that are read."""
VERDICT = "verdict"
DIGITS = {"phi": "%.4f", "omega_rad_s": "%06.3f"}
"""Precision to which conditions are distinguished in the names of their trials."""
OMEGA_HIGH = 60.0
END_S = 0.02
"""Least time for which legs turn beyond two periods: rounded set-points, or legs that lag, must not cut off the end of
the second, the only steady one."""


@dataclass(frozen=True)
class ExtraTrials:
    """Trials in addition to the φ × ω grid, such as the next trials of a discovery."""

    phi: float = parameter(doc="volume fraction target", low=PHI_LOW, high=PHI_HIGH)
    omega_rad_s: float = parameter(doc="leg frequency", unit="rad/s", low=0.5, high=OMEGA_HIGH)
    replicates: int = parameter(3, doc="trials of this condition", low=1, high=1000)
    round: int = parameter(1, doc="conditions of one round are run together, after earlier rounds", low=1, high=1000)
    gait: str = parameter("", doc="clock signal; empty: the plan's", choices=("", *PRESETS))
    because: str = parameter("", doc="why it is run")


@dataclass(frozen=True)
class Plan:
    """What a campaign will do. ``bed`` and ``gait_parameters`` override the defaults of bed and clock."""

    name: str = parameter(doc="name of the campaign")
    phi: tuple[float, ...] = parameter(doc="volume fraction targets", low=PHI_LOW, high=PHI_HIGH)
    omega_rad_s: tuple[float, ...] = parameter(doc="leg frequencies", unit="rad/s", low=0.5, high=OMEGA_HIGH)
    replicates: int = parameter(3, doc="trials of each condition", low=1, high=1000)
    gait: str = parameter("SGCS", doc="clock signal", choices=(*PRESETS, "CUSTOM"))
    gait_parameters: dict[str, Any] = parameter({}, doc="theta_s_rad, theta_0_rad and duty of a CUSTOM gait")
    seed: int = parameter(1, doc="random seed of the run order and the virtual lab", low=0, high=2**31 - 1)
    order: str = parameter("randomised", doc="run order: in random blocks, or as listed", choices=ORDERS)
    sentinel: int = parameter(
        0, doc="trials between extra trials of the sentinel condition; 0: only its replicates", low=0, high=1000
    )
    periods: float = parameter(4.0, doc="least number of leg periods in a trial", low=2.0, high=1000.0)
    min_duration_s: float = parameter(1.2, unit="s", doc="shortest trial", low=0.2, high=600.0)
    standing_s: float = parameter(0.25, unit="s", doc="recording before the legs start", low=0.0, high=60.0)
    setpoint_rate_hz: float = parameter(200.0, unit="Hz", doc="rate of leg set-points", low=50.0, high=1000.0)
    images: str = parameter(
        "one", doc="frames kept: of one trial as JPEG, or of all", choices=("one", "none", "jpeg", "video", "raw")
    )
    cameras: str = parameter("", doc="camera calibration file, relative to the plan; empty: the project's own")
    robot: str = parameter("", doc="robot file, relative to the plan; empty: the project's own SandBot")
    bed: dict[str, Any] = parameter({}, doc="overrides of the pulse protocol")
    extra_trials: tuple[dict[str, Any], ...] = parameter((), doc="conditions in addition to the grid")
    until: str = parameter(
        "", doc="verdict: run the grid block by block until there is one; empty: all of it", choices=("", VERDICT)
    )
    budget: int = parameter(0, doc="most trials until a verdict; 0: as many as the grid has", low=0, high=100_000)
    alpha: float = parameter(0.02, doc="probability of a false claim until a verdict", low=1e-6, high=0.5)
    model: str = parameter("simple", doc="base model of the verdict")
    bed_scatter: float = parameter(
        DEFAULT.bed_scatter,
        doc="prior sd of the variation of k from batch to batch, for the verdict",
        low=1e-6,
        high=WIDEST,
    )
    bed_drift: float = parameter(
        DEFAULT.drift, doc="prior sd of the drift of k by the end, for the verdict", low=1e-6, high=WIDEST
    )

    @property
    def clock_gait(self) -> Gait:
        """The clock signal's parameters. Raises InputError if a CUSTOM gait is incomplete."""
        if self.gait == "CUSTOM":
            return from_mapping(Gait, self.gait_parameters, f"plan {self.name}: gait_parameters")
        return Gait.from_name(self.gait)

    @property
    def gait_name(self) -> str:
        """The gait's name in /trial and in the table: a preset, or CUSTOM(θ_s θ_0 d_c)."""
        if self.gait != "CUSTOM":
            return self.gait
        gait = self.clock_gait
        return f"CUSTOM({gait.theta_s_rad:.6g} {gait.theta_0_rad:.6g} {gait.duty:.6g})"

    @property
    def bed_protocol(self) -> ProtocolParameters:
        """The pulse protocol's parameters."""
        return from_mapping(ProtocolParameters, self.bed, f"plan {self.name}: bed")

    def for_trial(self, trial: "PlannedTrial") -> "Plan":
        """The plan as it applies to ``trial``, which may have its own gait."""
        return dataclasses.replace(self, gait=trial.gait, gait_parameters={}) if trial.gait else self

    @property
    def max_trials(self) -> int:
        """The most trials until a verdict."""
        return self.budget or len(self.phi) * len(self.omega_rad_s) * self.replicates

    def duration_s(self, omega_rad_s: float) -> float:
        """How long the legs turn in a trial at ``omega_rad_s``."""
        period_s = 2 * math.pi / omega_rad_s
        return max(self.min_duration_s, self.periods * period_s, 2 * period_s + END_S)

    def setpoint_times_s(self, omega_rad_s: float) -> NDArray[np.float64]:
        """Times (n,) of the set-points of a trial at ``omega_rad_s``, from 0 on [s]."""
        return np.arange(round(self.duration_s(omega_rad_s) * self.setpoint_rate_hz) + 1) / self.setpoint_rate_hz


@dataclass(frozen=True)
class PlannedTrial:
    """One trial to run; ``seed`` depends only on the plan's seed and the trial's name."""

    trial_id: str
    phi: float
    omega_rad_s: float
    replicate: int
    seed: int
    batch: str = ""
    """The block it is run in; empty if the plan has no blocks."""
    run_order: int = 1
    """Its position in the campaign, from 1."""
    occasion: Occasion = FIRST
    """Batch and position for the virtual lab."""
    gait: str = ""
    """Its own clock signal; empty: the plan's."""
    because: str = ""
    """Why it is run, if a look at earlier trials has chosen it."""


def read_plan(path: Path) -> Plan:
    """The plan in ``path`` (campaign.yaml). Raises InputError with file, key and invalid value."""
    return plan_of(read_yaml(path), str(path))


def plan_of(mapping: Mapping[str, Any], where: str) -> Plan:
    """A checked plan from a mapping; ``where`` opens every error line."""
    plan = from_mapping(Plan, mapping, where)
    if plan.name in ("", ".", "..") or "/" in plan.name or not plan.name.isprintable():
        raise InputError(f"{where}: name: {plan.name!r} can't be the name of a folder next to the plan")
    for key in ("phi", "omega_rad_s"):
        values = getattr(plan, key)
        if not values:
            raise InputError(f"{where}: {key}: the list is empty; at least one value is needed")
        _refuse_duplicates(key, values, where)
    if plan.gait_parameters and plan.gait != "CUSTOM":
        raise InputError(f"{where}: gait_parameters are given but gait is {plan.gait}; set gait: CUSTOM")
    for index, extra in enumerate(plan.extra_trials):
        from_mapping(ExtraTrials, extra, f"{where}: extra_trials[{index}]")
    _check_until(plan, where)
    # The nested mappings are checked now, before anything moves.
    if plan.gait == "CUSTOM":
        from_mapping(Gait, plan.gait_parameters, f"{where}: gait_parameters")
    from_mapping(ProtocolParameters, plan.bed, f"{where}: bed")
    return plan


def _refuse_duplicates(key: str, values: Sequence[float], where: str) -> None:
    """Raise InputError for two values that agree to the digits in trial names, which must be unique."""
    named = [DIGITS[key] % value for value in values]
    if len(set(named)) != len(named):
        twice = next(name for name in named if named.count(name) > 1)
        raise InputError(f"{where}: {key}: {float(twice):g} is listed twice; use replicates for repeats")


VERDICT_KEYS = ("budget", "alpha", "model", "bed_scatter", "bed_drift")
"""Keys of a plan that only matter until a verdict."""


def _check_until(plan: Plan, where: str) -> None:
    """Raise InputError for keys that would be ignored."""
    if plan.until and plan.sentinel:
        raise InputError(
            f"{where}: sentinel: {plan.sentinel} with until: {plan.until}, which chooses every trial itself"
        )
    usual = {field.name: field.default for field in dataclasses.fields(Plan)}
    if not plan.until and (given := [key for key in VERDICT_KEYS if getattr(plan, key) != usual[key]]):
        raise InputError(f"{where}: {given[0]}: {getattr(plan, given[0])} without until: {VERDICT} has no meaning")


_LOOSE_KEYS = {"mass_kg", "rho_grain_kg_m3", "area_m2", "height_loose_m"}
"""Keys that determine φ of the loose bed."""


def check_bed(plan: Plan, *, live: bool = False) -> None:
    """Raise InputError for a φ that the plan's bed, the only one of the virtual lab, can't be prepared for.

    A ``live`` bed has its own settings; then only those ends of the range are checked that the plan itself sets.
    """
    bed = plan.bed_protocol
    try:
        for phi in (*plan.phi, *(float(extra["phi"]) for extra in plan.extra_trials)):
            sets_end = "phi_close" in plan.bed if phi > bed.phi_close else plan.bed.keys() >= _LOOSE_KEYS
            if sets_end or not live:
                bed.check_target(phi)
    except InputError as error:
        raise InputError(f"plan {plan.name}: phi: {error}") from None


def to_yaml(plan: Plan) -> str:
    """The plan as campaign.yaml."""
    content = {
        key: list(value) if isinstance(value, tuple) else value for key, value in dataclasses.asdict(plan).items()
    }
    return dump_yaml(content)


def trials_of(plan: Plan) -> list[PlannedTrial]:
    """Every trial of the plan as listed: the grid φ by φ, then extra trials of the sentinel, then the extra trials.

    ``run_order`` says when each is run (run_order.py); extending a plan does not change it. Until a verdict the grid
    only says where trials may be: all of them are extra trials.
    """
    done: Counter[str] = Counter()
    blocks: list[list[PlannedTrial]] = []
    listed: list[PlannedTrial] = []
    if not plan.until:
        listed, blocks = _grid(plan, done)
    planned = plan.max_trials if plan.until else len(listed)
    for number, conditions in _rounds(plan).items():
        replicates = [_replicates(plan, done, condition) for condition in conditions]
        blocks += _blocks(plan, replicates, number)
        listed += chain(*replicates)
    return _placed(plan, listed, blocks, planned)


def _grid(plan: Plan, done: Counter[str]) -> tuple[list[PlannedTrial], list[list[PlannedTrial]]]:
    """The trials of the grid and the extra ones of the sentinel, as listed and in blocks."""
    grid = [ExtraTrials(phi, omega, plan.replicates) for phi in plan.phi for omega in plan.omega_rad_s]
    sentinel = sentinel_of(plan.phi, plan.omega_rad_s)
    more = (len(grid) * plan.replicates - 1) // plan.sentinel if plan.sentinel else 0
    replicates = [_replicates(plan, done, condition) for condition in grid]
    sentinels = _replicates(plan, done, ExtraTrials(*sentinel, more))
    blocks = _blocks(plan, replicates, 0, grid.index(ExtraTrials(*sentinel, plan.replicates)))
    return [*chain(*replicates), *sentinels], interspersed(blocks, sentinels, plan.sentinel)


def _replicates(plan: Plan, done: Counter[str], of: ExtraTrials) -> list[PlannedTrial]:
    # The count continues if a condition is listed again, so that no two trials share a name.
    name = _condition_name(of)
    first = done[name] + 1
    done[name] += of.replicates
    return [_planned(plan, of, name, number) for number in range(first, first + of.replicates)]


def _condition_name(of: ExtraTrials) -> str:
    """The common prefix of the condition's trial names."""
    own = f"_{of.gait}" if of.gait else ""
    return f"phi{DIGITS['phi'] % of.phi}_w{DIGITS['omega_rad_s'] % of.omega_rad_s}{own}"


def _rounds(plan: Plan) -> dict[int, list[ExtraTrials]]:
    """The extra conditions by the round in which they are run; a gait equal to the plan's is left empty."""
    extras = [from_mapping(ExtraTrials, extra, plan.name) for extra in plan.extra_trials]
    rounds: dict[int, list[ExtraTrials]] = {number: [] for number in sorted({extra.round for extra in extras})}
    for extra in extras:
        rounds[extra.round].append(dataclasses.replace(extra, gait="") if extra.gait == plan.gait else extra)
    return rounds


def _blocks(
    plan: Plan, replicates: Sequence[Sequence[PlannedTrial]], number: int, head: int | None = None
) -> list[list[PlannedTrial]]:
    if plan.order == "as_listed":
        return [list(chain(*replicates))]
    return in_blocks(replicates, head, (plan.seed, number))


def _placed(
    plan: Plan, listed: Sequence[PlannedTrial], blocks: Sequence[Sequence[PlannedTrial]], planned: int
) -> list[PlannedTrial]:
    """The trials with their block and run order; progress reaches 1 with the last of the ``planned`` trials."""
    # In an order as listed a block is not a batch, as nothing is known to be shared by its trials.
    named = plan.order != "as_listed"
    run = [
        (trial, f"block{number}" if named else "") for number, block in enumerate(blocks, start=1) for trial in block
    ]
    placed = {}
    for place, (trial, batch) in enumerate(run):
        occasion = Occasion(batch_seed(plan.seed, batch), trial.seed, place / max(planned - 1, 1))
        placed[trial.trial_id] = dataclasses.replace(trial, batch=batch, run_order=place + 1, occasion=occasion)
    return [placed[trial.trial_id] for trial in listed]


def with_next_trials(plan: Plan, path: Path) -> Plan:
    """The plan extended by the ``next_trials`` of a discovery JSON (sandbot.discovery/1 or /2), without duplicates, in
    the gait they name, else the plan's."""
    # Imported here, because it loads all of the fitting code, which most plans don't need.
    from sandbot_model.discovery.next_trials import PENETRATION

    content = read_json(path, "; the file that discover --json writes is needed")
    schema = content.get("schema", SCHEMAS[-1]) if isinstance(content, dict) else SCHEMAS[-1]
    if schema not in SCHEMAS:
        raise InputError(f"{path}: schema {schema!r} is not one of {', '.join(SCHEMAS)}")
    proposed = content.get("next_trials") if isinstance(content, dict) else content
    if not isinstance(proposed, list) or not proposed:
        raise InputError(f"{path}: no next_trials in it; the verdict may need none")
    walks = [item for item in proposed if not (isinstance(item, Mapping) and item.get("observable") == PENETRATION)]
    if not walks:
        raise InputError(f"{path}: its next_trials are penetrometer readings, no trials; see discover --penetrometer")
    asked = _conditions(walks, plan, str(path))
    known = [{key: value for key, value in extra.items() if key != "round"} for extra in plan.extra_trials]
    later = {"round": max(_rounds(plan)) + 1} if plan.extra_trials else {}
    extras = [{**condition, **later} for condition in asked if condition not in known]
    return dataclasses.replace(plan, extra_trials=(*plan.extra_trials, *extras))


def with_condition(plan: Plan, condition: Mapping[str, Any], where: str) -> Plan:
    """The plan with one more condition (an ``ExtraTrials`` without ``round``), run after all others.

    Raises InputError, opened by ``where``, if the plan's bed can't be prepared for it.
    """
    extra = from_mapping(ExtraTrials, condition, where)
    plan.bed_protocol.check_target(extra.phi)
    asked = {"phi": extra.phi, "omega_rad_s": extra.omega_rad_s, "replicates": extra.replicates}
    own = {"gait": extra.gait} if extra.gait not in ("", plan.gait) else {}
    later = {"round": max(_rounds(plan)) + 1} if plan.extra_trials else {}
    return dataclasses.replace(plan, extra_trials=(*plan.extra_trials, {**asked, **own, **later}))


def with_block(plan: Plan, block: Sequence[Mapping[str, Any]]) -> Plan:
    """The plan with one more round of conditions (``ExtraTrials`` without ``round``), by default of one trial each."""
    number = max(_rounds(plan), default=0) + 1
    extras = [{"replicates": 1, **condition, "round": number} for condition in block]
    return dataclasses.replace(plan, extra_trials=(*plan.extra_trials, *extras))


def _conditions(proposed: Iterable[Any], plan: Plan, where: str) -> Iterable[dict[str, Any]]:
    # One bag measures every observable, so proposals that differ only in the observable are one condition.
    seen: dict[tuple[float, float, str], int] = {}
    for index, item in enumerate(proposed):
        if not isinstance(item, Mapping):
            raise InputError(f"{where}: next_trials[{index}]: expected phi and omega_rad_s, got {item!r}")
        known = {key: item[key] for key in ("phi", "omega_rad_s", "replicates", "gait") if key in item}
        if known.get("gait") == plan.gait_name:
            del known["gait"]
        extra = from_mapping(ExtraTrials, {"replicates": plan.replicates, **known}, f"{where}: next_trials[{index}]")
        key = (float(DIGITS["phi"] % extra.phi), float(DIGITS["omega_rad_s"] % extra.omega_rad_s), extra.gait)
        seen[key] = max(seen.get(key, 0), extra.replicates)
    for (phi, omega, gait), count in seen.items():
        yield {"phi": phi, "omega_rad_s": omega, "replicates": count, **({"gait": gait} if gait else {})}


def _planned(plan: Plan, of: ExtraTrials, name: str, replicate: int) -> PlannedTrial:
    trial_id = f"{name}_r{replicate:02d}"
    sequence = np.random.SeedSequence([plan.seed, zlib.crc32(trial_id.encode())])
    seed = int(sequence.generate_state(1)[0] >> 1)
    return PlannedTrial(trial_id, of.phi, of.omega_rad_s, replicate, seed, gait=of.gait, because=of.because)
