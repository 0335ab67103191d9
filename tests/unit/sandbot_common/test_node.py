import dataclasses
import math
import os
import pwd
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from types import SimpleNamespace

import pytest
import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.parameter import Parameter

from sandbot_common import messages, process
from sandbot_common.errors import InputError
from sandbot_common.health import TIMELESS
from sandbot_common.parameters import parameter
from sandbot_common.ros import node, ros_health, ros_parameters
from sandbot_common.ros.timer import end_timers
from sandbot_common.standstill import Standstill
from sandbot_common.stop import stop_signals

PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"


@pytest.mark.parametrize(("frames", "most_held"), [(True, 2 * 100 * 640 * 480), (False, 10 * 640 * 480)])
def test_shared_memory_holds_a_second_of_two_cameras_where_frames_are_published(monkeypatch, frames, most_held):
    monkeypatch.delenv(PROFILE, raising=False)
    monkeypatch.delenv("FASTDDS_DEFAULT_PROFILES_FILE", raising=False)
    node.use_shared_memory(frames=frames)
    profile = Path(os.environ[PROFILE])
    monkeypatch.delenv(PROFILE)
    tree = ElementTree.parse(profile)
    space = {"": "http://www.eprosima.com"}
    (size,) = (int(one.text) for one in tree.iterfind(".//segment_size", space))
    assert size > most_held
    # One transport of a kind: two of shared memory would listen at one port. UDP reaches other hosts.
    (built_in,) = (one.text for one in tree.iterfind(".//useBuiltinTransports", space))
    assert built_in == "false"
    used = [one.text for one in tree.iterfind(".//userTransports/transport_id", space)]
    described = tree.iterfind(".//transport_descriptor", space)
    kinds = {one.findtext("transport_id", "", space): one.findtext("type", "", space) for one in described}
    assert sorted(kinds[name] for name in used) == ["SHM", "UDPv4"]


@pytest.mark.parametrize("text", ["999", "233", "-1", "1e2", "abc", "7.0"])
def test_a_domain_that_cannot_work_is_refused_by_name(monkeypatch, text):
    """Fast DDS ended the process from 233 on, and -1 and 1e2 were taken for other numbers."""
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    with pytest.raises(InputError, match=f"ROS_DOMAIN_ID: '{text}' is not a whole number from 0 to 232"):
        node.start_ros([])


@pytest.mark.parametrize("text", ["", "0", "101", "232"])
def test_a_domain_that_can_work_is_left_to_ros(monkeypatch, text):
    started = []
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    monkeypatch.setattr(rclpy, "init", lambda **given: started.append(given))
    node.start_ros([])
    assert len(started) == 1


def test_a_profile_of_the_users_own_stays(monkeypatch):
    monkeypatch.delenv(PROFILE, raising=False)
    monkeypatch.setenv("FASTDDS_DEFAULT_PROFILES_FILE", "mine.xml")
    node.use_shared_memory(frames=False)
    assert PROFILE not in os.environ


CHILD = [sys.executable, "-c", "import os; print(os.sched_getscheduler(0))"]


def test_real_time_is_for_this_thread_and_this_while_alone():
    before = os.sched_getscheduler(0)
    if before != os.SCHED_OTHER or not process.ask_for_real_time(1):
        pytest.skip("real-time priority is not granted here")
    os.sched_setscheduler(0, before, os.sched_param(0))
    with process.real_time(5):
        assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO
        assert int(subprocess.check_output(CHILD)) == os.SCHED_OTHER
    with process.real_time(5, inherited=True):
        assert int(subprocess.check_output(CHILD)) == os.SCHED_FIFO
    assert os.sched_getscheduler(0) == before


def test_who_may_not_have_it_runs_as_he_is(monkeypatch):
    def refuse(*_):
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with process.real_time(5):
        assert os.sched_getscheduler(0) != os.SCHED_FIFO


@pytest.mark.parametrize(
    ("slip", "said"),
    [
        ("--bogus", "--bogus"),
        ("--params-file nosuch.yaml", "'--params-file nosuch.yaml'"),
        ("-r __ns:=bad-name", "'-r __ns:=bad-name'"),
        ("--log-level nosuch", "'--log-level nosuch'"),
        ("-p omega_rad_s:=[1", "'-p omega_rad_s:=[1'"),
    ],
)
def test_a_slip_behind_ros_args_is_one_line(slip, said, capfd):
    assert node.run(lambda: pytest.fail("a node was made"), ["--ros-args", *slip.split()]) == 2
    err = capfd.readouterr().err
    assert said in err
    assert "/project/" not in err
    assert err.count("\n") == 1


@pytest.mark.parametrize("given", [None, "/dev/null"])
def test_who_has_no_home_starts_with_the_one_the_system_knows(given):
    """As a service of the system; a home that is given is kept, though it can't be one."""
    code = "from sandbot_common.ros import node; import os; node.start_ros([]); print(os.environ['HOME'])"
    places = {"HOME", "ROS_HOME", "ROS_LOG_DIR"}
    env = {name: value for name, value in os.environ.items() if name not in places} | ({"HOME": given} if given else {})
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=False)
    if given is None:
        assert (done.stdout, done.stderr) == (f"{pwd.getpwuid(os.getuid()).pw_dir}\n", "")
    else:
        assert "/dev/null/.ros/log" in done.stderr


def test_a_log_folder_that_cannot_be_is_refused_with_what_helps():
    code = (
        "from sandbot_common import cli; from sandbot_common.ros import node; cli.run(lambda _: node.start_ros([]), [])"
    )
    elsewhere = os.environ | {"ROS_LOG_DIR": "/dev/null/log"}
    done = subprocess.run([sys.executable, "-c", code], env=elsewhere, capture_output=True, text=True, check=False)
    *_, told = done.stderr.splitlines()
    assert told.startswith("-c: error: ROS does not start: ")
    assert "/dev/null/log" in told
    assert told.endswith("; ROS_LOG_DIR can name a folder that you may write to")


@dataclasses.dataclass(frozen=True)
class Legs:
    rate_hz: float = parameter(2.0, unit="Hz", doc="a rate", low=0.0, high=50.0)
    port: int = parameter(80, doc="a port", low=1, high=65535)


@pytest.fixture
def given(domain):
    """``given(name=value)``: the ``Parameters`` of a node that is started with these."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    made = []

    def start(**overrides):
        asked = [Parameter(name, value=value) for name, value in overrides.items()]
        made.append(rclpy.create_node("legs", context=context, parameter_overrides=asked))
        return made[-1], ros_parameters.Parameters(made[-1], Legs)

    yield start
    for one in made:
        one.destroy_node()
    context.try_shutdown()


@pytest.mark.ros
def test_a_whole_number_is_a_float_where_one_is_meant_at_start_and_later(given):
    one, parameters = given(rate_hz=12)
    assert parameters.current == Legs(rate_hz=12.0)
    assert one.set_parameters([Parameter("rate_hz", value=3)])[0].successful
    assert parameters.current == Legs(rate_hz=3.0)
    assert one.get_parameter("rate_hz").type_ == Parameter.Type.DOUBLE
    assert not one.set_parameters([Parameter("rate_hz", value=99)])[0].successful
    assert not one.set_parameters([Parameter("port", value=8.5)])[0].successful
    assert parameters.current == Legs(rate_hz=3.0)


@pytest.mark.ros
@pytest.mark.parametrize(
    ("slip", "said"),
    [
        ({"rate_hz": 58}, r"rate_hz: 58 is outside \[0, 50\] Hz \(a rate\)"),
        ({"rate_hz": "fast"}, "rate_hz: 'fast' is not a number"),
        ({"port": 99999}, r"port: 99999 is outside \[1, 65535\]"),
        ({"port": 8.5}, "port: 8.5 is not a whole number"),
    ],
)
def test_a_wrong_parameter_is_said_in_the_words_of_every_other_file(given, slip, said):
    with pytest.raises(InputError, match=f"legs parameters: {said}"):
        given(**slip)


@pytest.mark.parametrize(
    ("values", "older"),
    [
        ({"process": "here 2 99"}, True),
        ({"process": "here 2 101"}, False),
        ({"process": "here 2 odd"}, False),
        ({"process": "here 2 ²"}, False),
        ({"since_ns": "4"}, True),
        ({"since_ns": "6"}, False),
        ({"since_ns": "²"}, False),
        ({"since_ns": "1" * 5000}, False),
        ({}, False),
    ],
)
def test_who_is_older_whatever_another_program_says(values, older):
    assert health_of("here 1 100", 5)._is_older(values) is older


@pytest.mark.parametrize(
    ("woke_s", "theirs", "older"),
    [
        (math.nan, {"process": "here 2 99"}, True),
        (2.0, {"process": "here 2 150"}, True),  # began while this one stood still
        (2.0, {"process": "here 2 99", "woke": "250"}, False),  # both stood still: the machine did
        (2.0, {"process": "here 2 250"}, False),
        (math.nan, {"process": "here 2 99", "woke": "150"}, False),
        (math.nan, {"process": "here 2 99", "woke": "odd"}, True),
    ],
)
def test_a_process_that_stood_still_is_as_old_as_its_waking(monkeypatch, woke_s, theirs, older):
    monkeypatch.setattr(ros_health.os, "sysconf", lambda _: 100)
    health = health_of("here 1 100", 5)
    if woke_s > 0:
        health._awake.woke_s = woke_s
    assert health._is_older(theirs) is older


@pytest.mark.parametrize(("stood_s", "older"), [(1.0, False), (41.0, True)])
def test_on_another_host_it_is_so_too(monkeypatch, stood_s, older):
    now_s = [100.0]
    monkeypatch.setattr(ros_health, "_since_boot_s", lambda: now_s[0])
    health = health_of("here 1 100", 5)
    health._turn()
    assert not health.held_up_s
    now_s[0] += stood_s
    assert health.held_up_s == stood_s * older
    assert health._is_older({"process": "there 2 3", "since_ns": "7"}) is older
    now_s[0] += 2.0
    health._turn()
    assert health.held_up_s == stood_s * older
    for _ in range(4):
        now_s[0] += 1.0
        health._turn()
    assert not health.held_up_s


@pytest.mark.parametrize(
    ("held_s", "lives", "said"),
    [
        (0.0, True, "another campaign is running already; one commander at a time, end it first"),
        (41.0, True, "held up for 41 s, and another campaign has taken over meanwhile; one commander at a time, "),
        (41.0, False, ""),  # what it said while this one was frozen is read after its end
    ],
)
def test_a_campaign_is_told_why_it_yields_and_to_the_living_only(held_s, lives, said):
    health = health_of(process.own_name(), time.time_ns())
    health._awake.held_s, namesake = held_s, SimpleNamespace(node_name="campaign")
    health._node = SimpleNamespace(
        get_name=lambda: "campaign", get_publishers_info_by_topic=lambda _: [namesake, namesake]
    )
    host = process.own_name().split()[0]
    first = f"{host} 1 {process._stat(1)[19]}"  # a parent may have started in the same tick
    theirs = first if lives else f"{host} 1 {int(first.split()[2]) + 1}"
    health._check_for_older(messages.diagnostics(1, "campaign", {"process": theirs}))
    assert health.refused.startswith(said) if said else not health.refused


@pytest.mark.ros
def test_a_node_whose_loop_stands_still_has_not_settled_however_long_it_waits(domain, monkeypatch):
    """A camera's line is read by a thread of its own: it showed frames before its loop had heard the other one."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    one, executor = rclpy.create_node("bed", context=context), EventsExecutor(context=context)
    executor.add_node(one)
    sent, health = [], ros_health.Health(one, lambda: sent.append(1) or {}, sole=True)
    try:
        while not sent:
            node.spin_once(executor, one, 1.0)
        with monkeypatch.context() as later:
            later.setattr(ros_health, "time", SimpleNamespace(monotonic=lambda: time.monotonic() + 60.0))
            assert not health.settled
        while not health.settled:
            node.spin_once(executor, one, 1.0)
        health.refused = "another bed is running already"
        assert not health.settled
    finally:
        end_timers(one)
        one.destroy_node()
        context.try_shutdown()


def health_of(process, since_ns):
    """What a node says of its age, without a graph."""
    health = ros_health.Health.__new__(ros_health.Health)
    health._process, health._since_ns, health._awake, health.refused = process, since_ns, Standstill(), ""
    return health


@pytest.mark.parametrize(
    ("simulated", "publishers", "level", "said"),
    [
        (True, 0, 0, (1, "use_sim_time is set, but nobody publishes /clock: stamps show 1970")),
        (True, 0, 2, (2, "stopped")),  # a fault takes precedence
        (True, 1, 0, (0, "ok")),
        (False, 0, 0, (0, "ok")),
    ],
)
def test_a_node_whose_time_nobody_publishes_says_so(simulated, publishers, level, said):
    health, sent = health_of("", 1), []
    health.level, health.text, health.ended = level, "stopped" if level else "ok", ""
    health._publisher = SimpleNamespace(publish=sent.append)
    health._node = SimpleNamespace(
        get_name=lambda: "tracker",
        get_clock=lambda: SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=0)),
        get_parameter=lambda _: SimpleNamespace(value=simulated),
        count_publishers=lambda _: publishers,
    )
    health._publish({})
    (status,) = sent[0].status
    assert (status.level[0], status.message) == said
    assert (TIMELESS in messages.values_of(status)) is (simulated and not publishers)


@pytest.mark.parametrize(("earlier_ns", "older"), [(0, False), (1000, True)])
def test_no_node_is_older_than_itself(earlier_ns, older):
    health = health_of("", 1795999802423893281)
    assert health._is_older({"since_ns": str(health._since_ns - earlier_ns)}) is older


@pytest.mark.parametrize("asked", [True, False])
def test_who_was_told_to_end_ignores_ctrl_c_while_it_leaves(asked):
    before = signal.getsignal(signal.SIGINT)
    try:
        with stop_signals() as stop:
            for _ in range(6 * asked):
                signal.raise_signal(signal.SIGINT)
        assert stop.asked is asked
        assert signal.getsignal(signal.SIGINT) == (signal.SIG_IGN if asked else before)
    finally:
        signal.signal(signal.SIGINT, before)
