"""The predictor as a real process over DDS: told φ, ω and leg angles, it says speed, mean speed and error."""

import json
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from sandbot_common import messages, topics
from sandbot_common.robot import Robot, to_mapping
from sandbot_common.ros import endpoints
from sandbot_model.nodes.predictor_node import PredictorNode
from sandbot_model.predictor_parameters import PredictorParameters

BIG = Robot(leg_radius_m=0.05, leg_mount_rad=0.5)


@pytest.fixture
def predictor(domain):
    process = subprocess.Popen([sys.executable, "-m", "sandbot_model.nodes.predictor_node"])
    yield process
    process.terminate()
    process.wait(30)


class Unwired(PredictorNode):
    """The node without ROS: what it is told and what it publishes."""

    def __init__(self, **parameters):
        self.curves = []
        self._settings = SimpleNamespace(current=PredictorParameters(**parameters))
        self._health = SimpleNamespace(level=0, text="ok")
        self._mean = SimpleNamespace(publish=lambda _: None)
        self._curve = SimpleNamespace(publish=lambda message: self.curves.append(json.loads(message.data)))
        self._robot, self._phi = None, 0.633
        self._use(self._settings.current)

    def hears(self, **trial):
        self._on_trial(messages.string(json.dumps({"omega_rad_s": 16.0, "leg_mount_rad": 0.5} | trial)))


def test_new_parameters_keep_the_robot_of_the_trial_and_draw_its_curve_anew():
    node = Unwired()
    node.hears(robot=to_mapping(BIG))
    node._use(PredictorParameters(delta_t_s=0.2))
    assert node._predictor.model.robot == BIG
    node._on_phi(messages.float64(0.633))
    before, after = node.curves
    assert after["phi"] == before["phi"]
    assert after["speed_m_s"] != before["speed_m_s"]


@pytest.mark.parametrize("odd", [{"omega_rad_s": "fast"}, {"omega_rad_s": 10**400}, {"leg_mount_rad": 10**400}])
def test_a_trial_that_cannot_be_read_is_forgotten_with_the_next_one(odd):
    node = Unwired()
    node.hears(**odd)
    assert (node._health.level, "can't be read" in node._health.text) == (1, True)
    node.hears()
    assert (node._health.level, node._health.text) == (0, "ok")


@pytest.mark.parametrize(("angles", "rates", "predicted"), [(6, 6, 1), (0, 0, 0), (6, 3, 0), (0, 6, 0)])
def test_leg_states_without_angles_or_rates_are_ignored(angles, rates, predicted):
    node, speeds = Unwired(), []
    node._speed = SimpleNamespace(publish=speeds.append)
    node.hears()
    node._on_legs(messages.joint_state(1, topics.LEGS, np.zeros(angles), np.zeros(rates), np.zeros(6)))
    assert len(speeds) == predicted


def test_a_trial_of_another_robot_than_that_of_the_parameters_is_said_so(tmp_path):
    (tmp_path / "robot.yaml").write_text("leg_radius_m: 0.04\n", encoding="utf-8")
    node = Unwired(robot=str(tmp_path / "robot.yaml"))
    node.hears(robot=to_mapping(BIG))
    node._use(node._settings.current)
    assert "for another robot than that of /trial" in node._health.text
    assert node._predictor.model.robot.leg_radius_m == 0.04


@pytest.mark.ros
def test_follows_a_trial(predictor, beside):
    trial, phi, legs, measured = (
        endpoints.publisher(beside.node, topic)
        for topic in (topics.TRIAL, topics.BED_PHI, topics.LEG_STATES, topics.SPEED_MEAN)
    )
    speeds, means, errors, curves = [], [], [], []
    endpoints.subscription(beside.node, topics.MODEL_CURVE, lambda message: curves.append(json.loads(message.data)))
    endpoints.subscription(beside.node, topics.MODEL_SPEED, speeds.append)
    endpoints.subscription(beside.node, topics.MODEL_SPEED_MEAN, means.append)
    endpoints.subscription(beside.node, topics.MODEL_ERROR, errors.append)
    trial.publish(messages.string("no JSON"))
    trial.publish(
        messages.string(json.dumps({"trial_id": "t", "omega_rad_s": 16.0, "gait": "UNIFORM", "leg_mount_rad": 0.5}))
    )
    phi.publish(messages.float64(0.633))
    angles = np.array([0.0] * 3 + [np.pi] * 3) - 0.5

    def answered():
        legs.publish(messages.joint_state(1_000, topics.LEGS, angles, np.full(6, 16.0), np.zeros(6)))
        measured.publish(messages.float64(0.25))
        assert predictor.poll() is None, "the predictor has gone"
        return speeds and means and errors

    beside.until(answered)
    assert speeds[-1].twist.twist.linear.x == pytest.approx(0.0355 * 16.0)
    assert means[-1].data == pytest.approx(0.2135, abs=5e-4)
    assert errors[-1].data == pytest.approx(0.25 - means[-1].data)
    beside.until(lambda: curves)
    assert len(curves) == 1  # and not one more with every leg state
    assert (curves[0]["phi"], curves[0]["gait"]) == (0.633, "UNIFORM")
    assert np.interp(16.0, curves[0]["omega_rad_s"], curves[0]["speed_m_s"]) == pytest.approx(means[-1].data)

    told = {"trial_id": "t", "omega_rad_s": 16.0, "leg_mount_rad": 0.5, "robot": to_mapping(BIG)}
    trial.publish(messages.string(json.dumps(told)))

    def walks_with_longer_legs():
        return answered() and speeds[-1].twist.twist.linear.x == pytest.approx(BIG.leg_radius_m * 16.0)

    beside.until(walks_with_longer_legs)
