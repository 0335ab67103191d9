"""A bag's record of its own trial: the /trial message and the MCAP metadata record `trial`."""

import json
import subprocess
from dataclasses import asdict
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from pathlib import Path

from sandbot_bed.protocol import ProtocolParameters
from sandbot_bringup.plan import Plan, PlannedTrial
from sandbot_common.robot import Robot, to_mapping


def trial_message(
    plan: Plan, trial: PlannedTrial, robot: Robot, start_ns: int, bed: ProtocolParameters | None = None
) -> str:
    """The JSON published latched on /trial: what is being run. ``bed``: its protocol, if not the plan's alone."""
    return json.dumps(
        {
            "trial_id": trial.trial_id,
            "campaign": plan.name,
            "phi_target": trial.phi,
            "omega_rad_s": trial.omega_rad_s,
            "gait": plan.gait_name,
            "leg_mount_rad": robot.leg_mount_rad,
            "robot": to_mapping(robot),
            "bed": asdict(bed or plan.bed_protocol),
            "replicate": trial.replicate,
            "seed": trial.seed,
            "batch": trial.batch,
            "run_order": trial.run_order,
            "because": trial.because,
            "software_version": version("sandbot_bringup"),
            "commit": commit(),
            "start": datetime.fromtimestamp(start_ns / 1e9, UTC).isoformat(),
        }
    )


def trial_metadata(
    plan: Plan, trial: PlannedTrial, robot: Robot, start_ns: int, clock: str, exit_status: str
) -> dict[str, str]:
    """The MCAP metadata record `trial`: id, plan, parameters, software, start, clock used, exit status."""
    return {
        "id": trial.trial_id,
        "plan": plan.name,
        "parameters": trial_message(plan, trial, robot, start_ns),
        "software_version": version("sandbot_bringup"),
        "commit": commit(),
        "start": datetime.fromtimestamp(start_ns / 1e9, UTC).isoformat(),
        "clock": clock,
        "exit_status": exit_status,
    }


@cache
def commit() -> str:
    """The commit this software runs from, with `-dirty` if it was changed; `unknown` outside a checkout."""
    here = Path(__file__).resolve().parent
    try:
        found = subprocess.run(
            ["git", "-C", str(here), "describe", "--always", "--dirty", "--abbrev=12"],
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return found.stdout.strip()
