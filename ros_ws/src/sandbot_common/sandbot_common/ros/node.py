"""How every node starts, beats and stops."""

import os
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import rclpy
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.logging import LoggingSeverity
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from sandbot_common import cli, messages, topics
from sandbot_common.dead_ports import fresh_participant_number
from sandbot_common.errors import InputError
from sandbot_common.process import ask_for_real_time, keep_memory
from sandbot_common.ros.endpoints import qos
from sandbot_common.ros.ros_health import Health
from sandbot_common.ros.timer import end_timers
from sandbot_common.stop import Stop, stop_signals

LAST_WORDS_S = 0.5
"""How long an ending node waits for another thread to send its last messages. Their readers may acknowledge them
seconds later, with the next DDS heartbeat, which is not waited for."""
BEAT_S = 0.05
"""Period of a process's /heartbeat."""
END_WITH_PARENT = "TRACKWAY_END_WITH_PARENT"
"""Environment variable, set to 1 by a launch: its nodes end when it is gone, even killed."""
_BEAT_PRIORITY = 5
_LOOK_S = 0.05
"""How soon an idle node sees that it is to end."""
LAST_DOMAIN = 232
"""The last ROS domain whose ports exist: 7400 + 250 * domain. Those above 101 may meet ports of other programs."""
_PROFILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")


def run(make: Callable[[], Node], argv: Sequence[str] | None = None, *, frames: bool = False) -> int:
    """Start ROS, make the node, spin until Ctrl-C or shutdown, and always clean up; exit code as in cli.run.

    ``frames``: whether the node publishes camera frames, which need more shared memory.
    """

    def command(arguments: Sequence[str]) -> int:
        use_shared_memory(frames=frames)
        keep_memory()
        # Our own signals: ROS's handlers end the context at once, and close() could no longer publish "air off".
        with stop_signals() as stop:
            start_ros([sys.argv[0], *arguments])
            node: Node | None = None
            try:
                with fresh_participant_number(rclpy.get_default_context().get_domain_id()):
                    node = make()
                with _beating(node, stop) as turn:
                    _spin(node, stop, turn)
            finally:
                if node is not None:
                    health = getattr(node, "health", None)
                    if isinstance(health, Health):
                        health.ended = stop.why
                    if (close := getattr(node, "close", None)) is not None:
                        close()
                    stop.say(node.get_name())
                    if stop.asked and isinstance(health, Health):
                        health.publish()
                    _await_last_messages(node)
                    end_timers(node)
                    for outlet in reversed(list(node.publishers)):  # health last, see ``Rivals``
                        node.destroy_publisher(outlet)
                    node.destroy_node()
                rclpy.try_shutdown()
        return 0

    return cli.run(command, argv)


def spin_once(executor: EventsExecutor, node: Node, timeout_s: float) -> None:
    """One turn of a node's loop; raises, once, what one of its ``Timer`` callbacks raised, so cleanup can spin on."""
    executor.spin_once(timeout_sec=timeout_s)
    if (error := getattr(node, "failed", None)) is not None:
        node.failed = None
        raise error


def use_shared_memory(*, frames: bool) -> None:
    """Have Fast DDS use fastdds.xml, or with ``frames`` fastdds_frames.xml, before ``rclpy.init``.

    A profile chosen by the user takes precedence.
    """
    if not any(name in os.environ for name in _PROFILES):
        os.environ[_PROFILES[0]] = str(Path(__file__).with_name("fastdds_frames.xml" if frames else "fastdds.xml"))


def start_ros(argv: Sequence[str]) -> None:
    """``rclpy.init`` without its signal handlers. Raises InputError for arguments or a domain that ROS can't read."""
    _check_domain(os.environ.get("ROS_DOMAIN_ID", ""))
    _name_home()
    rclpy.logging.set_logger_level("rcl", LoggingSeverity.FATAL)  # it would add an uninformative line
    try:
        rclpy.init(args=list(argv), signal_handler_options=SignalHandlerOptions.NO)
    except _rclpy.UnknownROSArgsError as error:
        raise InputError(f"--ros-args: ROS knows no {error}") from None
    except _rclpy.RCLError as error:
        # Without locations in ROS's own source code.
        reason = re.sub(r",? at /\S+:\d+", "", str(error)).removeprefix("failed to initialize rcl: ")
        remedy = "; ROS_LOG_DIR can name a folder that you may write to" if "log" in reason else ""
        raise InputError(f"ROS does not start: {reason}{remedy}") from None
    finally:
        if rclpy.logging.get_logger_level("rcl") == LoggingSeverity.FATAL:
            rclpy.logging.set_logger_level("rcl", LoggingSeverity.UNSET)


def _name_home() -> None:
    """ROS keeps its logs below $HOME, which services of the system don't have; the system knows it all the same."""
    if "HOME" not in os.environ and os.path.isabs(home := os.path.expanduser("~")):
        os.environ["HOME"] = home


def _check_domain(text: str) -> None:
    """Refuse what Fast DDS has no port for, and then ends the process, or what ROS reads as another number."""
    if text and not (text.isascii() and text.isdecimal() and int(text) <= LAST_DOMAIN):
        raise InputError(f"ROS_DOMAIN_ID: {text!r} is not a whole number from 0 to {LAST_DOMAIN}")


@contextmanager
def _beating(node: Node, stop: "Stop") -> Iterator[Callable[[], None]]:
    """Publish /heartbeat from a thread: a dead or frozen process falls silent, a busy one does not.

    Yields what the node's loop must call at each turn; the heartbeats carry the time of the last call. A request to end
    is announced from this thread, too: on a busy machine the loop may take a second to notice it.
    """
    topic = topics.HEARTBEAT
    outlet = node.create_publisher(messages.message_class(topic.type), topic.relative, qos(topic, best_effort=True))
    ending, turned_ns = threading.Event(), time.time_ns()

    def turn() -> None:
        nonlocal turned_ns
        turned_ns = time.time_ns()

    def beat() -> None:
        ask_for_real_time(_BEAT_PRIORITY)
        health, announced = getattr(node, "health", None), False
        while not ending.wait(BEAT_S):
            outlet.publish(messages.header(turned_ns, node.get_name()))
            if stop.asked and not announced and isinstance(health, Health):
                announced = True
                health.announce_end(stop.why)

    thread = threading.Thread(target=beat, name="heartbeat", daemon=True)
    thread.start()
    try:
        yield turn
    finally:
        ending.set()
        thread.join()
        node.destroy_publisher(outlet)


def _await_last_messages(node: Node) -> None:
    """Wait until the last messages, above all "air off", are sent: a destroyed publisher discards them.

    Under load, 4 of 25 nodes ended without their last message; with this wait, none of 25.
    """
    end = time.monotonic() + LAST_WORDS_S
    for publisher in node.publishers:
        if rclpy.ok() and (left := end - time.monotonic()) > 0:
            publisher.wait_for_all_acked(Duration(seconds=left))


def _spin(node: Node, stop: "Stop", turn: Callable[[], None]) -> None:
    # Measured with these wheels: about twice the message rate of the default executor. Its spin() is avoided, as it
    # never runs Python's signal handlers and does not return on ROS's.
    executor = EventsExecutor()
    executor.add_node(node)
    parent = os.getppid() if os.environ.get(END_WITH_PARENT) == "1" else None
    with suppress(ExternalShutdownException):
        while rclpy.ok() and not stop.asked and not getattr(node, "done", False):
            spin_once(executor, node, _LOOK_S)
            turn()
            if parent is not None and os.getppid() != parent:
                stop.ask("the launch that started it is gone")
            if (health := getattr(node, "health", None)) is not None and health.refused:
                raise InputError(health.refused)
