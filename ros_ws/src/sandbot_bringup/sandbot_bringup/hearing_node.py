"""What a campaign hears of its trackway: the state of bed and legs, each node's health, and who has fallen silent."""

import math
import time
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from sandbot_bringup.supervision import BEATS, LOOP, Listening, Sign, Supervisor
from sandbot_common import messages, topics
from sandbot_common.neighbours import Neighbours
from sandbot_common.node import PROCESS, subscription

QUIET_S = 3.0
"""A tracker that says nothing for so long has no more frames."""
DRIVERS = ("serial_bed", "serial_legs", "serial_dorsal", "serial_lateral", "dorsal_camera", "lateral_camera")
"""Each says on /diagnostics where its cable is out. Required once heard: those of other makers need not tell health."""
RECORDER = "recorder"

_ROBOT, _ROBOTS = "robot", ("lab", "serial_legs")
"""Whoever reports the legs, and which of our nodes do."""
# Its first frame may take seconds where nothing is compiled yet; a dead one is missed sooner, as its node is silent.
TRACKER_SPEED = Sign("tracker", topics.SPEED.name, 5.0)
STEADY_S = 0.5
"""What comes all the time while legs walk may stay away for so long, or for half of --silence where that is longer."""


class Told(NamedTuple):
    """What a node said of its health."""

    level: int = 0
    text: str = ""
    values: Mapping[str, str] = {}


class Hearing:
    """Subscribes for a node and keeps the latest of everything; ``listen`` is to be called at each turn of its loop."""

    def __init__(self, node: Node, silence_s: float, turn_s: float) -> None:
        """``turn_s``: how long a turn waits at most; what passes beyond twice that is our own delay."""
        self.told: dict[str, Told] = {}
        self.phi: float | None = None
        self.bed_stage = self.bed_text = self.bed_preparation = ""
        self.bed_height_m = math.nan
        self.heights = 0
        self.moving = False
        self.leg_time_ns: int | None = None
        self.motion_start_ns: int | None = None
        self.speed_ns = 0
        self._silence_s = silence_s
        self._supervisor, self._listening = Supervisor(), Listening(2 * turn_s)
        self._neighbours = Neighbours()
        self._bed = Sign("bed", topics.BED_STATUS.name, silence_s)
        self._vital = [self._bed]
        self._turned_ns: dict[str, int] = {}
        self._recorder_pid = 0
        subscription(node, topics.BED_PHI, self._on_phi)
        subscription(node, topics.BED_HEIGHT, self._on_height, raw=True, best_effort=True)
        subscription(node, topics.LEG_STATES, self._on_legs)
        # What is told anew all the time: a reliable reader would hear nothing until what was lost has been sent again.
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
        """The loop is about to listen: time goes on, and the system is asked who lives."""
        now_s = time.monotonic()
        self._listening.look(now_s)
        for who, starved_s in self._neighbours.look(now_s).items():
            for name in (who, _ROBOT) if who in _ROBOTS else (who,):
                self._supervisor.starved(name, starved_s)

    def forget_trial(self) -> None:
        """What was heard of the trial before is not of the next one."""
        self.phi, self.bed_stage, self.motion_start_ns = None, "", None

    def require(self, names: Sequence[str]) -> None:
        """These nodes, and the bed's status, are vital to what comes."""
        self._vital = [Sign(name, LOOP, self._silence_s) for name in names] + [self._bed]

    def expect_recorder(self, pid: int) -> None:
        """A recorder has been started: what the one before it said is forgotten, and what others say is not meant."""
        self._recorder_pid = pid
        self._neighbours.forget(RECORDER)
        self.told.pop(RECORDER, None)
        self.watch()

    @property
    def recorded(self) -> int:
        """Messages that the recorder says it has written."""
        return int(self.told.get(RECORDER, Told()).values.get("written", "0"))

    def require_recorder(self) -> None:
        """It has been heard, and is vital from now on."""
        self._vital.append(Sign(RECORDER, LOOP, self._silence_s))
        self.watch()

    def watch(self, *more: Sign) -> None:
        """From now on nobody vital may fall silent, nor ``more``."""
        beats = (
            Sign(sign.who, topics.HEARTBEAT.name, self._silence_s / BEATS)
            for sign in self._vital
            if sign.who != RECORDER and sign.who not in self._neighbours
        )
        # Those of other makers need not beat; the recorder is our own child, of which the system tells.
        beating = [beat for beat in beats if math.isfinite(self._age_s(beat))]
        self._supervisor.watch(*more, *self._vital, *beating, now_s=self.now_s)

    def watch_walking(self) -> None:
        """The same while legs walk: nor may set-points, the robot's reports or the tracker's speeds stay away."""
        steady_s = max(STEADY_S, self._silence_s / 2)
        steady = (("clock", topics.LEG_SETPOINTS), (_ROBOT, topics.LEG_STATES))
        self.watch(*(Sign(who, topic.name, steady_s) for who, topic in steady), TRACKER_SPEED)

    @property
    def tells_motion(self) -> bool:
        """Whether the robot says at present that its legs move; one that has died in the middle of a walk does not."""
        return self.moving and self._supervisor.age_s(_ROBOT, topics.LEG_STATES.name, self.now_s) <= STEADY_S

    def watch_nobody(self) -> None:
        """Nothing is under way that anybody could spoil."""
        self._supervisor.watch(now_s=0.0)

    def heard_since(self, who: str, since_s: float, topic: str = "") -> bool:
        """Whether somebody gave a sign after a time of ``now_s``."""
        return self._supervisor.heard_since(who, topic, since_s)

    def is_quiet(self, sign: Sign) -> bool:
        """Whether it has not come for a while."""
        return self._age_s(sign) > QUIET_S

    def missing(self) -> list[str]:
        """Phrases of who of the vital is not there, or without a device."""
        gone = [f"{sign.who} {fault}" for sign in self._vital if (fault := self._neighbours.faults.get(sign.who))]
        return gone + [sign.missing for sign in self._vital if self._age_s(sign) > sign.limit_s] + self._unplugged()

    def fault(self) -> str:
        """Who of the vital fails while they are watched, in a phrase; an empty string if nobody does."""
        for sign in self._vital:
            # Who ends in order says so, and of who does not the system tells; nobody waits for his silence.
            if (text := self.told.get(sign.who, Told()).text).startswith("ended: "):
                return f"the {sign.who} {text}"
            if sign.who != RECORDER and (fault := self._neighbours.faults.get(sign.who)):
                return f"the {sign.who} {fault}"
        if unplugged := self._unplugged():
            return f"the {unplugged[0]}"
        # A clock that has stopped is silent by right, and has said why: the robot's reports may lag behind it.
        silent = self._supervisor.silent(self.now_s)
        return silent and (self.clock_fault or self._listening.held_up or f"the {silent}")

    @property
    def clock_fault(self) -> str:
        """Why the clock stopped of itself; an empty string if it did not."""
        clock = self.told.get("clock", Told())
        return f"the clock: {clock.text}" if clock.level > 1 else ""

    def _age_s(self, sign: Sign) -> float:
        return self._supervisor.age_s(sign.who, sign.topic, self.now_s)

    def _unplugged(self) -> list[str]:
        """Drivers that are there, but not their devices."""
        said = ((who, self.told[who]) for who in DRIVERS if who in self.told)
        return [f"{who} has lost its device: {one.text}" for who, one in said if one.level > 1]

    def _heard(self, who: str, topic: topics.Topic) -> None:
        self._supervisor.heard(who, topic.name, self.now_s)

    def _is_our_recorder(self, process: str) -> bool:
        """Anybody may record beside us. Without /proc nobody tells his process: whoever speaks is taken for ours."""
        return not process or process.split()[1:2] == [str(self._recorder_pid)]

    def _on_phi(self, message: Any) -> None:
        # The latched value of the trial before arrives on subscription only; forget_trial clears it.
        self.phi = float(message.data)

    def _on_bed(self, message: Any) -> None:
        self._heard("bed", topics.BED_STATUS)
        for status in message.status:
            values = messages.values_of(status)
            self.bed_stage, self.bed_text = values.get("stage", self.bed_stage), status.message
            self.bed_preparation = values.get("preparation", "")
            self.bed_height_m = float(values.get("height_m", math.nan))

    def _on_height(self, _: bytes) -> None:
        self.heights += 1

    def _on_legs(self, message: Any) -> None:
        self._heard(_ROBOT, topics.LEG_STATES)
        self.leg_time_ns = messages.nanoseconds(message.header.stamp)
        self.moving = any(rate != 0.0 for rate in message.velocity)
        if self.motion_start_ns is None and self.moving:
            self.motion_start_ns = self.leg_time_ns

    def _on_setpoint(self, _: bytes) -> None:
        self._heard("clock", topics.LEG_SETPOINTS)

    def _on_speed(self, message: Any) -> None:
        self._heard("tracker", topics.SPEED)
        self.speed_ns = messages.nanoseconds(message.header.stamp)

    def _on_heartbeat(self, message: Any) -> None:
        self._heard(message.frame_id, topics.HEARTBEAT)
        # Another one, not a later one: its clock may have been set back.
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
            self.told[status.name] = Told(status.level[0], status.message, values)
