"""Legs that come to rest in mid-walk: who stopped them decides whether the campaign may go on. Without a graph."""

from types import SimpleNamespace

import numpy as np
import pytest

from sandbot_bringup.endings import CampaignEnds, Held, TrialFailed
from sandbot_bringup.hold import Hold
from sandbot_bringup.nodes.campaign_node import CampaignNode
from sandbot_bringup.nodes.monitor_node import Monitor
from sandbot_common import messages, topics
from sandbot_common.health import LEGS_STOPPED
from sandbot_common.standstill import RAN

AT_REST, LAPSED = "was not running", f"{LEGS_STOPPED}no set-point for 0.25 s"


def walking(driver):
    """What a campaign hears in mid-walk, of a robot whose driver is a node of this name."""
    publishers = [SimpleNamespace(node_name=driver, endpoint_gid=[0])]
    node = SimpleNamespace(
        create_subscription=lambda *_, **__: None,
        count_publishers=lambda _: 1,
        get_publishers_info_by_topic=lambda _: publishers,
    )
    monitor = Monitor(node, 1.0, 0.02)
    monitor._on_setpoint(b"")
    monitor.may_move = True
    monitor.require(["clock"])
    monitor.watch_walking()
    tell_legs(monitor, 8.0)
    return monitor


def tell_legs(monitor, rate):
    six = np.zeros(6)
    monitor._on_legs(messages.joint_state(1, topics.LEGS, six, six + rate, six))


def told(monitor, name, level, text):
    monitor._on_diagnostics(messages.diagnostics(1, name, {}, level=level, text=text))


def campaign(monitor, answer, attended):
    """A campaign whose clock, asked to stop, answers this, and lives on without another set-point."""
    one = object.__new__(CampaignNode)
    one.hold, one.interface, one._monitor = Hold(), SimpleNamespace(attended=attended), monitor
    one._commanding, one._service_clients = True, SimpleNamespace(words=lambda _: one._commanding and answer)
    one._recorder = SimpleNamespace(ended=False, frozen=False)
    one._health = SimpleNamespace(held_up_s=0.0)

    def spin(condition, seconds):
        for _ in range(round(seconds / 0.02)):
            monitor._listening.now_s += 0.02
            monitor._supervisor.heard("clock", "its loop", monitor.now_s)
            monitor._supervisor.heard("bed", topics.BED_STATUS.name, monitor.now_s)
            if condition():
                return True
        return False

    one._spin_until = spin
    return one


@pytest.mark.parametrize("attended", [True, False])
@pytest.mark.parametrize(
    ("answer", "driver", "warning", "said"),
    [
        (AT_REST, "lab", "", "the legs were stopped by hand"),
        (RAN, "rig", "", r"the robot stopped by itself while it was told to move \(its emergency stop, or"),
        (RAN, "rig", "emergency stop", r"the robot stopped by itself .* \(rig: motors: emergency stop\)"),
        (RAN, "rig", LAPSED, r"the robot stopped by itself .* \(rig: motors: legs stopped"),  # not our words
    ],
)
def test_after_a_stop_by_hand_or_of_the_robot_nothing_moves_or_blows_until_somebody_says_go(
    answer, driver, warning, said, attended
):
    monitor = walking(driver)
    told(monitor, "tracker", 1, "frames late")  # somebody else's affair
    if warning:
        told(monitor, f"{driver}: motors", 2, warning)
    tell_legs(monitor, 0.0)
    one = campaign(monitor, answer, attended)
    with pytest.raises(Held if attended else CampaignEnds, match=said):
        one._explain_rest()
    assert not one._commanding


@pytest.mark.parametrize(
    ("answer", "node", "text", "said"),
    [
        (AT_REST, "clock", "stopped: the robot was silent for 0.25 s", "the clock: stopped: the robot was silent"),
        (RAN, "lab", LAPSED, "the lab: legs stopped: no set-point"),
        (RAN, "serial_legs", LAPSED, "the serial_legs: legs stopped: no set-point"),
    ],
)
def test_what_clock_and_drivers_say_of_a_lost_command_fails_the_trial_alone(answer, node, text, said):
    monitor = walking("serial_legs" if node == "serial_legs" else "lab")
    told(monitor, node, 2 if node == "clock" else 1, text)
    tell_legs(monitor, 0.0)
    with pytest.raises(TrialFailed, match=said):
        campaign(monitor, answer, attended=True)._explain_rest()


def test_a_campaign_that_is_stopped_meanwhile_is_held_for_that():
    monitor = walking("lab")
    tell_legs(monitor, 0.0)
    one = campaign(monitor, AT_REST, attended=True)
    one.hold.stop("stopped by the operator")
    with pytest.raises(Held, match="stopped by the operator"):
        one._explain_rest()
