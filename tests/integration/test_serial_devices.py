"""Drivers of sandbot_hardware against simulated devices on pseudo-terminals, and cables pulled."""

import csv
import sys
import time

import numpy as np
import pytest

from sandbot_bringup import batch
from sandbot_common import messages, topics
from sandbot_common.ros import endpoints
from sandbot_lab.robot import simulate
from sandbot_record.bags.reader import Bag

pytestmark = [pytest.mark.ros, pytest.mark.timeout(300)]

BUSY_S = 2.0
"""What a busy machine may take beyond a lease; that nothing goes on for ever is the claim here."""
PHI, SEED = 0.605, 1


def seconds(line):
    """The time that a device says it took."""
    return float(line.split(" s after")[0].split()[-1])


@pytest.fixture
def devices(tmp_path, start):
    """The simulated devices, and where they are."""
    folder = tmp_path / "dev"

    def run(*options):
        simulated = start(sys.executable, "-m", "sandbot_hardware.simulate_command", folder, *options)
        simulated.until(lambda line: line.startswith("devices:"))
        return simulated, folder

    return run


def driver(start, kind, *parameters):
    given = [word for one in parameters for word in ("-p", one)]
    return start(sys.executable, "-m", f"sandbot_hardware.nodes.serial_{kind}_node", "--ros-args", *given)


def test_legs_and_air_stop_by_themselves_when_the_cable_is_pulled(devices, start, beside):
    simulated, folder = devices()
    driver(start, "legs", f"device:={folder / 'legs'}", "legs_lease_s:=1.0")
    driver(start, "bed", f"device:={folder / 'bed'}")
    setpoints, blower = (
        endpoints.publisher(beside.node, topics.LEG_SETPOINTS),
        endpoints.publisher(beside.node, topics.BED_BLOWER),
    )
    states, heights, flashes, told = [], [], [], {}
    endpoints.subscription(beside.node, topics.LEG_STATES, states.append)
    endpoints.subscription(beside.node, topics.BED_HEIGHT, heights.append)
    endpoints.subscription(beside.node, topics.SYNC_LED, flashes.append)
    endpoints.subscription(
        beside.node, topics.DIAGNOSTICS, lambda message: told.update({one.name: one for one in message.status})
    )
    beside.until(lambda: setpoints.get_subscription_count() and blower.get_subscription_count() and states and heights)
    asked = {"rate": 0.0, "air": 0.0}
    began_s = time.monotonic()

    def command():
        angle = np.full(6, (time.monotonic() - began_s) * 12.0)
        setpoints.publish(messages.joint_state(time.time_ns(), topics.LEGS, angle, np.full(6, asked["rate"]), angle))
        blower.publish(messages.float64(asked["air"]))

    command()  # told rest before they move
    beside.node.create_timer(0.02, command)

    def moving():
        return any(states[-1].velocity)

    def said(text, count=1):
        beside.until(lambda: sum(text in line for line in simulated.lines) >= count)
        return next(line for line in simulated.lines if text in line)

    asked["rate"] = 12.0
    beside.until(moving)
    beside.until(lambda: len(flashes) == 1)
    simulated.type("pull legs\n")
    late_s = seconds(said("legs: at rest by themselves"))
    assert 0.24 <= late_s < 0.24 + BUSY_S
    beside.until(lambda: told["serial_legs"].level == b"\2")
    assert "legs: " in told["serial_legs"].message  # the line's name, and what is wrong with it
    count = len(states)

    simulated.type("plug legs\n")
    beside.until(lambda: told["serial_legs"].level == b"\0")
    beside.until(lambda: len(states) > count + 10)
    assert not moving()  # set-points that kept coming are no start
    asked["rate"] = 0.0
    beside.wait(lambda: False, 0.2)
    asked["rate"] = 12.0
    beside.until(moving)
    asked["rate"] = 0.0

    asked["air"] = 1.0
    said("bed: air on")
    simulated.type("pull bed\n")
    assert 0.45 <= seconds(said("bed: air off by itself")) < 0.45 + BUSY_S
    asked["air"] = 0.0
    simulated.type("plug bed\n")
    beside.until(lambda: told["serial_bed"].level == b"\0")
    count = len(heights)
    beside.until(lambda: len(heights) > count)


def test_a_driver_whose_commands_are_late_stops_legs_and_air(devices, start, beside):
    simulated, folder = devices("--lease", "20")  # so that it is the driver who stops them
    driver(start, "legs", f"device:={folder / 'legs'}")
    setpoints = endpoints.publisher(beside.node, topics.LEG_SETPOINTS)
    beside.until(setpoints.get_subscription_count)
    beside.wait(lambda: any("legs" in line for line in simulated.lines[1:]), 0.5)

    def send(rate):
        setpoints.publish(messages.joint_state(time.time_ns(), topics.LEGS, np.ones(6), np.full(6, rate), np.ones(6)))

    def send_until(line):
        beside.until(lambda: send(5.0) or line in simulated.lines)

    send(0.0)
    send_until("legs: moving")
    simulated.until(lambda line: line == "legs: at rest")
    count = len(simulated.lines)
    send(5.0)  # after the silence that is no start
    beside.wait(lambda: len(simulated.lines) > count, 0.3)
    assert len(simulated.lines) == count
    send(0.0)
    beside.until(lambda: send(5.0) or simulated.lines.count("legs: moving") == 2)


def rows(folder):
    with (folder / "trials.csv").open() as file:
        return list(csv.DictReader(file))


@pytest.fixture
def batch_of(monkeypatch, batch_campaign):
    """Run a plan on the ground of the simulated devices: its volume fraction, and its chance."""

    def simulated(world, _phi, *motion, seed):
        return simulate(world, PHI, *motion, seed=SEED)

    monkeypatch.setattr(batch, "simulate", simulated)
    return lambda plan, out: batch_campaign(plan, "--out", out)


@pytest.mark.slow
@pytest.mark.whole
@pytest.mark.timeout(900)
def test_a_campaign_over_serial_lines_survives_a_pulled_cable(
    tmp_path, devices, start, finished, plan_of_one, quick_bed, batch_of, slow_cameras
):
    simulated, folder = devices(
        "--phi", str(PHI), "--seed", str(SEED), "--trial-seed", str(SEED), "--lease", "1.0", "--cameras", slow_cameras
    )
    files = {"bed": "bed", "leg": "legs", "dorsal": "dorsal", "lateral": "lateral"}
    lines = [f"{name}_device:={folder / file}" for name, file in files.items()]
    drivers = ["lab:=false", "bed_driver:=serial", "leg_driver:=serial", "camera_driver:=serial"]
    patient = [word for word in quick_bed if not word.startswith("lab.")] + ["serial_legs.legs_lease_s:=1.0"]
    launch = ("ros2", "launch", "sandbot_bringup", "trackway.launch.py", f"cameras:={slow_cameras}")
    start(*launch, *drivers, *lines, *patient)
    plan = plan_of_one(omega_rad_s=[8.0, 12.0], periods=6.0, cameras=str(slow_cameras))
    run = ("ros2", "run", "sandbot_bringup", "campaign", plan, "--silence", "5", "--out", tmp_path / "serial")
    live = start(*run, "--redo", "failed")
    simulated.until(lambda line: line == "legs: moving", 120.0)
    simulated.type("pull legs\n")
    assert seconds(simulated.until(lambda line: "legs: at rest by themselves" in line)) < 1.0 + BUSY_S
    live.until(lambda line: ": failed: " in line)
    simulated.type("plug legs\n")
    finished(live, *run)
    assert batch_of(plan, tmp_path / "batch") == 0
    for one, other in zip(rows(tmp_path / "serial"), rows(tmp_path / "batch"), strict=True):
        assert (one["status"], other["status"]) == ("ok", "ok")
        assert float(one["speed_m_s"]) == pytest.approx(float(other["speed_m_s"]), rel=0.01)
    aside = list((tmp_path / "serial" / "trials" / ".partial").iterdir())
    status = [Bag.open(bag).provenance["trial"]["exit_status"] for bag in aside]
    assert any("serial_legs" in one or "/leg_states" in one for one in status), status
