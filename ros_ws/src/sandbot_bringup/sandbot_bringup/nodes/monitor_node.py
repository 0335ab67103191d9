"""What a campaign knows of its trackway: the state of bed and legs, each node's health, and who has fallen silent."""

import math
import time
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from sandbot_bringup.supervision import (
    BEATS,
    FRAMES,
    LOOP,
    Listening,
    Sign,
    Supervisor,
    camera_silence_s,
    frames_came,
)
from sandbot_common import messages, topics
from sandbot_common.health import LEGS_STOPPED, PROCESS, has_ended
from sandbot_common.legs import at_rest
from sandbot_common.neighbours import Neighbours
from sandbot_common.ros.command_node import Rivals
from sandbot_common.ros.endpoints import names_of, subscription
from sandbot_common.typed import number_or_nan

QUIET_S = 3.0
"""A tracker that is silent for this long has no more frames."""
DRIVERS = ("serial_bed", "serial_legs", "serial_dorsal", "serial_lateral", "dorsal_camera", "lateral_camera")
"""Each reports on /diagnostics if its cable is out. Required once heard, as third-party ones need not report health."""
RECORDER = "recorder"

_ROBOT = "robot"
"""The source of leg reports."""
_OUR_ROBOTS = ("lab", "serial_legs")
_CAMERAS = {view: f"{view} camera" for view in topics.VIEWS}
_STARVED_WITH = {"lab": (_ROBOT,), "serial_legs": (_ROBOT,), "tracker": tuple(_CAMERAS.values())}
"""Who can't be heard while one of our nodes has no CPU: the robot whose legs it reports, the cameras it follows."""
# Its first frame may take seconds if nothing is compiled yet; a dead tracker is noticed sooner, as its node is silent.
TRACKER_SPEED = Sign("tracker", topics.SPEED.name, 5.0)
STEADY_S = 0.5
"""The longest gap in topics that are continuous while legs walk, or half of --silence if that is longer."""


class NodeStatus(NamedTuple):
    """A node's health, as it last reported it."""

    level: int = 0
    text: str = ""
    values: Mapping[str, str] = {}


class Monitor:
    """Subscribes for a node and keeps the latest of everything; call ``listen`` at each turn of its loop."""

    def __init__(self, node: Node, silence_s: float, turn_s: float) -> None:
        """``turn_s``: the longest that a turn waits; time beyond twice that is our own delay."""
        self.statuses: dict[str, NodeStatus] = {}
        self.bed_stage = self.bed_text = self.bed_preparation = ""
        self.bed_height_m = math.nan
        self.heights = 0
        self.moving = False
        self.leg_time_ns: int | None = None
        self.motion_start_ns: int | None = None
        self.speed_ns = 0
        self.may_move = False
        """Whether the campaign has asked for motion in this trial."""
        self.prepared: tuple[str, str] | None = None
        """Stage and preparation with which the bed was left to the walk; None before."""
        self._silence_s = silence_s
        self._count_beds = partial(node.count_publishers, topics.BED_STATUS.relative)
        self._supervisor, self._listening = Supervisor(), Listening(2 * turn_s)
        self._neighbours = Neighbours()
        self.rivals = Rivals(node, *topics.MEASURED)
        """Two nodes that publish what a row is computed from: the row could be that of another trial."""
        self._bed = Sign("bed", topics.BED_STATUS.name, silence_s)
        self._vital = [self._bed]
        self._turned_ns: dict[str, int] = {}
        self._walking, self._begun_s = False, -math.inf
        self._publishers_of = node.get_publishers_info_by_topic
        self._rendered: set[str] = set()
        """Views of the virtual lab, which renders frames when it has time; if it dies, so does the robot."""
        self._recorder_pid = 0
        # Continuous data: a reliable reader would receive nothing until a lost message has been resent, and nothing at
        # all from a driver that sends best effort.
        subscription(node, topics.BED_HEIGHT, self._on_height, raw=True, best_effort=True)
        subscription(node, topics.LEG_STATES, self._on_legs, best_effort=True)
        subscription(node, topics.BED_STATUS, self._on_bed, best_effort=True)
        subscription(node, topics.LEG_SETPOINTS, self._on_setpoint, raw=True, best_effort=True)
        subscription(node, topics.SPEED, self._on_speed)
        subscription(node, topics.DIAGNOSTICS, self._on_diagnostics)
        subscription(node, topics.HEARTBEAT, self._on_heartbeat, best_effort=True)

    @property
    def now_s(self) -> float:
        """Time spent listening."""
        return self._listening.now_s

    def listen(self) -> None:
        """Call before the loop waits for messages: advances the time and queries the system which processes live."""
        now_s = time.monotonic()
        self._listening.look(now_s)
        for who, starved_s in self._neighbours.look(now_s).items():
            for name in (who, *_STARVED_WITH.get(who, ())):
                self._supervisor.starved(name, starved_s)

    def forget_trial(self) -> None:
        """Discard the state of the last trial."""
        self.bed_stage, self.motion_start_ns = "", None
        self.may_move, self.prepared = False, None

    def require(self, names: Sequence[str]) -> None:
        """From now on these nodes, and the bed's status, are vital; a trial is about to begin."""
        self._begun_s = self.now_s
        self._rendered = {
            name for name, view in topics.VIEWS.items() if "lab" in names_of(self._publishers_of(view.image.relative))
        }
        self._vital = [Sign(name, LOOP, self._silence_s) for name in names] + [self._bed]

    def expect_recorder(self, pid: int) -> None:
        """A recorder has been started: forget the last one's reports, and ignore those of other recorders."""
        self._recorder_pid = pid
        self._neighbours.forget(RECORDER)
        self.statuses.pop(RECORDER, None)
        self.watch()

    @property
    def recorded(self) -> float:
        """Number of messages written, as the recorder reports; NaN if it does not."""
        return number_or_nan(self.statuses.get(RECORDER, NodeStatus()).values.get("written"))

    def require_recorder(self) -> None:
        """The recorder has been heard, and is vital from now on."""
        self._vital.append(Sign(RECORDER, LOOP, self._silence_s))
        self.watch()

    def watch(self, *more: Sign) -> None:
        """From now on no vital node may fall silent, nor any of ``more``."""
        self._walking = False
        beats = (
            Sign(sign.who, topics.HEARTBEAT.name, self._silence_s / BEATS)
            for sign in self._vital
            if sign.who != RECORDER and sign.who not in self._neighbours
        )
        # Third-party nodes need not send heartbeats; the recorder is our child, whose end the system reports.
        beating = [beat for beat in beats if math.isfinite(self._age_s(beat))]
        self._supervisor.watch(*more, *self._vital, *beating, now_s=self.now_s)

    def watch_walking(self) -> None:
        """The same while legs walk: set-points, the robot's reports, speeds and frames must also keep coming."""
        steady_s = max(STEADY_S, self._silence_s / 2)
        steady = (("clock", topics.LEG_SETPOINTS), (_ROBOT, topics.LEG_STATES))
        self.watch(*(Sign(who, topic.name, steady_s) for who, topic in steady), TRACKER_SPEED, *self._filming())
        self._walking = True

    def _filming(self) -> list[Sign]:
        """The cameras that have sent a frame since the trial began, whoever drives them, as the tracker counts."""
        counted = self.statuses.get("tracker", NodeStatus()).values
        return [
            Sign(who, FRAMES, camera_silence_s(view, counted, self._silence_s))
            for view, who in _CAMERAS.items()
            if view not in self._rendered and self.heard_since(who, self._begun_s)
        ]

    @property
    def reports_legs(self) -> bool:
        """Whether the robot currently reports its legs; one at rest may be silent."""
        return self._supervisor.age_s(_ROBOT, topics.LEG_STATES.name, self.now_s) <= STEADY_S

    @property
    def reports_motion(self) -> bool:
        """Whether the robot currently reports that its legs move; false if it has died in the middle of a walk."""
        return self.moving and self.reports_legs

    def stop_watching(self) -> None:
        """Nothing is under way: anybody may fall silent."""
        self._supervisor.watch(now_s=0.0)

    def heard_since(self, who: str, since_s: float, topic: str = "") -> bool:
        """Whether somebody gave a sign after ``since_s``, a time of ``now_s``."""
        return self._supervisor.heard_since(who, topic, since_s)

    def is_quiet(self, sign: Sign) -> bool:
        """Whether the sign has been absent for a while."""
        return self._age_s(sign) > QUIET_S

    def missing(self) -> list[str]:
        """Phrases that name each vital node that is absent, or has lost its device."""
        gone = [f"{sign.who} {fault}" for sign in self._vital if (fault := self._neighbours.faults.get(sign.who))]
        return gone + [sign.missing for sign in self._vital if self._age_s(sign) > sign.limit_s] + self.unplugged()

    def fault(self) -> str:
        """A phrase that names a watched vital node that fails; an empty string if there is none."""
        for sign in self._vital:
            # An orderly end is announced, and any other reported by the system, so neither needs to time out.
            if has_ended(text := self.statuses.get(sign.who, NodeStatus()).text):
                return f"the {sign.who} {text}"
            if sign.who != RECORDER and (fault := self._neighbours.faults.get(sign.who)):
                return f"the {sign.who} {fault}"
        if unplugged := self.unplugged():
            return f"the {unplugged[0]}"
        if rivals := self.rivals.fault():
            return rivals
        if unasked := self._unasked:
            return unasked
        # A stopped clock is rightly silent, and has said why; the robot's reports may lag behind it.
        silent = self._supervisor.silent(self.now_s)
        return silent and (self.clock_fault or self._listening.held_up or f"the {silent}")

    @property
    def _unasked(self) -> str:
        """What somebody else has legs or bed do; an empty string if nothing."""
        if self.reports_motion and not self.may_move:
            return f"legs move that the campaign did not start ({topics.LEG_STATES.name})"
        if self.prepared not in (None, (self.bed_stage, self.bed_preparation)):
            return f"the bed is in {self.bed_stage}, which the campaign did not ask for ({topics.BED_STATUS.name})"
        return ""

    @property
    def clock_fault(self) -> str:
        """Why the clock stopped by itself; an empty string if it did not."""
        clock = self.statuses.get("clock", NodeStatus())
        return f"the clock: {clock.text}" if clock.level > 1 else ""

    @property
    def robot_warns(self) -> str:
        """What a third-party robot's driver warns of, if its health is under its node's name; else empty."""
        drivers = {*names_of(self._publishers_of(topics.LEG_STATES.relative))} - {*_OUR_ROBOTS}
        warnings = (f"{who}: {one.text}" for who, one in self.statuses.items() if one.level and _node(who) in drivers)
        return next(warnings, "")

    @property
    def robot_lapsed(self) -> str:
        """Why our own driver brought the legs to rest, as after a lost command; empty if it did not."""
        ours = ((who, self.statuses[who].text) for who in _OUR_ROBOTS if who in self.statuses)
        return next((f"the {who}: {text}" for who, text in ours if text.startswith(LEGS_STOPPED)), "")

    def _age_s(self, sign: Sign) -> float:
        return self._supervisor.age_s(sign.who, sign.topic, self.now_s)

    def unplugged(self) -> list[str]:
        """Phrases that name the drivers that have lost their device, and the camera whose frames can't be used."""
        drivers = ((who, self.statuses[who]) for who in DRIVERS if who in self.statuses)
        lost = [f"{who} has lost its device: {status.text}" for who, status in drivers if status.level > 1]
        tracker = self.statuses.get("tracker", NodeStatus())
        blind = tracker.level > 1 and not has_ended(tracker.text)
        return [*lost, *([f"tracker is blind: {tracker.text}"] if blind else [])]

    def _heard(self, who: str, topic: topics.Topic) -> None:
        self._supervisor.heard(who, topic.name, self.now_s)

    def _is_our_recorder(self, process: str) -> bool:
        """Whether it is our recorder and not another one. Without /proc processes are unknown: any counts as ours."""
        return not process or process.split()[1:2] == [str(self._recorder_pid)]

    def _on_bed(self, message: Any) -> None:
        self._heard("bed", topics.BED_STATUS)
        for status in message.status:
            values = messages.values_of(status)
            if values.get("preparation") == "0" and self._count_beds() > 1:
                continue  # of a second bed, of a second launch, which has prepared nothing and is about to be refused
            self.bed_stage, self.bed_text = values.get("stage", self.bed_stage), status.message
            self.bed_preparation = values.get("preparation", "")
            self.bed_height_m = number_or_nan(values.get("height_m"))

    def _on_height(self, _: bytes) -> None:
        self.heights += 1

    def _on_legs(self, message: Any) -> None:
        self._heard(_ROBOT, topics.LEG_STATES)
        self.leg_time_ns = messages.nanoseconds(message.header.stamp)
        self.moving = not at_rest(message.velocity)
        if self.motion_start_ns is None and self.moving:
            self.motion_start_ns = self.leg_time_ns

    def _on_setpoint(self, _: bytes) -> None:
        self._heard("clock", topics.LEG_SETPOINTS)

    def _on_speed(self, message: Any) -> None:
        self._heard("tracker", topics.SPEED)
        self.speed_ns = messages.nanoseconds(message.header.stamp)

    def _on_heartbeat(self, message: Any) -> None:
        self._heard(message.frame_id, topics.HEARTBEAT)
        # Different, not later: the node's clock may have been set back.
        if (turned_ns := messages.nanoseconds(message.stamp)) != self._turned_ns.get(message.frame_id, 0):
            self._turned_ns[message.frame_id] = turned_ns
            self._supervisor.heard(message.frame_id, LOOP, self.now_s)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = messages.values_of(status)
            if status.name == RECORDER and not self._is_our_recorder(values.get(PROCESS, "")):
                continue
            if not self._neighbours.meet(status.name, values.get(PROCESS, "")):
                continue
            self._heard(status.name, topics.DIAGNOSTICS)
            self._supervisor.heard(status.name, LOOP, self.now_s)
            if status.name == "tracker":
                self._on_frames(values)
            self.statuses[status.name] = NodeStatus(status.level[0], status.message, values)

    def _on_frames(self, counted: Mapping[str, str]) -> None:
        """The tracker has counted the cameras' frames."""
        before = self.statuses.get("tracker", NodeStatus()).values
        for view in frames_came(before, counted):
            self._supervisor.heard(_CAMERAS[view], FRAMES, self.now_s)
        if self._walking:
            self.watch_walking()  # a camera may have begun


def _node(status: str) -> str:
    """The node of a status; many drivers add what it is about, e.g. "rig: motors"."""
    return status.partition(":")[0]
