"""The bed node as a real process over DDS, with a stand-in for blower and height sensor."""

import subprocess
import sys
from functools import partial

import numpy as np
import pytest

from sandbot_common import messages, node, topics

pytestmark = pytest.mark.ros
FAST = {"fluidise_s": 0.3, "ramp_s": 0.3, "settle_s": 0.3, "pulse_off_s": 0.2, "average_s": 0.1, "target_phi": 0.59}


class StandIn:
    """A bed that packs by 0.002 a pulse, and ears for what the node says."""

    def __init__(self, beside):
        self.until, self.call = partial(beside.until, seconds=30.0), beside.call
        self.rng, self.phi, self.level, self.levels, self.stages, self.final = (
            np.random.default_rng(0),
            0.6,
            0,
            [],
            [],
            [],
        )
        self.height = node.publisher(beside.node, topics.BED_HEIGHT)
        self.setpoints = node.publisher(beside.node, topics.LEG_SETPOINTS)
        node.subscription(beside.node, topics.BED_BLOWER, self.on_blower)
        node.subscription(beside.node, topics.BED_STATUS, self.on_status)
        node.subscription(beside.node, topics.BED_PHI, lambda message: self.final.append(message.data))
        beside.node.create_timer(0.01, self.read)

    def on_blower(self, message):
        if self.level > 0 and message.data == 0:
            self.phi = 0.58 if self.stages[-1] in ("ramp_down", "settle") and not self.pulsed else self.phi + 0.002
        self.level = message.data
        self.levels.append(message.data)

    @property
    def pulsed(self):
        return "pulse" in self.stages

    def on_status(self, message):
        values = {pair.key: pair.value for pair in message.status[0].values}
        self.stages.append(values["stage"])
        self.text = message.status[0].message

    def read(self):
        height_m = 79.75 / (1100 * 1.25 * self.phi) + 2e-5 * self.rng.standard_normal()
        self.height.publish(messages.range_(0, height_m, 0.05, 0.2, "trackway"))

    def move_legs(self, rate):
        legs = np.zeros(6)
        self.setpoints.publish(messages.joint_state(0, topics.LEGS, legs, legs + rate, legs))


@pytest.fixture
def bed(beside):
    given = [word for key, value in FAST.items() for word in ("-p", f"{key}:={value}")]
    command = [sys.executable, "-m", "sandbot_bed.bed_node", "--ros-args", *given]
    process = subprocess.Popen(command)
    try:
        stand_in = StandIn(beside)
        stand_in.process = process
        stand_in.until(lambda: stand_in.levels and stand_in.height.get_subscription_count())
        yield stand_in
    finally:
        process.terminate()
        assert process.wait(timeout=10) == 0


def test_prepares_refuses_beside_moving_legs_and_aborts(bed):
    bed.until(lambda: bed.setpoints.get_subscription_count())
    assert bed.call("/bed/prepare").success
    again = bed.call("/bed/prepare")  # as whoever missed the answer does
    assert (again.success, again.message) == (True, "φ = 0.59 was being prepared")
    bed.until(lambda: bed.final)
    assert bed.final[0] == pytest.approx(0.59, abs=0.0012)
    assert bed.pulsed
    bed.until(lambda: bed.stages[-1] == "ready")

    bed.stages.clear()
    assert bed.call("/bed/prepare").success
    bed.until(lambda: bed.level > 0)
    bed.move_legs(3.0)
    bed.until(lambda: bed.stages and bed.stages[-1] == "failed")
    bed.until(lambda: bed.level == 0)
    assert "legs began to move" in bed.text
    bed.move_legs(3.0)
    answer = bed.call("/bed/prepare")
    assert not answer.success
    assert "legs move" in answer.message

    def begun():
        return bed.call("/bed/prepare").success

    bed.until(begun)
    bed.until(lambda: bed.level > 0)
    assert bed.call("/bed/abort").message == "aborted, air off"
    bed.until(lambda: bed.level == 0)


def test_the_air_goes_off_with_the_node(bed):
    assert bed.call("/bed/prepare").success
    bed.until(lambda: bed.level > 0)
    bed.process.terminate()
    bed.until(lambda: bed.level == 0)
    assert bed.process.wait(timeout=10) == 0
