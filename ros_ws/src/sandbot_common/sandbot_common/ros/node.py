"""How every node starts, reads its parameters, reports its health and stops."""

import math
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Generic, TypeVar

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.client import Client
from rclpy.duration import Duration
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.logging import LoggingSeverity
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription

from sandbot_common import cli, messages, topics
from sandbot_common.dead_ports import fresh_participant_number
from sandbot_common.errors import InputError
from sandbot_common.health import ending
from sandbot_common.parameters import Spec, check, from_mapping, specs
from sandbot_common.process import ask_for_real_time, keep_memory, own_name
from sandbot_common.ros.timer import Timer, end_timers
from sandbot_common.suggest import did_you_mean
from sandbot_common.typed import number_or_nan

T = TypeVar("T")

LAST_WORDS_S = 0.5
"""How long an ending node waits for another thread to send its last messages. Their readers may acknowledge them
seconds later, with the next DDS heartbeat, which is not waited for."""
ASK_AGAIN_S = 2.0
SETTLE_S = 0.5
"""This long after its first turn a node has heard any older one of its name: health is sent five times a second."""
BEAT_S = 0.05
"""Period of a process's /heartbeat."""
END_WITH_PARENT = "TRACKWAY_END_WITH_PARENT"
"""Environment variable, set to 1 by a launch: its nodes end when it is gone, even killed."""
_BEAT_PRIORITY = 5
_SINCE = "since_ns"
AIR_STOPS = "air_stops"
"""Key of /diagnostics: how often the blower's driver has turned the air off by itself, against its orders."""
PROCESS = "process"
"""Key of /diagnostics: which process a node is, for nodes on the same host (``process.Neighbour``)."""
NAMELESS = "_NODE_NAME_UNKNOWN_"
"""ROS's name for the node of an endpoint it no longer knows, or not yet. A live commander renews under its own name."""
_LOOK_S = 0.05
"""How soon an idle node sees that it is to end."""
LAST_DOMAIN = 232
"""The last ROS domain whose ports exist: 7400 + 250 * domain. Those above 101 may meet ports of other programs."""
_PROFILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")


def qos(topic: topics.Topic, *, best_effort: bool = False, depth: int | None = None) -> QoSProfile:
    """The QoS of a topic: reliable unless ``best_effort``, transient local if latched, the topic's depth by default."""
    durability = DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE
    reliability = ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE
    return QoSProfile(depth=depth or topic.depth, reliability=reliability, durability=durability)


def publisher(node: Node, topic: topics.Topic) -> Publisher:
    """A publisher on a trackway topic; it offers the topic's deadline, which its subscriptions need not ask for."""
    offered = qos(topic)
    if math.isfinite(topic.deadline_s):
        # Manual: a publisher counts as alive while it commands, not while its process exists.
        offered.liveliness = LivelinessPolicy.MANUAL_BY_TOPIC
        offered.deadline = offered.liveliness_lease_duration = Duration(seconds=topic.deadline_s)
    return node.create_publisher(messages.message_class(topic.type), topic.relative, offered)


def subscription(
    node: Node,
    topic: topics.Topic,
    callback: Callable[[Any], None],
    *,
    raw: bool = False,
    best_effort: bool = False,
    depth: int | None = None,
) -> Subscription:
    """A subscription on a trackway topic; ``raw`` passes the serialized bytes to the callback.

    ``best_effort`` matches publishers of either reliability, but lost messages are not sent again.
    """
    delivery = qos(topic, best_effort=best_effort, depth=depth)
    return node.create_subscription(messages.message_class(topic.type), topic.relative, callback, delivery, raw=raw)


def spin_once(executor: EventsExecutor, node: Node, timeout_s: float) -> None:
    """One turn of a node's loop; raises, once, what one of its ``Timer`` callbacks raised, so cleanup can spin on."""
    executor.spin_once(timeout_sec=timeout_s)
    if (error := getattr(node, "failed", None)) is not None:
        node.failed = None
        raise error


def reliabilities(node: Node, topic: topics.Topic) -> list[bool]:
    """Whether each publisher of a topic is reliable, as far as the graph is known."""
    found = node.get_publishers_info_by_topic(topic.relative)
    return [endpoint.qos_profile.reliability != ReliabilityPolicy.BEST_EFFORT for endpoint in found]


def ask(
    client: Client,
    request: Any,
    wait: Callable[[Callable[[], bool], float], bool],
    patience_s: float,
    begun: Callable[[], bool] = lambda: False,
) -> Any:
    """The response of a service, requested again every two seconds; None if there is none within ``patience_s``.

    A server may receive a new client's request before it knows where to respond; rmw_fastrtps then drops the response
    after 0.1 s ("client will not receive response"). The request was executed all the same, so it must be idempotent,
    or ``begun`` must tell that it was executed: then it is not repeated, as somebody may since have ended what it
    began. ``wait(condition, timeout_s)`` spins until the condition holds, and returns whether it does.
    """
    asked: list[Any] = []

    def answered() -> bool:
        return any(future.done() for future in asked)

    for _ in range(math.ceil(patience_s / ASK_AGAIN_S)):
        asked.append(client.call_async(request))
        if wait(answered, ASK_AGAIN_S) or begun():
            break
    for future in asked:
        client.remove_pending_request(future)
    return next((future.result() for future in asked if future.done()), None)


def fixed(why: str) -> Callable[[object], None]:
    """For ``Parameters``: a callback that refuses every change, saying ``why``."""

    def refuse(_: object) -> None:
        raise InputError(why)

    return refuse


class Parameters(Generic[T]):
    """ROS parameters declared from a parameter dataclass; ``current`` is always a valid instance.

    An invalid change is refused with the reason; a valid one calls ``on_change`` with the new instance.
    """

    def __init__(self, node: Node, cls: type[T], on_change: Callable[[T], None] | None = None) -> None:
        self._cls = cls
        self._names = [spec.name for spec in specs(cls)]
        self._where = f"{node.get_name()} parameters"
        self._on_change = on_change
        default = cls()
        _convert_given(node, cls, self._where)
        try:
            given = {
                spec.name: node.declare_parameter(spec.name, _ros(getattr(default, spec.name)), _descriptor(spec)).value
                for spec in specs(cls)
            }
        except ParameterException as error:
            raise InputError(f"{self._where}: {error}") from None
        _refuse_unknown(node, self._where)
        self.current: T = from_mapping(cls, given, self._where)
        node.add_pre_set_parameters_callback(self._to_floats)
        node.add_on_set_parameters_callback(self._set)

    def _to_floats(self, asked: list[Parameter]) -> list[Parameter]:
        """ROS itself refuses 12 where 12.0 is meant."""
        floats = {spec.name for spec in specs(self._cls) if spec.type is float}
        whole = Parameter.Type.INTEGER
        return [
            Parameter(each.name, value=float(each.value)) if each.name in floats and each.type_ == whole else each
            for each in asked
        ]

    def _set(self, changed: list[Parameter]) -> SetParametersResult:
        ours = {parameter.name: parameter.value for parameter in changed if parameter.name in self._names}
        if not ours:
            return SetParametersResult(successful=True)
        values = {name: getattr(self.current, name) for name in self._names}
        try:
            new = from_mapping(self._cls, {**values, **ours}, self._where)
            if self._on_change is not None:
                self._on_change(new)
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self.current = new
        return SetParametersResult(successful=True)


def names_of(endpoints: Sequence[Any]) -> list[str]:
    """The names of the nodes behind publishers or subscriptions, each once."""
    return sorted({str(endpoint.node_name) for endpoint in endpoints})


class Health:
    """Publishes a node's key figures on /diagnostics five times a second, which is also its sign of life.

    ``sole``: of several nodes of its name only the oldest stays (``refused`` tells the younger ones why they must end,
    and ``run`` ends them): a second clock or bed would command the same legs and the same air. Create it before the
    node's other publishers: one that publishes without it is not ours (``Rivals``).
    """

    def __init__(
        self, node: Node, values: Callable[[], Mapping[str, object]], period_s: float = 0.2, *, sole: bool = False
    ) -> None:
        self._node, self._values = node, values
        self.level, self.text = 0, "ok"
        self.refused = ""
        self.ended = ""
        """Why the node ends: reported in its last message instead of its level and text."""
        self._since_ns, self._process = time.time_ns(), own_name()
        self._turned_s = math.inf
        self._publisher = publisher(node, topics.DIAGNOSTICS)
        Timer(node, period_s, self.publish)
        node.health = self
        if sole:
            subscription(node, topics.DIAGNOSTICS, self._check_for_older)

    @property
    def settled(self) -> bool:
        """Whether it had time to find an older node of its name, and found none; a ``sole`` node is silent before."""
        return not self.refused and time.monotonic() - self._turned_s >= SETTLE_S

    def publish(self) -> None:
        """Publish now."""
        self._turned_s = min(self._turned_s, time.monotonic())
        self._publish(self._values())

    def announce_end(self, why: str) -> None:
        """Report that the node ends, without its figures: from any thread, even while the node's own is busy."""
        self.ended = why
        self._publish({})

    def _publish(self, figures: Mapping[str, object]) -> None:
        # Read after the figures are computed, as some nodes then set level and text.
        level, text = (2, ending(self.ended)) if self.ended else (self.level, self.text)
        values = {**figures, _SINCE: self._since_ns, PROCESS: self._process}
        now_ns = self._node.get_clock().now().nanoseconds
        self._publisher.publish(messages.diagnostics(now_ns, self._node.get_name(), values, level=level, text=text))

    def _check_for_older(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = messages.values_of(status)
            if status.name == self._node.get_name() and self._is_older(values) and self._has_namesake():
                self.refused = f"another {status.name} is running already; one commander at a time, end it first"

    def _has_namesake(self) -> bool:
        """Whether another node of this name publishes; otherwise the message is from a bag that ``replay`` plays."""
        found = self._node.get_publishers_info_by_topic(topics.DIAGNOSTICS.relative)
        return sum(endpoint.node_name == self._node.get_name() for endpoint in found) > 1

    def _is_older(self, values: Mapping[str, str]) -> bool:
        """Whether the sender is older than this node. Processes are named by host, PID and start (``own_name``)."""
        ours, theirs = self._process.split(), values.get(PROCESS, "").split()
        if len(ours) == len(theirs) == 3 and ours[0] == theirs[0] and ours[2] != theirs[2]:
            # Same host: start times count from its boot, so setting the system clock does not change them.
            return number_or_nan(theirs[2]) < int(ours[2])
        # Both as floats, to whose precision a node is not older than itself.
        return number_or_nan(values.get(_SINCE)) < float(self._since_ns)


def use_shared_memory(*, frames: bool) -> None:
    """Have Fast DDS use fastdds.xml, or with ``frames`` fastdds_frames.xml, before ``rclpy.init``.

    A profile chosen by the user takes precedence.
    """
    if not any(name in os.environ for name in _PROFILES):
        os.environ[_PROFILES[0]] = str(Path(__file__).with_name("fastdds_frames.xml" if frames else "fastdds.xml"))


def start_ros(argv: Sequence[str]) -> None:
    """``rclpy.init`` without its signal handlers. Raises InputError for arguments or a domain that ROS can't read."""
    _check_domain(os.environ.get("ROS_DOMAIN_ID", ""))
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


def _check_domain(text: str) -> None:
    """Refuse what Fast DDS has no port for, and then ends the process, or what ROS reads as another number."""
    if text and not (text.isascii() and text.isdecimal() and int(text) <= LAST_DOMAIN):
        raise InputError(f"ROS_DOMAIN_ID: {text!r} is not a whole number from 0 to {LAST_DOMAIN}")


def run(
    make: Callable[[], Node],
    argv: Sequence[str] | None = None,
    *,
    frames: bool = False,
) -> int:
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


class Stop:
    """Whether the process is to end, and why."""

    def __init__(self) -> None:
        self.why = ""

    @property
    def asked(self) -> bool:
        """Whether anybody asked."""
        return bool(self.why)

    def ask(self, why: str) -> None:
        """Request the end. A plain attribute, not an Event: a signal handler must not wait for a lock of its thread."""
        self.why = self.why or why

    def say(self, name: str) -> None:
        """Print one line about the reason, unless the terminal has been closed."""
        if self.why:
            with suppress(OSError):
                print(f"{name}: {ending(self.why)}", file=sys.stderr, flush=True)


@contextmanager
def stop_signals() -> Iterator[Stop]:
    """Ctrl-C, kill and a closed terminal request an orderly end; no effect outside the main thread.

    Afterwards a process that was asked ignores Ctrl-C: typed again, it would end the exit with another code.
    """
    stop = Stop()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {each: signal.signal(each, lambda number, _: stop.ask(signal.Signals(number).name)) for each in numbers}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_IGN if stop.asked and number == signal.SIGINT else handler)


def _convert_given(node: Node, cls: type, where: str) -> None:
    """Check the numbers given at start, and convert them as in YAML (12 to 12.0), before ROS refuses them in its words.

    Raises InputError.
    """
    for spec in specs(cls):
        override = node._parameter_overrides.get(spec.name)
        if override is not None and spec.type in (float, int):
            node._parameter_overrides[spec.name] = Parameter(spec.name, value=check(spec, override.value, where))


def _refuse_unknown(node: Node, where: str) -> None:
    known = list(node._parameters)
    for name in _undeclared(node):
        raise InputError(f"{where}: unknown parameter {name!r}{did_you_mean(name, known)}")


def refuse_parameters(node: Node) -> None:
    """Raise InputError if a node configured by options was given a parameter; call before it declares any."""
    for name in _undeclared(node):
        raise cli.no_parameter(name, node.get_name())


def _undeclared(node: Node) -> list[str]:
    # ROS silently ignores a misspelt -p.
    given = node._parameter_overrides
    return [name for name in given if not node.has_parameter(name) and not name.startswith(cli.OF_EVERY_NODE)]


def _descriptor(spec: Spec) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(description=spec.described)
    bounded = math.isfinite(spec.low) and math.isfinite(spec.high)
    if bounded and spec.type is float:
        descriptor.floating_point_range = [FloatingPointRange(from_value=float(spec.low), to_value=float(spec.high))]
    if bounded and spec.type is int:
        descriptor.integer_range = [IntegerRange(from_value=int(spec.low), to_value=int(spec.high), step=1)]
    return descriptor


def _ros(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value
