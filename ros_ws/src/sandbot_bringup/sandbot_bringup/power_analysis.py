"""What a campaign can't measure, and which effects it will be able to detect, predicted before it is run."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

from sandbot_bringup.config import robot_of
from sandbot_bringup.plan import Plan, PlannedTrial
from sandbot_clock.gait import leg_angles
from sandbot_common.errors import InputError
from sandbot_common.yaml_text import parse_yaml
from sandbot_tracking.calibration import cameras_from_mapping
from sandbot_tracking.trial import never_measured

Gaps = Mapping[tuple[float, str], Mapping[str, str]]
"""By leg frequency [rad/s] and own gait, the columns of the trials table that stay empty, and why."""


def gaps(plan: Plan, trials: Sequence[PlannedTrial], files: Mapping[str, str]) -> Gaps:
    """What trials of the plan are too short to measure at the frame rate of cameras.yaml."""
    rate_hz = cameras_from_mapping(parse_yaml(files["cameras.yaml"], "cameras.yaml"), "cameras")["dorsal"].frame_rate_hz
    # Until a verdict, the whole grid may come.
    conditions = {(omega, "") for omega in plan.omega_rad_s} | {(trial.omega_rad_s, trial.gait) for trial in trials}
    found = {}
    for omega, gait in sorted(conditions):
        own = dataclasses.replace(plan, gait=gait) if gait else plan
        t_s = plan.setpoint_times_s(omega)
        found[omega, gait] = never_measured(t_s, leg_angles(own.clock_gait, omega, t_s)[0], rate_hz)
    return found


def in_words(found: Gaps) -> list[str]:
    """One sentence for each condition with a gap."""
    return [
        f"not measured at {omega:g} rad/s{f' in {gait}' if gait else ''}: {', '.join(columns)} "
        f"({'; '.join(dict.fromkeys(columns.values()))})"
        for (omega, gait), columns in found.items()
        if columns
    ]


def detectable_effects(plan: Plan, trials: Sequence[PlannedTrial], files: Mapping[str, str], lost: Gaps) -> str:
    """Which effects it will be able to detect, in one sentence, for the ground of Li09 and the usual scatter according
    to cameras.yaml; ``lost`` is not measured."""
    from sandbot_model.discovery import power
    from sandbot_model.discovery.effect_search import EffectSearch
    from sandbot_model.physics.catalogue import catalogue
    from sandbot_model.physics.observables import Observable
    from sandbot_record.trials.setting import accuracy_of
    from sandbot_record.trials.table import Row, from_rows

    cameras = parse_yaml(files["cameras.yaml"], "cameras.yaml")
    columns: dict[str, Any] = {observable.column: 0.0 for observable in Observable}
    rows = [
        Row(
            trial_id=trial.trial_id,
            phi=trial.phi,
            omega_rad_s=trial.omega_rad_s,
            gait=trial.gait or plan.gait_name,
            replicate=trial.replicate,
            batch=trial.batch,
            run_order=trial.run_order,
            **columns | dict.fromkeys(lost[trial.omega_rad_s, trial.gait], math.nan),
        )
        for trial in trials
    ]
    try:
        base = power.expected(from_rows(rows, robot_of(files), accuracy=accuracy_of(cameras, "cameras.yaml")))
    except InputError as error:
        return f"what it will be able to find can't be predicted: {error}"
    search = EffectSearch(base.cells, catalogue(), "simple")
    return f"effects {power.in_words(power.detectable(search, base), search.names)}"
