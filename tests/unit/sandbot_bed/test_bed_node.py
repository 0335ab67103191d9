"""The bed node as a real process over DDS, with a stand-in for blower and height sensor."""

import subprocess
import sys

import numpy as np
import pytest
import rclpy
from rclpy.qos import qos_profile_sensor_data
from std_srvs.srv import Trigger

from sandbot_bed.nodes.bed_node import BedNode
from sandbot_common import messages, topics
from sandbot_common.ros import endpoints
from sandbot_common.ros.ros_health import SETTLE_TURNS
from sandbot_common.ros.timer import end_timers
from sandbot_common.standstill import BEGUN

pytestmark = pytest.mark.ros
FAST = {"fluidise_s": 0.3, "ramp_s": 0.3, "settle_s": 0.3, "pulse_off_s": 0.2, "average_s": 0.1, "target_phi": 0.59}


class StandIn:
    """A bed that the first air of a preparation loosens and each pulse after it packs by 0.002, and walking legs.

    It goes by what the blower does and not by what the node says of itself: topics keep no order among each other.
    """

    def __init__(self, beside):
        self.until, self.call = beside.until, beside.call
        self.rng, self.phi, self.packs, self.legs_rate = np.random.default_rng(0), 0.6, False, 0.0
        self.level, self.stages, self.final, self.text = None, [], [], ""
        self.height = endpoints.publisher(beside.node, topics.BED_HEIGHT)
        self.setpoints, self.states = (
            endpoints.publisher(beside.node, topic) for topic in (topics.LEG_SETPOINTS, topics.LEG_STATES)
        )
        self.legs = self.setpoints
        endpoints.subscription(beside.node, topics.BED_STATUS, self.on_status)
        endpoints.subscription(beside.node, topics.BED_PHI, lambda message: self.final.append(message.data))
        # Last: the node meets subscriptions in their order, so once its blower is heard all else is as well.
        endpoints.subscription(beside.node, topics.BED_BLOWER, self.on_blower)
        beside.node.create_timer(0.01, self.tick)

    def prepare(self):
        self.packs = False
        return self.call("/bed/prepare")

    def on_blower(self, message):
        if self.level and message.data == 0:
            self.phi = self.phi + 0.002 if self.packs else 0.58
            self.packs = True
        self.level = message.data

    def on_status(self, message):
        values = {pair.key: pair.value for pair in message.status[0].values}
        self.stages.append(values["stage"])
        self.text = message.status[0].message

    def tick(self):
        height_m = 79.75 / (1100 * 1.25 * self.phi) + 2e-5 * self.rng.standard_normal()
        self.height.publish(messages.range_(0, height_m, 0.05, 0.2, "trackway"))
        if self.legs_rate:
            legs = np.zeros(6)
            self.legs.publish(messages.joint_state(0, topics.LEGS, legs, legs + self.legs_rate, legs))


@pytest.fixture
def bed(beside):
    given = [word for key, value in FAST.items() for word in ("-p", f"{key}:={value}")]
    command = [sys.executable, "-m", "sandbot_bed.nodes.bed_node", "--ros-args", *given]
    process = subprocess.Popen(command)
    try:
        stand_in = StandIn(beside)
        stand_in.process = process
        heard = (stand_in.height, stand_in.setpoints, stand_in.states)
        stand_in.until(lambda: stand_in.level == 0 and all(one.get_subscription_count() for one in heard))
        yield stand_in
    finally:
        process.terminate()
        assert process.wait(timeout=30) == 0


def test_a_height_sensor_that_sends_best_effort_is_read(bed, beside):
    beside.node.destroy_publisher(bed.height)
    kind = messages.message_class(topics.BED_HEIGHT.type)
    bed.height = beside.node.create_publisher(kind, topics.BED_HEIGHT.relative, qos_profile_sensor_data)
    beside.until(bed.height.get_subscription_count)
    beside.until(lambda: bed.prepare().success)
    beside.until(lambda: bed.stages[-1] == "ready")


def test_prepares_refuses_beside_moving_legs_and_aborts(bed):
    assert bed.prepare().success
    again = bed.call("/bed/prepare")  # as whoever missed the answer does
    assert (again.success, again.message) == (True, "φ = 0.59 was being prepared")
    bed.until(lambda: bed.final)
    assert bed.final[0] == pytest.approx(0.59, abs=0.0012)
    bed.until(lambda: "pulse" in bed.stages and bed.stages[-1] == "ready")

    assert bed.prepare().success
    bed.until(lambda: bed.level > 0)
    bed.legs_rate = 3.0
    bed.until(lambda: bed.stages[-1] == "failed" and bed.level == 0)
    assert "legs began to move (/leg_setpoints)" in bed.text
    bed.legs = bed.states  # told nothing, and moving all the same

    def refused():
        answer = bed.call("/bed/prepare")
        return not answer.success and "legs move (/leg_states)" in answer.message

    bed.until(refused)

    bed.legs_rate = 0.0
    bed.until(lambda: bed.prepare().success)
    bed.until(lambda: bed.level > 0)
    assert bed.call("/bed/abort").message == "aborted, air off"
    bed.until(lambda: bed.level == 0)


def test_beside_another_commander_no_bed_is_prepared_and_its_air_is_not_called_off(bed, beside, domain):
    program = (
        "import rclpy, sys; from std_msgs.msg import Float64; rclpy.init(); one = rclpy.create_node('stranger');"
        "print('ready', flush=True); input(); air = one.create_publisher(Float64, '/bed/blower', 1); sys.stdin.read()"
    )
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    stranger = subprocess.Popen([sys.executable, "-c", program], text=True, **pipes)
    assert stranger.stdout.readline() == "ready\n"
    assert bed.prepare().success
    stranger.stdin.write("\n")
    stranger.stdin.flush()
    both = "bed and stranger both publish /bed/blower"
    bed.until(lambda: bed.stages[-1] == "failed" and bed.level == 0 and bed.text == both)
    assert (bed.prepare().success, bed.prepare().message) == (False, both)
    aborted = bed.call("/bed/abort")
    assert (aborted.success, aborted.message) == (False, f"nothing to abort, but {both}")
    stranger.communicate()
    bed.until(lambda: bed.prepare().success)
    assert bed.call("/bed/abort").message == "aborted, air off"


def test_the_air_goes_off_with_the_node(bed):
    assert bed.prepare().success
    bed.until(lambda: bed.level > 0)
    bed.process.terminate()
    bed.until(lambda: bed.level == 0)
    assert bed.process.wait(timeout=30) == 0


class Driver:
    """Keeps what it is told; its device may take nothing more."""

    def __init__(self):
        self.told, self.is_deaf = [], False

    def set_blower(self, level):
        if self.is_deaf:
            raise TimeoutError("write timeout")
        self.told.append(level)

    def read_height_m(self):
        return np.nan


@pytest.fixture
def here(domain):
    """A bed in this process, whose loop does not turn."""
    rclpy.init()
    bed = BedNode(Driver())
    yield bed
    end_timers(bed)
    rclpy.try_shutdown()


def test_a_second_bed_says_nothing_in_the_first_one_s_name(here):
    """It said that the air was off, and idle: a campaign that waited for the first one's preparation ended."""
    told, health = here._hardware._driver.told, here._health
    here._step()
    answer = here._on_prepare(None, Trigger.Response())
    assert (answer.success, answer.message) == (False, BEGUN)
    here.close()  # its launch ends, because another of its nodes has been refused
    health._turns = SETTLE_TURNS  # its loop has turned
    health.refused = "another bed is running already"
    here.close()
    assert told == []
    health.refused = ""
    here._step()
    assert told == [0.0]


def test_all_hear_that_the_air_is_to_go_off_though_the_driver_fails(here, beside):
    heard = []
    endpoints.subscription(beside.node, topics.BED_BLOWER, heard.append)
    here._hardware._driver.is_deaf, here._health._turns = True, SETTLE_TURNS
    beside.until(here._hardware._blower.get_subscription_count)
    here.close()
    beside.until(lambda: [message.data for message in heard] == [0.0])
