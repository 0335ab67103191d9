"""The system clock is set (NTP, `date -s`) while legs move or air blows: silence stops them all the same, and in time.

Nodes as real processes, whose own system clock is set and not the machine's (set_clock.c). Who stands still for as long
as the clock was set back fails these tests: it is set by far more than any busy machine adds.
"""

import os
import shutil
import struct
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest

from sandbot_common import messages, topics
from sandbot_common.ros import endpoints

pytestmark = [
    pytest.mark.ros,
    pytest.mark.timeout(180),
    pytest.mark.skipif(shutil.which("cc") is None, reason="a C compiler makes the clock that can be set"),
]

STEP_S = 15
STEPS = [-STEP_S, pytest.param(STEP_S, marks=pytest.mark.whole)]
STOPS_S = 8.0
"""A lease is a fraction of this; the rest is what a busy machine may add."""
OMEGA = 12.0


@pytest.fixture(scope="module")
def preload(tmp_path_factory):
    library = tmp_path_factory.mktemp("clock") / "set_clock.so"
    source = Path(__file__).with_name("set_clock.c")
    subprocess.run(["cc", "-shared", "-fPIC", "-O2", "-o", library, source, "-ldl"], check=True)
    return library


@pytest.fixture
def run(preload, tmp_path):
    """Run a node whose system clock ``run.set`` sets, in a context that ends it."""

    class Run:
        off = tmp_path / "off"

        def set(self, seconds):
            with self.off.open("r+b") as file:  # in place: the node has it mapped
                file.write(struct.pack("=q", seconds))

        @contextmanager
        def __call__(self, module, *given):
            parameters = [word for one in given for word in ("-p", one)]
            env = {**os.environ, "LD_PRELOAD": str(preload), "TRACKWAY_CLOCK_OFF": str(self.off)}
            process = subprocess.Popen([sys.executable, "-m", module, "--ros-args", *parameters], env=env)
            try:
                yield process
            finally:
                process.terminate()
                with suppress(subprocess.TimeoutExpired):
                    process.wait(20)
                process.kill()
                process.wait()

    Run.off.write_bytes(bytes(8))
    return Run()


class Commander:
    """Commands what it is told to, at 50 Hz, until it is to fall silent; hears what legs and blower do."""

    def __init__(self, beside):
        self.beside, self.height_m, self.told, self.commanding = beside, 0.1, {}, {}
        self.heard = {topic: [] for topic in (topics.LEG_SETPOINTS, topics.BED_BLOWER, topics.LEG_STATES)}
        for topic, kept in self.heard.items():
            endpoints.subscription(beside.node, topic, kept.append)
        endpoints.subscription(beside.node, topics.DIAGNOSTICS, self._on_diagnostics)
        beside.node.create_timer(0.02, lambda: [send() for send in self.commanding.values()])

    def command(self, topic):
        """Begin with it, once somebody hears it."""
        outlet = endpoints.publisher(self.beside.node, topic)
        self.beside.until(outlet.get_subscription_count)
        if topic is topics.LEG_SETPOINTS:
            outlet.publish(message_on(topic, 0.0))  # legs are told rest before they move
        self.commanding[topic] = lambda: outlet.publish(message_on(topic))

    def fall_silent(self):
        self.commanding.clear()

    def _on_diagnostics(self, message):
        for status in message.status:
            self.told[status.name] = {pair.key: pair.value for pair in status.values}

    def moves(self, topic):
        """Whether the last that was heard on a topic of legs is motion."""
        return bool(self.heard[topic]) and any(self.heard[topic][-1].velocity)

    def goes_on(self, on):
        """Whether it is on for a second and a half, longer than any lease."""
        return not self.beside.wait(lambda: not on(), 1.5)


def message_on(topic, omega=OMEGA):
    """Legs that turn, full air, a renewal, a loose bed."""
    now_ns = time.time_ns()
    return {
        topics.LEG_SETPOINTS: lambda: messages.joint_state(
            now_ns, topics.LEGS, np.ones(6), np.full(6, omega), np.zeros(6)
        ),
        topics.BED_BLOWER: lambda: messages.float64(1.0),
        topics.OPERATOR_LEASE: lambda: messages.header(now_ns, "beside"),
        topics.BED_HEIGHT: lambda: messages.range_(now_ns, 0.1, 0.05, 0.2, "bed"),
    }[topic]()


@pytest.fixture
def commander(beside):
    return Commander(beside)


@pytest.fixture
def stops_when_silent(commander, run):
    """What is on goes on though the clock be set back, and ends when its commander falls silent."""

    def check(on, seconds):
        commander.beside.until(on)
        run.set(seconds)
        assert commander.goes_on(on)
        commander.fall_silent()
        commander.beside.until(lambda: not on(), STOPS_S)

    return check


@pytest.mark.parametrize("step_s", STEPS)
def test_the_lab_stops_legs_and_air_whose_commander_is_silent(step_s, run, commander, beside, stops_when_silent):
    with run("sandbot_lab.nodes.lab_node", "images:=false", "legs_lease_s:=1.0", "air_lease_s:=1.0"):
        beside.until(lambda: "lab" in commander.told)
        commander.command(topics.LEG_SETPOINTS)
        stops_when_silent(lambda: commander.moves(topics.LEG_STATES), step_s)
        # The robot's time went on as it was, into no year of the clock's.
        before, rest = (messages.nanoseconds(state.header.stamp) for state in commander.heard[topics.LEG_STATES][-2:])
        assert 0 < rest - before < STOPS_S * 1e9

        commander.command(topics.BED_BLOWER)
        stops_when_silent(lambda: commander.told["lab"]["blower"] == "1.0", 2 * step_s)


@pytest.mark.parametrize("step_s", STEPS)
def test_the_bed_ends_its_air_without_a_lease(step_s, run, commander, beside, stops_when_silent):
    with run("sandbot_bed.nodes.bed_node", "fluidise_s:=60.0", "lease_s:=1.0"):
        for topic in (topics.OPERATOR_LEASE, topics.BED_HEIGHT):
            commander.command(topic)
        beside.until(lambda: beside.call("/bed/prepare").success)
        stops_when_silent(lambda: any(last.data > 0 for last in commander.heard[topics.BED_BLOWER][-1:]), step_s)


@pytest.mark.parametrize("step_s", STEPS)
def test_the_clock_ends_its_run_without_a_lease(step_s, run, commander, beside, stops_when_silent):
    with run("sandbot_clock.nodes.clock_node", f"omega_rad_s:={OMEGA}", "lease_s:=1.0", "late_s:=0.25"):
        commander.command(topics.OPERATOR_LEASE)
        beside.until(lambda: beside.call("/clock/start").success)
        stops_when_silent(lambda: commander.moves(topics.LEG_SETPOINTS), step_s)


def test_the_younger_of_two_clocks_leaves_though_it_thinks_itself_the_elder(run, commander, beside):
    with run("sandbot_clock.nodes.clock_node") as first:
        beside.until(lambda: "clock" in commander.told)
        run.set(-STEP_S)
        with run("sandbot_clock.nodes.clock_node") as second:
            beside.until(lambda: second.poll() is not None or first.poll() is not None)
            assert second.wait(20) == 2
            assert first.poll() is None


@pytest.mark.parametrize("step_s", STEPS)
def test_serial_drivers_stop_what_is_silent(step_s, run, commander, beside, stops_when_silent, tmp_path):
    """The legs' own watchdog waits for longer, so that it is the driver who stops them; the blower's is not asked."""
    command = [sys.executable, "-m", "sandbot_hardware.simulate_command", tmp_path / "dev", "--lease", "100"]
    devices = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        assert devices.stdout.readline().startswith("devices:")
        given = [f"device:={tmp_path / 'dev' / kind}" for kind in ("legs", "bed")]
        with (
            run("sandbot_hardware.nodes.serial_legs_node", given[0], "legs_lease_s:=1.0"),
            run("sandbot_hardware.nodes.serial_bed_node", given[1], "air_lease_s:=1.0"),
        ):
            beside.until(lambda: commander.heard[topics.LEG_STATES] and "serial_bed" in commander.told)
            commander.command(topics.LEG_SETPOINTS)
            stops_when_silent(lambda: commander.moves(topics.LEG_STATES), step_s)
            commander.command(topics.BED_BLOWER)
            stops_when_silent(lambda: commander.told["serial_bed"]["blower"] == "1.0", 2 * step_s)
    finally:
        devices.terminate()
        devices.communicate()
