"""A live campaign of 3 φ × 3 ω × 2 through the launch file: every bag complete, every row that of batch within 1 %.

Run it with ``-s`` for the tables of docs/faults.md. A bed is never prepared to the same φ twice, so batch walks on the
φ that was measured live, trial by trial.
"""

import csv
import json
import sys
import time

import numpy as np
import pytest
import yaml

from sandbot_bringup import batch
from sandbot_bringup.plan import read_plan, trials_of
from sandbot_common import topics
from sandbot_lab.robot import simulate
from sandbot_record.bags.reader import Bag

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.whole, pytest.mark.timeout(3600)]

PHI, OMEGA, REPLICATES = [0.605, 0.615, 0.625], [8.0, 12.0, 16.0], 2
"""Not below 0.6: there walking breaks down, and 0.0001 in φ, which no height tells, is several per cent of speed."""
BED = {"fluidise_s": 0.7, "ramp_s": 0.3, "settle_s": 0.6, "pulse_off_s": 0.5, "average_s": 0.4}
"""A bed prepared in seconds, its height read often enough for 0.0002 in φ."""
PATIENT = ["clock.lease_s:=1.0", "clock.robot_s:=1.0", "clock.late_s:=0.25"]
"""Leases that a busy machine loses less often: how soon they stop what they lease is the fault matrix's affair."""
LAB, SERIAL = [*PATIENT, "lab.legs_lease_s:=1.0"], [*PATIENT, "serial_legs.legs_lease_s:=1.0"]
DEVICES = 1
"""Seed of the simulated devices."""
ROUNDS = 3
"""What a busy machine has spoilt is marked, and run once more."""


def rows(folder):
    with (folder / "trials.csv").open() as file:
        return {row["trial_id"]: row for row in csv.DictReader(file)}


@pytest.fixture
def plan(tmp_path, slow_cameras):
    path = tmp_path / "plan.yaml"
    keys = {"name": "nine", "seed": 5, "gait": "UNIFORM", "phi": PHI, "omega_rad_s": OMEGA, "periods": 8.0}
    keys |= {"replicates": REPLICATES, "bed": BED, "cameras": str(slow_cameras), "images": "none"}
    path.write_text(yaml.safe_dump(keys))
    return path


@pytest.fixture
def batch_on(monkeypatch, batch_campaign):
    """Run a plan on ground of the φ that is given for each trial, by its seed; ``chance``: of all."""

    def run(path, out, phi_by_seed, chance):
        def simulated(world, phi, *motion, seed):
            return simulate(world, phi_by_seed.get(seed, phi), *motion, seed=seed if chance is None else chance)

        monkeypatch.setattr(batch, "simulate", simulated)
        assert batch_campaign(path, "--out", out) == 0

    return run


def prepared_s(bag):
    """How long the bed took, from its first word of this trial to its φ."""
    (ready_ns,) = bag.columns(topics.BED_PHI.name).log_time_ns
    return (ready_ns - bag.columns(topics.BED_STATUS.name, "header.stamp.sec").log_time_ns[0]) * 1e-9


def run_live(start, path, out, silence_s=5):
    """The campaign over nodes that are there, until all its trials are; how long it took [s] and what failed why."""
    began_s = time.monotonic()
    for _ in range(ROUNDS):
        live = start("ros2", "run", "sandbot_bringup", "campaign", path, "--silence", silence_s, "--out", out)
        code = live.wait(1500)
        if code == 0:
            break
    assert code == 0, "\n".join(live.lines)
    events = [json.loads(line) for line in (out / "journal.jsonl").read_text().splitlines()]
    return time.monotonic() - began_s, [one["reason"] for one in events if one["do"] == "failed"]


def check(path, live, batch_on, tmp_path, wall_s, failed, chance=None):
    """Every bag whole, every row that of batch; prints the table. ``chance``: the seed of a robot that is told none."""
    plan, found = read_plan(path), rows(live)
    trials = trials_of(plan)
    assert sorted(found) == sorted(trial.trial_id for trial in trials)
    batch_on(path, tmp_path / "batch", {trial.seed: float(found[trial.trial_id]["phi"]) for trial in trials}, chance)
    expected, least_s, worst = rows(tmp_path / "batch"), 0.0, {}
    for trial in trials:
        one, other = found[trial.trial_id], expected[trial.trial_id]
        assert (one["status"], other["status"]) == ("ok", "ok")
        told = Bag.open(live / "trials" / trial.trial_id).provenance
        assert told["trial"]["exit_status"] == "ok"
        assert told["recording"]["exit_status"] == "ok"
        off = float(one["speed_m_s"]) / float(other["speed_m_s"]) - 1.0
        worst.setdefault((trial.phi, trial.omega_rad_s), []).append(off)
        least_s += prepared_s(Bag.open(tmp_path / "batch" / "trials" / trial.trial_id))
        least_s += plan.standing_s + plan.duration_s(trial.omega_rad_s)
    print(f"\nwall {wall_s:.0f} s, by the plan at least {least_s:.0f} s; run again: {len(failed)}", *failed, sep="\n")
    for (phi, omega), off in sorted(worst.items()):
        print(f"| {phi:g} | {omega:g} | {', '.join(f'{100 * one:+.2f}' for one in off)} |")
    assert np.abs(list(worst.values())).max() < 0.01


def test_in_the_virtual_lab(tmp_path, start, plan, slow_cameras, batch_on):
    beds = [f"bed.{name}:={value}" for name, value in BED.items()]
    start("ros2", "launch", "sandbot_bringup", "trackway.launch.py", f"cameras:={slow_cameras}", *beds, *LAB)
    check(plan, tmp_path / "live", batch_on, tmp_path, *run_live(start, plan, tmp_path / "live"))


def test_over_serial_lines_on_films_of_the_simulated_devices(tmp_path, start, plan, slow_cameras, batch_on):
    folder = tmp_path / "dev"
    options = ("--cameras", slow_cameras, "--trial-seed", DEVICES, "--lease", 1.0)
    simulated = start(sys.executable, "-m", "sandbot_hardware.simulate_command", folder, *options)
    simulated.until(lambda line: line.startswith("devices:"))
    files = {"bed": "bed", "leg": "legs", "dorsal": "dorsal", "lateral": "lateral"}
    lines = [f"{name}_device:={folder / file}" for name, file in files.items()]
    drivers = ["lab:=false", "bed_driver:=serial", "leg_driver:=serial", "camera_driver:=serial", *lines]
    beds = [f"bed.{name}:={value}" for name, value in BED.items()]
    start(
        "ros2", "launch", "sandbot_bringup", "trackway.launch.py", f"cameras:={slow_cameras}", *drivers, *beds, *SERIAL
    )
    # A real robot can't be told a trial's chance either: for the comparison the devices have the same in every trial.
    check(plan, tmp_path / "live", batch_on, tmp_path, *run_live(start, plan, tmp_path / "live"), chance=DEVICES)
