"""The replay node: publishes the messages that are due with their recorded QoS, and /clock.

With a terminal, space pauses, and arrow keys seek by a second and change the rate; for programs there are the services
/replay/pause (SetBool) and /replay/restart (Trigger), and the parameters `rate` and `position_s`.
"""

import contextlib
import os
import re
import select
import sys
import termios
import threading
import time
import tty
from collections import deque
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rclpy
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import QosDurability, QosReliability
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool, Trigger

from sandbot_common import messages, topics
from sandbot_common.errors import InputError
from sandbot_common.ros.endpoints import names_of
from sandbot_common.ros.node import run
from sandbot_common.ros.ros_parameters import refuse_parameters
from sandbot_common.ros.timer import Timer
from sandbot_common.terminal import counted
from sandbot_record.bags.file_bytes import FileLost
from sandbot_record.bags.metadata import TopicInfo
from sandbot_record.bags.playback import SECOND_NS, Player
from sandbot_record.bags.reader import Message

_CLOCK_PERIOD_NS = 10_000_000
_SPIN_NS = 200_000
"""The last part of a wait is a busy loop, as a sleep ends late by about this much."""
_MIN_DEPTH = 50
_LATE = 100_000
"""The last so many messages tell how late they were; --loop may play for days."""
_DISCOVERY_S, _CHECK_PERIOD_S = 0.5, 0.05
_COMMANDS = tuple(topic.name for topic in topics.COMMANDS)
_MEASURED = tuple(topic.name for topic in topics.MEASURED)
_REPORTS = (topics.LEG_STATES.name, topics.BED_HEIGHT.name)
"""Topics that a live robot and bed publish."""
_KEY = re.compile("\x1b\\[[A-D]|.")
"""One key, an arrow or a character: keys typed quickly arrive in one read."""


@dataclass(frozen=True)
class Options:
    """How to publish: new names for topics, /clock or not, and how long to wait for the discovery of subscribers.

    ``commands``: whether to publish also what a live robot or bed would obey, and what a trial would be measured by.
    """

    remap: Mapping[str, str]
    clock: bool = False
    delay_s: float = 1.0
    commands: bool = False


class Replay(Node):
    """Publishes a player's messages in a thread of its own."""

    def __init__(self, player: Player, options: Options) -> None:
        super().__init__("replay")
        refuse_parameters(self)
        self._player, self._options = player, options
        self._lock = threading.Lock()
        self._changed, self._stop = threading.Event(), threading.Event()
        played = player.timeline.topics
        names = {name: self.resolve_topic_name(options.remap.get(name, topics.relative(name))) for name in played}
        self._watched = () if options.commands else _live_topics(names.values())
        # Before there is a publisher: a campaign would end its trial because of it.
        self._check_not_live_at_start()
        self._outlets = {
            name: self.create_publisher(_class(info), names[name], _qos(info)) for name, info in played.items()
        }
        self._clock_outlet = self.create_publisher(Clock, "/clock", 10) if options.clock else None
        self._clock_due_ns = 0
        self._late_ns: deque[int] = deque(maxlen=_LATE)
        self._error: Exception | None = None
        self.published = self.missing = 0
        self.create_service(SetBool, "replay/pause", self._on_pause)
        self.create_service(Trigger, "replay/restart", self._on_restart)
        self.declare_parameter("rate", player.rate, ParameterDescriptor(description="bag seconds per second, above 0"))
        self.declare_parameter(
            "position_s", 0.0, ParameterDescriptor(description="set it to seek [s after the bag's first message]")
        )
        self.add_on_set_parameters_callback(self._on_parameters)
        self._thread = threading.Thread(target=self._run, name="player", daemon=True)
        self._thread.start()
        Timer(self, _CHECK_PERIOD_S, self._check)

    def _check_not_live_at_start(self) -> None:
        """Repeat ``_check_not_live`` until the discovery of publishers has had its time."""
        deadline = time.monotonic() + max(self._options.delay_s, _DISCOVERY_S) if self._watched else 0.0
        while time.monotonic() < deadline:
            self._check_not_live()
            self._stop.wait(_CHECK_PERIOD_S)

    def _check_not_live(self) -> None:
        """Raise InputError if commands would reach a running robot or bed, or messages mix with those of others."""
        for name in self._watched:
            if any(other != self.get_name() for other in names_of(self.get_publishers_info_by_topic(name))):
                raise InputError(
                    f"the trackway is live ({name} is published) and would take the bag's messages for its own; "
                    "rename them (--remap, or all with --ros-args -r __ns:=/replay), or insist with --with-commands"
                )

    def close(self) -> None:
        """Stop publishing."""
        self._stop.set()
        self._changed.set()
        self._thread.join()

    def last_line(self) -> str:
        """The summary line printed at the end: how many messages, and how late they were."""
        replayed = f"replayed {counted(self.published, 'message')}"
        if self.missing:
            replayed += f", {self.missing} frames were not in their video"
        if not self._late_ns:
            return replayed
        median, p99, worst = (value * 1e-6 for value in np.quantile(self._late_ns, (0.5, 0.99, 1.0)))
        late = f"{median:.3f} ms (median), {p99:.3f} (p99), {worst:.3f} (worst)"
        last = f" of the last {_LATE} messages" if len(self._late_ns) == _LATE else ""
        return f"{replayed}; late by {late}{last}"

    def key(self, key: str) -> None:
        """Handle a key of the terminal."""
        now = time.monotonic_ns()
        with self._lock:
            player = self._player
            offset_s = (player.position_ns(now) - player.timeline.start_ns) / SECOND_NS
            if key == " ":
                player.pause(not player.paused, now)
            elif key in ("\x1b[C", "\x1b[D"):
                player.seek(offset_s + (1.0 if key == "\x1b[C" else -1.0), now)
            elif key in ("\x1b[A", "\x1b[B"):
                player.set_rate(player.rate * (1.1 if key == "\x1b[A" else 1 / 1.1), now)
        self._changed.set()

    def _check(self) -> None:
        if not self._thread.is_alive():
            if self._error is not None:
                raise self._error
            self.done = True
        # A robot or bed switched on during the replay would obey it without a lease.
        self._check_not_live()

    def _run(self) -> None:
        try:
            self._play()
        except Exception as error:  # from a codec, for example: ends the node
            self._error = error

    def _play(self) -> None:
        with contextlib.suppress(InputError):  # only to load its block now
            _ = self._player.timeline[min(self._player.index, len(self._player.timeline) - 1)]
        self._stop.wait(self._options.delay_s)
        for kept in self._player.latched_before_start():
            self._outlets[kept.topic].publish(bytes(kept.data))
        while not self._stop.is_set() and not self._player.finished:
            now = time.monotonic_ns()
            with self._lock:
                due = self._player.due_ns()
                message = self._step(now)
                position = self._player.position_ns(now)
            self._tick(now, position)
            if message is None:
                self._wait(now)
                continue
            self._outlets[message.topic].publish(bytes(message.data))
            self.published += 1
            if due is not None:
                self._late_ns.append(time.monotonic_ns() - due)
        for publisher in self._outlets.values():
            with contextlib.suppress(Exception):  # only to let reliable readers catch up; not every middleware can
                publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=1))

    def _step(self, now: int) -> Message | None:
        try:
            return self._player.step(now)
        except FileLost:
            raise
        except InputError as error:
            self.missing += 1
            self.get_logger().warning(str(error), throttle_duration_sec=5.0)
            return None

    def _wait(self, now: int) -> None:
        with self._lock:
            due = self._player.due_ns()
        until = now + 50_000_000 if due is None else due
        if self._clock_outlet is not None:
            until = min(until, self._clock_due_ns)
        if (left := until - time.monotonic_ns() - _SPIN_NS) > 0 and self._changed.wait(left * 1e-9):
            self._changed.clear()

    def _tick(self, now: int, position_ns: int) -> None:
        if self._clock_outlet is not None and now >= self._clock_due_ns:
            self._clock_outlet.publish(Clock(clock=messages.stamp(position_ns)))
            self._clock_due_ns = now + _CLOCK_PERIOD_NS

    def _on_pause(self, request: Any, response: Any) -> Any:
        with self._lock:
            self._player.pause(request.data, time.monotonic_ns())
        self._changed.set()
        response.success, response.message = True, "paused" if request.data else "playing"
        return response

    def _on_restart(self, _: Any, response: Any) -> Any:
        with self._lock:
            self._player.seek(0.0, time.monotonic_ns())
        self._changed.set()
        response.success, response.message = True, "restarted"
        return response

    def _on_parameters(self, changed: list[Parameter]) -> SetParametersResult:
        wanted, now = {parameter.name: parameter.value for parameter in changed}, time.monotonic_ns()
        with self._lock:
            before = self._player.rate
            try:
                self._player.set_rate(float(wanted.get("rate", before)), now)
                if "position_s" in wanted:
                    self._player.seek(float(wanted["position_s"]), now)
            except InputError as error:
                self._player.set_rate(before, now)  # none is set if one is refused
                return SetParametersResult(successful=False, reason=str(error))
        self._changed.set()
        return SetParametersResult(successful=True)


def replay(player: Player, options: Options, arguments: Sequence[str] = ()) -> tuple[int, str]:
    """Replay to the end or to SIGINT; the exit code and the last line to print."""
    made: list[Replay] = []

    def make() -> Replay:
        made.append(Replay(player, options))
        return made[0]

    with _keys(made):
        code = run(make, arguments, frames=True)
    return code, made[0].last_line() if made else ""


@contextlib.contextmanager
def _keys(nodes: list[Replay]) -> Iterator[None]:
    """Pass the terminal's keys to the node, and restore the terminal afterwards."""
    if not sys.stdin.isatty():
        yield
        return
    before = termios.tcgetattr(sys.stdin)
    done = threading.Event()

    def listen() -> None:
        while not done.is_set():
            if not nodes:
                done.wait(0.05)
            elif select.select([sys.stdin], [], [], 0.1)[0]:
                for key in _KEY.findall(os.read(sys.stdin.fileno(), 1024).decode(errors="ignore")):
                    nodes[0].key(key)

    thread = threading.Thread(target=listen, daemon=True)
    try:
        tty.setcbreak(sys.stdin)
        thread.start()
        yield
    finally:
        done.set()
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)


def _live_topics(names: Collection[str]) -> tuple[str, ...]:
    """Topics that another commander, a robot or bed that would obey the bag, or a second source would publish.

    ``names``: under which the bag's topics are published, in any namespace.
    """
    # /robot1/bed/blower is obeyed by the bed that reports /robot1/bed/height.
    spaces = {name.removesuffix(end) for name in names for end in _COMMANDS if name.endswith(end)}
    obeying = [space + name for space in sorted(spaces) for name in (*_COMMANDS, *_REPORTS)]
    return (*obeying, *(name for name in names if name.endswith(_MEASURED)))


def _class(info: TopicInfo) -> Any:
    try:
        return messages.message_class(info.type)
    except (ImportError, AttributeError, ValueError):
        raise InputError(
            f"topic {info.name}: type {info.type!r} is not installed here; leave it out with --topics"
        ) from None


def _qos(info: TopicInfo) -> QoSProfile:
    """As recorded, with the weakest guarantees of several publishers; reliable and volatile if nothing is known."""
    latched = bool(info.qos) and all(profile.durability == QosDurability.TRANSIENT_LOCAL for profile in info.qos)
    reliable = all(profile.reliability != QosReliability.BEST_EFFORT for profile in info.qos)
    depth = (
        max([_MIN_DEPTH, *(profile.depth for profile in info.qos)])
        if not latched
        else max([1, *(profile.depth for profile in info.qos)])
    )
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=min(depth, 5000),
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
