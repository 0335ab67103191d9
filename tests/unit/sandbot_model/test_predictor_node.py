"""The predictor as a real process over DDS: told φ, ω and leg angles, it says speed, mean speed and error."""

import json
import subprocess
import sys
import time

import numpy as np
import pytest

pytestmark = pytest.mark.ros


@pytest.fixture
def bench(domain):
    """A node beside the predictor, on a domain of its own."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    process = subprocess.Popen([sys.executable, "-m", "sandbot_model.predictor_node"])
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    beside = rclpy.create_node("beside", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(beside)

    def until(true, again, seconds=30.0):
        end = time.monotonic() + seconds
        while not true():
            assert time.monotonic() < end, "waited in vain"
            assert process.poll() is None, "the predictor has gone"
            again()
            executor.spin_once(timeout_sec=0.05)

    yield beside, until
    process.terminate()
    process.wait(10)
    beside.destroy_node()
    context.try_shutdown()


def test_follows_a_trial(bench):
    from sandbot_common import messages, node, topics

    beside, until = bench
    trial, phi, legs, measured = (
        node.publisher(beside, topic) for topic in (topics.TRIAL, topics.BED_PHI, topics.LEG_STATES, topics.SPEED_MEAN)
    )
    speeds, means, errors = [], [], []
    node.subscription(beside, topics.MODEL_SPEED, speeds.append)
    node.subscription(beside, topics.MODEL_SPEED_MEAN, means.append)
    node.subscription(beside, topics.MODEL_ERROR, errors.append)
    trial.publish(messages.string("no JSON"))
    trial.publish(
        messages.string(json.dumps({"trial_id": "t", "omega_rad_s": 16.0, "gait": "UNIFORM", "leg_mount_rad": 0.5}))
    )
    phi.publish(messages.float64(0.633))
    angles = np.array([0.0] * 3 + [np.pi] * 3) - 0.5

    def step():
        legs.publish(messages.joint_state(1_000, topics.LEGS, angles, np.full(6, 16.0), np.zeros(6)))
        measured.publish(messages.float64(0.25))

    until(lambda: speeds and means and errors, step)
    assert speeds[-1].twist.twist.linear.x == pytest.approx(0.0355 * 16.0)
    assert means[-1].data == pytest.approx(0.2135, abs=5e-4)
    assert errors[-1].data == pytest.approx(0.25 - means[-1].data)
