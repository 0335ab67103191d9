"""Air that its driver has turned off by himself: a bed with less air than told is not prepared.

The bed's process is frozen for a moment only, which it does not notice; its driver is told by the system at once.
"""

import contextlib
import signal
import subprocess
import sys

import pytest
from processes import ending, running

from sandbot_common import node, topics

pytestmark = [pytest.mark.ros, pytest.mark.timeout(240)]

QUICK = {"fluidise_s": 2.0, "ramp_s": 0.3, "settle_s": 0.4, "pulse_off_s": 0.3, "average_s": 0.2}
BED = (
    *(f"{name}:={value}" for name, value in QUICK.items()),
    "target_phi:=0.605",
    "lease_s:=2.0",
    "bad_reading_s:=2.0",
)


@pytest.fixture(params=[pytest.param("lab", marks=pytest.mark.whole), "serial_bed"])
def driver(request, domain, tmp_path):
    """Who drives the blower, by name."""
    with contextlib.ExitStack() as stack:
        if request.param == "lab":
            stack.enter_context(running("sandbot_lab.lab_node", "images:=false", "air_lease_s:=2.0"))
        else:
            device = [sys.executable, "-m", "sandbot_hardware.simulate_command", str(tmp_path / "dev")]
            stack.enter_context(ending(subprocess.Popen(device, stdin=subprocess.PIPE)))
            given = (f"device:={tmp_path / 'dev' / 'bed'}", "air_lease_s:=2.0")
            stack.enter_context(running("sandbot_hardware.serial_bed_node", *given))
        yield request.param


def test_a_bed_that_had_less_air_than_told_is_not_prepared(driver, beside):
    blown, told, stages = [], {}, []

    def on_diagnostics(message):
        for status in message.status:
            told[status.name] = {pair.key: pair.value for pair in status.values}

    def on_status(message):
        values = {pair.key: pair.value for pair in message.status[0].values}
        stages.append((values["stage"], message.status[0].message))

    node.subscription(beside.node, topics.BED_BLOWER, lambda message: blown.append(message.data))
    node.subscription(beside.node, topics.DIAGNOSTICS, on_diagnostics)
    node.subscription(beside.node, topics.BED_STATUS, on_status)

    def driven():
        return told.get(driver, {}).get("blower") == "1.0"

    def prepare():
        assert beside.call("/bed/prepare").success
        stages.clear()
        beside.until(driven)

    with running("sandbot_bed.bed_node", *BED) as bed:
        beside.until(lambda: "bed" in told and driver in told and float(told["bed"]["height_m"]) > 0)
        prepare()
        bed.send_signal(signal.SIGSTOP)
        beside.until(lambda: not driven())
        bed.send_signal(signal.SIGCONT)
        beside.until(lambda: stages and stages[-1][0] == "failed")
        assert stages[-1][1] == f"{driver} turned the air off by itself while the bed was being prepared"
        beside.until(lambda: blown[-1] == 0)

        prepare()  # once more, and nobody turns it off
        beside.until(lambda: stages and stages[-1][0] in ("ready", "failed"))
        assert stages[-1][0] == "ready"
