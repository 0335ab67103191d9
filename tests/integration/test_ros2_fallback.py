"""The ros2 fallback against real processes. Only the first lines of output are compared: the real ros2 passes too."""

import os
import re
import subprocess
import sys
import time

import pytest

pytestmark = [pytest.mark.ros, pytest.mark.timeout(400)]

TALKER = """
import rclpy
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.node import Node
from std_msgs.msg import Float64
from std_srvs.srv import SetBool

rclpy.init()
node = Node("talker")
bounds = [FloatingPointRange(from_value=0.0, to_value=2.0)]
node.declare_parameter("gain", 0.5, ParameterDescriptor(description="how much", floating_point_range=bounds))
publisher = node.create_publisher(Float64, "/talk", 10)
node.create_timer(0.01, lambda: publisher.publish(Float64(data=0.25)))


def answer(request, response):
    response.success, response.message = request.data, "heard"
    return response


node.create_service(SetBool, "/switch", answer)
print("talking", flush=True)
try:
    rclpy.spin(node)
except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
    pass
finally:
    node.destroy_node()
    rclpy.try_shutdown()
"""


@pytest.fixture
def ros2(ros_env):
    def run(*command):
        return subprocess.run(["ros2", *command], env=ros_env, text=True, capture_output=True, timeout=120)

    return run


@pytest.fixture
def talker(start):
    process = start(sys.executable, "-c", TALKER)
    process.until(lambda line: line == "talking")
    return process


def eventually(look, wanted, tries=10):
    """Ask again until ``wanted`` is among the lines: on a busy host discovery may take longer than one look."""
    for _ in range(tries):
        lines = look().stdout.splitlines()
        if wanted in lines:
            return lines
    raise AssertionError(f"{wanted!r} is not in {lines}")


def test_topics_and_nodes_are_seen(talker, ros2):
    eventually(lambda: ros2("topic", "list", "-t"), "/talk [std_msgs/msg/Float64]")
    assert ros2("topic", "type", "/talk").stdout == "std_msgs/msg/Float64\n"
    assert ros2("topic", "info", "/talk").stdout.startswith("Type: std_msgs/msg/Float64\nPublisher count: 1\n")
    assert eventually(lambda: ros2("node", "list"), "/talker") == ["/talker"]
    info = ros2("node", "info", "/talker").stdout
    assert info.startswith("/talker\n  Subscribers:\n")
    assert "    /talk: std_msgs/msg/Float64\n" in info
    missing = ros2("node", "info", "/nobody")
    assert (missing.returncode, missing.stdout) == (1, "")
    assert "Unable to find node '/nobody'" in missing.stderr


def test_messages_are_printed(talker, ros2):
    assert ros2("topic", "echo", "--once", "/talk").stdout == "data: 0.25\n---\n"
    assert ros2("topic", "echo", "--once", "--field", "data", "/talk").stdout == "0.25\n---\n"
    assert ros2("topic", "echo", "--once", "--csv", "/talk", "std_msgs/msg/Float64").stdout == "0.25\n"
    silent = ros2("topic", "echo", "/silence")
    assert silent.returncode == 1
    assert "does not appear to be published yet" in silent.stdout + silent.stderr
    assert "Could not determine the type for the passed topic" in silent.stderr


def test_echo_waits_for_a_typed_topic_and_ends_on_ctrl_c(start, ros_env):
    echo = start("ros2", "topic", "echo", "/talk", "std_msgs/msg/Float64")
    start(sys.executable, "-c", TALKER)
    echo.until(lambda line: line == "data: 0.25")
    echo.stop()
    assert not any("Traceback" in line for line in echo.lines)


BESIDE_CTRL_C = """
import os, signal, sys
from ros2cli_fallback import graph
with graph.node():
    try:
        if sys.argv[1] == "pressed":
            os.kill(os.getpid(), signal.SIGINT)
            signal.pause()
    except KeyboardInterrupt:
        pass
    raise RuntimeError("Unable to convert call argument '0' to Python object")
"""


@pytest.mark.parametrize(("how", "said"), [("pressed", "KeyboardInterrupt"), ("not pressed", "RuntimeError")])
def test_what_rclpy_makes_of_a_ctrl_c_is_one(ros_env, how, said):
    environment = {**ros_env, "PYTHONPATH": os.pathsep.join(["tools", ros_env.get("PYTHONPATH", "")])}
    done = subprocess.run([sys.executable, "-c", BESIDE_CTRL_C, how], env=environment, capture_output=True, text=True)
    assert done.stderr.splitlines()[-1].startswith(said)


def test_the_rate_is_measured(talker, start):
    rate = start("ros2", "topic", "hz", "-w", "200", "/talk")
    # A busy host may be late now and then; the mean of a hundred or two hundred intervals comes to what was meant.
    rate.until(lambda line: line.startswith("average rate: ") and 90.0 < float(line.split(":")[1]) < 110.0)
    rate.until(lambda line: re.fullmatch(r"\tmin: [\d.]+s max: [\d.]+s std dev: [\d.]+s window: \d+", line) is not None)
    rate.stop()
    assert not any("Traceback" in line for line in rate.lines)


def test_hz_waits_for_a_topic_that_comes_later(start):
    rate = start("ros2", "topic", "hz", "/talk")
    rate.until(lambda line: line == "WARNING: topic [/talk] does not appear to be published yet")
    start(sys.executable, "-c", TALKER)
    rate.until(lambda line: line.startswith("average rate: "))


def test_parameters(talker, ros2):
    eventually(lambda: ros2("param", "list", "/talker"), "  gain")
    assert ros2("param", "get", "/talker", "gain").stdout == "Double value is: 0.5\n"
    assert ros2("param", "set", "/talker", "gain", "1.5").stdout == "Set parameter successful\n"
    assert ros2("param", "get", "--hide-type", "/talker", "gain").stdout == "1.5\n"
    refused = ros2("param", "set", "/talker", "gain", "3.0")
    assert "Setting parameter failed" in refused.stdout + refused.stderr
    described = ros2("param", "describe", "/talker", "gain").stdout
    assert described == (
        "Parameter name: gain\n  Type: double\n  Description: how much\n"
        "  Constraints:\n    Min value: 0.0\n    Max value: 2.0\n"
    )
    assert "    gain: 1.5\n" in ros2("param", "dump", "/talker").stdout
    nobody = ros2("param", "get", "/nobody", "gain")
    assert (nobody.returncode, nobody.stderr) == (1, "Node not found\n")


def test_services(talker, ros2):
    eventually(lambda: ros2("service", "list", "-t"), "/switch [std_srvs/srv/SetBool]")
    answered = ros2("service", "call", "/switch", "std_srvs/srv/SetBool", "{data: true}").stdout
    assert "requester: making request: std_srvs.srv.SetBool_Request(data=True)\n" in answered
    assert "response:\nstd_srvs.srv.SetBool_Response(success=True, message='heard')\n" in answered
    wrong = ros2("service", "call", "/switch", "std_srvs/srv/SetBool", "{date: true}")
    assert wrong.returncode == 1
    assert "Failed to populate field" in wrong.stdout + wrong.stderr


def test_run_hands_over_signals_arguments_and_the_exit_code(start, ros2):
    clock = start("ros2", "run", "sandbot_clock", "clock", "--ros-args", "-r", "__node:=other", "-p", "rate_hz:=50.0")
    eventually(lambda: ros2("param", "get", "--hide-type", "/other", "rate_hz"), "50.0")
    assert clock.stop() == 0
    bad = ros2("run", "sandbot_clock", "clock", "--ros-args", "-p", "rate_hz:=1.0")
    assert bad.returncode == 2
    assert ros2("run", "nobody", "clock").stderr == "Package 'nobody' not found\n"


def test_console_serves_what_it_hears(start, ros2):
    import json
    import urllib.request

    console = start("ros2", "run", "sandbot_bringup", "console", "--ros-args", "-p", "port:=0")
    line = console.until(lambda one: "http://127.0.0.1:" in one)
    url = line[line.index("http://") :].rstrip("/")
    start(sys.executable, "-c", TALKER.replace("/talk", "/bed/blower"))

    def state():
        with urllib.request.urlopen(f"{url}/state", timeout=30) as answer:
            return json.load(answer)

    while "air on (0.25)" not in state()["safety"]["text"]:
        time.sleep(0.1)
    assert state()["safety"]["state"] == "unknown"  # nobody tells of the legs
    request = urllib.request.Request(f"{url}/call/start", method="POST", headers={"X-Trackway": str(state()["at_s"])})
    with urllib.request.urlopen(request, timeout=30) as answer:
        assert json.load(answer) == {"success": False, "message": "nobody offers /clock/start"}
    assert console.stop() == 0
