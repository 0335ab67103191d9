"""The recorder node: finds topics and types, subscribes with the publishers' QoS, passes the bytes on.

Messages are taken from DDS in a separate thread with a wait set, not through an executor: only this way are publish
time and sequence number available (the events executor of these wheels can't deliver them), and it costs the least CPU.

A lost message is detected in two ways: as a gap in the publisher's sequence numbers (where a topic has one publisher),
and by the middleware's message-lost event. Neither covers what was published before we were matched, what a publisher
dropped from its own queue before sending it if nothing came after, or what a best-effort publisher sent last.
"""

import re
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.type_support import check_for_type_support
from rosbags.interfaces import Qos
from std_srvs.srv import SetBool, Trigger

from sandbot_common import messages, topics
from sandbot_common.errors import InputError
from sandbot_common.files import parse_json
from sandbot_common.host_clock import HostClock
from sandbot_common.ros.node import run
from sandbot_common.ros.ros_health import Health
from sandbot_common.ros.ros_parameters import refuse_parameters
from sandbot_common.ros.timer import Timer
from sandbot_common.terminal import counted
from sandbot_record.bags import frames, interfaces, metadata
from sandbot_record.bags.mcap_writer import LIBRARY
from sandbot_record.bags.recording import Received, Recording

NOTE = topics.Topic("/recorder/note", "std_msgs/msg/String")
_DEPTH = 2000
"""Queue depth: two seconds of 1 kHz when the CPU is busy; both ends need it (measured)."""
_BATCH_S = 0.005
"""Period of taking messages: waking up for each costs more than the message. DDS stamps them on arrival."""
_POLL_S = 0.1
_HISTORY_NS = 1_000_000_000
"""Time after /trial within which latched messages of an earlier trial may still come; this trial's φ takes longer."""
_SETTLED, _SETTLED_UNHEARD = 3, 10
"""Polls in a row without anything new before "recording to" is printed; more if a wanted topic has no publisher yet."""
_INTERNAL = ("/rosout", "/parameter_events", "/recorder/", topics.HEARTBEAT.name)
_KNOWN = {topic.name: topic for topic in (*topics.ALL, NOTE)}


@dataclass(frozen=True)
class Selection:
    """What to record: named topics, all, or those matching ``regex``; ``images``: raw, jpeg, video or none.

    ``fresh``: no latched messages from before the recording. ``end_with_stdin``: stop when standard input ends.
    """

    names: tuple[str, ...] = ()
    everything: bool = False
    regex: str = ""
    exclude: str = ""
    images: str = "raw"
    fresh: bool = False
    end_with_stdin: bool = False

    def __call__(self, name: str) -> bool:
        """Whether a topic of this name is selected."""
        if name in self.names or name == NOTE.name:
            return True
        if name.startswith(_INTERNAL) or (self.exclude and re.search(self.exclude, name)):
            return False
        return self.everything or bool(self.regex and re.search(self.regex, name))


@dataclass
class _Source:
    """One subscription outside any executor."""

    name: str
    type: Any
    handle: Any
    transient: bool
    reliable: bool
    loss: Any = None
    """Handle of the middleware's message-lost event; None where it is not supported."""
    publishers: int = 0


@dataclass
class _Receiver:
    """Takes the messages of all sources in one thread."""

    context: Any
    deliver: Callable[[_Source, bytes, Mapping[str, int]], None]
    count_lost: Callable[[_Source, int], None]
    sources: list[_Source] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._changed = rclpy.guard_condition.GuardCondition(callback=None, callback_group=None, context=self.context)
        self._stop = threading.Event()
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="receiver", daemon=True)
        self._thread.start()

    def add(self, source: _Source) -> None:
        with self._lock:
            self.sources = [known for known in self.sources if known.name != source.name] + [source]
        self._changed.trigger()

    @property
    def broken(self) -> bool:
        """Whether receiving ended with an error."""
        return not self._thread.is_alive()

    def close(self) -> None:
        """Take what has arrived, then end."""
        self._stop.set()
        self._changed.trigger()
        self._thread.join()
        self._changed.destroy()

    def _run(self) -> None:
        current: list[_Source] = []
        wait_set: Any = None
        while not self._stop.is_set():
            if current is not self.sources or wait_set is None:
                current = self.sources
                events = sum(source.loss is not None for source in current)
                wait_set = _rclpy.WaitSet(len(current), 1, 0, 0, 0, events, self.context.handle)
            self._wait(wait_set, current)
            self._stop.wait(_BATCH_S)
        for source in self.sources:
            self._take_all(source)

    def _wait(self, wait_set: Any, sources: list[_Source]) -> None:
        wait_set.clear_entities()
        events = {}
        for source in sources:
            wait_set.add_subscription(source.handle)
            if source.loss is not None:
                events[source.name] = wait_set.add_event(source.loss)
        wait_set.add_guard_condition(self._changed.handle)
        wait_set.wait(500_000_000)
        ready = set(wait_set.get_ready_entities("subscription"))
        for source in sources:
            if source.handle.pointer in ready:
                self._take_all(source)
            if source.name in events and wait_set.is_ready("event", events[source.name]):
                self.count_lost(source, source.loss.take_event().total_count_change)

    def _take_all(self, source: _Source) -> None:
        while (taken := source.handle.take_message(source.type, True)) is not None:
            self.deliver(source, *taken)


class Recorder(Node):
    """Records the selected topics; see ``sandbot_record.tools.record`` for the options."""

    def __init__(self, selection: Selection, begin: Callable[[], Recording]) -> None:
        super().__init__("recorder")
        refuse_parameters(self)
        recording = begin()
        # In a namespace, record its topics without the namespace prefix, so that bags of all trackways look alike.
        self._space = self.get_namespace().rstrip("/")
        self._selection, self._recording = selection, recording
        self._trial, self._start_ns, self._host_clock = b"", time.time_ns(), HostClock()
        self._fresh_from_ns = sys.maxsize if selection.fresh else 0
        self.done = False
        self._ended = "the recording was ended before the trial" if selection.end_with_stdin else ""
        self._receiver = _Receiver(self.context, self._deliver, self._count_lost)
        self._by_name: dict[str, _Source] = {}
        self._left_out: set[str] = set()
        self._quiet_polls = 0
        self._announced = False
        self.create_service(Trigger, "recorder/start", self._on_start)
        self.create_service(Trigger, "recorder/stop", self._on_stop)
        self.create_service(SetBool, "recorder/pause", self._on_pause)
        self.create_service(SetBool, "recorder/pause_images", self._on_pause_images)
        self._health = Health(self, self._figures)
        for name in (*selection.names, NOTE.name):
            if name in _KNOWN:
                self._subscribe(name, _KNOWN[name].type, [])
        Timer(self, _POLL_S, self._poll)
        recording.on_stop = self._on_stopped
        if selection.end_with_stdin:
            threading.Thread(target=self._wait_for_stdin, name="stdin", daemon=True).start()

    def close(self) -> None:
        """Stop taking messages and close the bag."""
        if self._health.ended:
            self._health.publish()  # before the slow part: nobody may walk on unrecorded
        self._receiver.close()
        for source in self._by_name.values():
            if source.loss is not None:
                source.loss.destroy_when_not_in_use()
            source.handle.destroy_when_not_in_use()
        self._recording.close(_provenance(self._trial, self._recording.reason or self._ended))

    def _wait_for_stdin(self) -> None:
        # The pipe closes when the process at its other end exits, even if killed: no recorder outlives its campaign.
        said = [line.strip() for line in sys.stdin if line.strip()]
        self._ended = said[-1] if said else "whoever ran the trial is gone"
        self.done = True  # a regular end: what has arrived by now is still recorded

    def _deliver(self, source: _Source, data: bytes, info: Mapping[str, int]) -> None:
        received = info["received_timestamp"] or time.time_ns()
        published = info["source_timestamp"] or received
        # Stamps are of the publisher's clock, and ours may be set meanwhile: they are compared only until soon after
        # this trial's /trial, which comes from this host and only once we record. An older /trial, whenever it
        # comes, is that of a campaign that was suspended and has just been resumed.
        is_trial = source.name == topics.TRIAL.name
        fresh = received < self._fresh_from_ns or (is_trial and self._fresh_from_ns > 0)
        if source.transient and published < self._start_ns and fresh:
            return  # a latched message of an earlier trial
        message = Received(source.name, data, received, published, info["publication_sequence_number"] or 0)
        if is_trial:
            self._trial, self._fresh_from_ns = data, min(self._fresh_from_ns, received + _HISTORY_NS)
        # The graph may report a second publisher only after its first message; the matched count is up to date.
        sole = source.publishers == 1 and source.handle.get_publisher_count() == 1
        self._recording.put(message, sole_publisher=sole)

    def _count_lost(self, source: _Source, count: int) -> None:
        self._recording.lose(source.name, count)

    def _poll(self) -> None:
        if by_ns := self._host_clock.look():
            self._recording.clock_set(by_ns)
        self._poll_graph()

    def _poll_graph(self) -> None:
        if self._receiver.broken:
            self._recording.stop("receiving ended with an error")
        if self._recording.stopped.is_set():
            self._on_stopped()
            return
        new = False
        for full_name, types in self.get_topic_names_and_types():
            name = full_name.removeprefix(self._space)
            ours = full_name.startswith(f"{self._space}/")
            if ours and (self._selection(name) or name in self._by_name):
                new |= self._update_source(name, types)
        self._announce(new)

    def _on_stopped(self) -> None:
        # Published at once: closing a bag on a full disk takes seconds, and legs may be moving.
        self._health.publish()
        self.done = True

    def _update_source(self, name: str, types: Sequence[str]) -> bool:
        """Subscribe if necessary; returns whether anything changed or is not matched yet."""
        publishers = self.get_publishers_info_by_topic(self._space + name)
        if len(types) > 1:
            self._refuse(name, f"it has several types: {', '.join(types)}")
            return False
        source = self._by_name.get(name)
        if source is None or not _fits(source, publishers):
            if publishers:
                self._subscribe(name, types[0], publishers)
            return bool(publishers)
        source.publishers = len(publishers)
        return source.handle.get_publisher_count() < len(publishers)

    def _subscribe(self, name: str, type_name: str, publishers: Sequence[TopicEndpointInfo]) -> None:
        if name in self._left_out:
            return
        if type_name == frames.RAW and self._selection.images == "none":
            self._left_out.add(name)
            print(f"not recording {name}: raw images are left out (--images none)")
            return
        try:
            kind = messages.message_class(type_name)
        except (ImportError, AttributeError, ValueError):
            self._refuse(name, f"type {type_name} is not installed here")
            return
        if not interfaces.known(type_name):
            self._refuse(name, f"type {type_name} is not one of ROS 2 Jazzy's standard types")
            return
        known = _KNOWN.get(name)
        reliable = all(publisher.qos_profile.reliability == ReliabilityPolicy.RELIABLE for publisher in publishers)
        transient = all(
            publisher.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for publisher in publishers
        )
        if not publishers:
            transient = known is not None and known.latched
        profile = QoSProfile(
            history=HistoryPolicy.KEEP_LAST,
            depth=_DEPTH,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if transient else DurabilityPolicy.VOLATILE,
        )
        offered = tuple(_offered(publisher) for publisher in publishers) or (
            metadata.qos(latched=transient, depth=known.depth if known else 10, reliable=reliable),
        )
        self._recording.add_topic(name, type_name, qos=offered)
        check_for_type_support(kind)
        with self.handle:
            handle = _rclpy.Subscription(self.handle, kind, self._space + name, profile.get_c_qos_profile())
        source = _Source(name, kind, handle, transient, reliable, _loss_event(handle), len(publishers))
        self._by_name[name] = source
        self._receiver.add(source)

    def _refuse(self, name: str, why: str) -> None:
        if name not in self._left_out:
            self._left_out.add(name)
            self._recording.refuse(name, why)
            print(f"not recording {name}: {why}")

    def _announce(self, new: bool) -> None:
        self._quiet_polls = 0 if new else self._quiet_polls + 1
        wanted = set(self._selection.names) - self._left_out
        if self._announced or not wanted <= self._by_name.keys():
            return
        unheard = not wanted or any(not self._by_name[name].publishers for name in wanted)
        if self._quiet_polls < (_SETTLED_UNHEARD if unheard else _SETTLED):
            return
        self._announced = True
        print(f"recording to {self._recording.path} ({counted(len(self._by_name) - 1, 'topic')})")

    def _figures(self) -> Mapping[str, object]:
        recording = self._recording
        self._health.level, self._health.text = (2, recording.reason) if recording.failed else (0, "ok")
        if recording.lost and not recording.failed:
            self._health.level, self._health.text = 1, f"{counted(recording.lost, 'message')} lost"
        state = "stopped" if recording.stopped.is_set() else "paused" if recording.paused else "recording"
        if state != "recording" and not recording.failed:
            self._health.level, self._health.text = 1, f"{state}: nothing is recorded"
        counts = {"state": state, "written": recording.written, "lost": recording.lost}
        return recording.summary() | counts | {"bytes": recording.size_bytes, "free_bytes": recording.free_bytes}

    def _on_start(self, _: Any, response: Any) -> Any:
        self._pause(False)
        response.success, response.message = True, f"recording to {self._recording.path}"
        return response

    def _on_stop(self, _: Any, response: Any) -> Any:
        self._recording.stopped.set()
        self._on_stopped()
        response.success, response.message = True, "closing the bag"
        return response

    def _on_pause(self, request: Any, response: Any) -> Any:
        self._pause(request.data)
        response.success, response.message = True, "paused" if request.data else "recording"
        return response

    def _pause(self, paused: bool) -> None:
        self._recording.pause(paused, time.time_ns())
        self._health.publish()  # at once: legs may be moving unrecorded

    def _on_pause_images(self, request: Any, response: Any) -> Any:
        self._recording.images_paused = request.data
        response.success, response.message = True, "images paused" if request.data else "recording images"
        return response


def _loss_event(subscription: Any) -> Any:
    try:
        return _rclpy.EventHandle(subscription, _rclpy.rcl_subscription_event_type_t.RCL_SUBSCRIPTION_MESSAGE_LOST)
    except _rclpy.UnsupportedEventTypeError:  # not every middleware has this event
        return None


def _provenance(trial: bytes, ended: str) -> dict[str, dict[str, str]]:
    """The metadata record ``trial`` from the last message on /trial; if there was none or it is no JSON object, only
    how the trial ended, without which a failed one would pass for a finished one.
    """
    status = {"exit_status": ended} if ended else {}
    try:
        text = interfaces.decode(trial, topics.TRIAL.type).data
        plan = parse_json(text, topics.TRIAL.name)
    except InputError:
        plan = None
    if not isinstance(plan, dict):
        return {"trial": status} if status else {}
    said = {"id": "trial_id", "plan": "campaign", **{key: key for key in ("software_version", "commit", "start")}}
    values = {key: str(plan.get(name, "")) for key, name in said.items()}
    return {"trial": {**values, "parameters": text, "clock": "live", "recorder": LIBRARY, **status}}


def _fits(source: _Source, publishers: Sequence[TopicEndpointInfo]) -> bool:
    """Whether a subscription is compatible with all of a topic's publishers."""
    for publisher in publishers:
        if source.reliable and publisher.qos_profile.reliability != ReliabilityPolicy.RELIABLE:
            return False
        if source.transient and publisher.qos_profile.durability != DurabilityPolicy.TRANSIENT_LOCAL:
            return False
    return True


def _offered(publisher: TopicEndpointInfo) -> Qos:
    profile = publisher.qos_profile
    return metadata.qos(
        latched=profile.durability == DurabilityPolicy.TRANSIENT_LOCAL,
        depth=profile.depth,
        reliable=profile.reliability == ReliabilityPolicy.RELIABLE,
    )


def record(selection: Selection, begin: Callable[[], Recording], arguments: Sequence[str] = ()) -> tuple[int, str]:
    """Record until SIGINT, SIGTERM, /recorder/stop, a limit or a failure. Returns the exit code, 1 if something wanted
    is missing, and the last line to print. ``begin`` opens the bag, after ROS has parsed its arguments.
    """
    begun: list[Recording] = []

    def keep() -> Recording:
        begun.append(begin())
        return begun[0]

    try:
        code = run(lambda: Recorder(selection, keep), arguments)
    finally:
        for recording in begun:
            recording.close()
    if not begun:
        return code, ""
    return code or (1 if begun[0].failed or begun[0].refused else 0), begun[0].last_line()
