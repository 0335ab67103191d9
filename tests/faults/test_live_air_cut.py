"""Air that its driver has turned off by himself: a bed with less air than told is not prepared.

The bed's process is frozen for a moment only, which it does not notice; its driver is told by the system at once.
"""

import contextlib
import signal
import subprocess
import sys

import pytest
from processes import ending, running

from sandbot_common import topics
from sandbot_common.ros import endpoints

pytestmark = [pytest.mark.ros, pytest.mark.timeout(240)]

QUICK = {"fluidise_s": 2.0, "ramp_s": 0.3, "settle_s": 0.4, "pulse_off_s": 0.3, "average_s": 0.2}
BED = (
    *(f"{name}:={value}" for name, value in QUICK.items()),
    "target_phi:=0.605",
    "lease_s:=2.0",
    "bad_reading_s:=2.0",
)


@contextlib.contextmanager
def serial_bed(folder):
    """A bed on a serial line and its driver; yields the simulated device's process."""
    device = [sys.executable, "-m", "sandbot_hardware.simulate_command", str(folder), "--lease", "1.0"]
    driver = running("sandbot_hardware.nodes.serial_bed_node", f"device:={folder / 'bed'}", "air_lease_s:=2.0")
    with ending(subprocess.Popen(device, stdin=subprocess.PIPE, text=True)) as simulated, driver:
        yield simulated


@pytest.fixture(params=["lab", "serial_bed"])
def driver(request, domain, tmp_path):
    """Who drives the blower, by name."""
    with contextlib.ExitStack() as stack:
        if request.param == "lab":
            stack.enter_context(running("sandbot_lab.nodes.lab_node", "images:=false", "air_lease_s:=2.0"))
        else:
            stack.enter_context(serial_bed(tmp_path / "dev"))
        yield request.param


class Heard:
    """What is said of a bed and its air while a test runs beside them."""

    def __init__(self, beside):
        self.beside, self.blown, self.told, self.stages = beside, [], {}, []
        endpoints.subscription(beside.node, topics.BED_BLOWER, lambda message: self.blown.append(message.data))
        endpoints.subscription(beside.node, topics.DIAGNOSTICS, self._on_diagnostics)
        endpoints.subscription(beside.node, topics.BED_STATUS, self._on_status)

    def _on_diagnostics(self, message):
        for status in message.status:
            self.told[status.name] = {pair.key: pair.value for pair in status.values}

    def _on_status(self, message):
        values = {pair.key: pair.value for pair in message.status[0].values}
        self.stages.append((values["stage"], message.status[0].message))

    def driven(self, driver):
        return self.told.get(driver, {}).get("blower") == "1.0"

    def prepare(self, driver):
        self.beside.until(lambda: driver in self.told and float(self.told.get("bed", {}).get("height_m", "nan")) > 0)
        assert self.beside.call("/bed/prepare").success
        self.stages.clear()
        self.beside.until(lambda: self.driven(driver))

    def ends(self):
        """The stage in which a preparation ends, and what is said of it."""
        self.beside.until(lambda: self.stages and self.stages[-1][0] in ("ready", "failed"))
        return self.stages[-1]


@pytest.fixture
def heard(beside):
    return Heard(beside)


@pytest.mark.whole  # the next one has the other cause
def test_a_bed_that_had_less_air_than_told_is_not_prepared(driver, heard):
    with running("sandbot_bed.nodes.bed_node", *BED) as bed:
        heard.prepare(driver)
        bed.send_signal(signal.SIGSTOP)
        heard.beside.until(lambda: not heard.driven(driver))
        bed.send_signal(signal.SIGCONT)
        assert heard.ends() == ("failed", f"{driver} turned the air off by itself while the bed was being prepared")
        heard.beside.until(lambda: heard.blown[-1] == 0)

        heard.prepare(driver)  # once more, and nobody turns it off
        assert (ended := heard.ends())[0] == "ready", ended


def test_a_cable_that_was_out_for_a_moment_ends_the_air(heard, tmp_path):
    """Its controller may have turned the air off meanwhile: the next level would turn it on again."""
    with serial_bed(tmp_path / "dev") as simulated, running("sandbot_bed.nodes.bed_node", *BED):
        heard.prepare("serial_bed")
        simulated.stdin.write("pull bed\nplug bed\n")
        simulated.stdin.flush()
        assert heard.ends() == ("failed", "serial_bed turned the air off by itself while the bed was being prepared")
        heard.beside.until(lambda: not heard.driven("serial_bed"))
        heard.beside.until(lambda: int(heard.told["serial_bed"]["opened"]) == 2)

        heard.prepare("serial_bed")
        assert (ended := heard.ends())[0] == "ready", ended
