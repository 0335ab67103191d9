"""Run a campaign live over the real nodes: prepare the bed, record, start the clock, stop, next trial.

While a trial's air or legs may move, this node renews /operator/lease: should it end, freeze or be killed, bed and
clock stop by themselves. It watches everybody a trial needs; who falls silent ends the trial at once.
"""

import math
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import SetParameters
from rclpy.client import Client
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from std_srvs.srv import SetBool, Trigger

from sandbot_bringup.desk_node import Desk
from sandbot_bringup.folder import CampaignFolder, frames_kept
from sandbot_bringup.hold import Held, Hold
from sandbot_bringup.plan import Plan, PlannedTrial
from sandbot_bringup.provenance import trial_message
from sandbot_bringup.recorder_process import RecorderProcess
from sandbot_bringup.supervision import LOOP, Listening, Sign, Supervisor, camera_fault, pace_fault, status_values
from sandbot_common import messages, topics
from sandbot_common.errors import InputError
from sandbot_common.neighbours import Neighbours
from sandbot_common.node import PROCESS, Health, Stop, ask, names_of, publisher, real_time, subscription
from sandbot_common.robot import Robot
from sandbot_record.bags.reader import Bag
from sandbot_record.bags.writer import add_metadata
from sandbot_record.trials.from_bags import row_from_bag
from sandbot_record.trials.table import OK, Row

DISCOVERY_S = 20.0
"""Nodes that just started need this long at most to be seen on a busy machine."""

CALL_S = 10.0
BED_S = 600.0
DRAIN_S = 20.0
QUIET_S, LAST_FRAME_NS = 3.0, 30_000_000
"""A tracker that says nothing for so long has no more frames; the last one may be so long before the legs' rest."""
CLOSE_S = 30.0
PRIORITY = 5
"""Real-time priority while it commands, below the clock's, and of the threads that hear for it."""
RENEW_S = 0.02
"""The lease is renewed that often: a dozen times before the clock takes it for lost."""
EXPLAIN_S = 0.7
"""So long after legs came to rest unasked, whoever stopped them is listened for."""
FREE_BYTES = 300 << 20
"""Room there must be before a trial; the recorder itself stops at 200 MiB."""

PACE_S = 0.5
"""How long rates are measured before a trial."""
SAFE_S = 3.0
"""So long legs that still report motion are waited for, before the recorder is ended."""
SILENCE_S, SILENCE_BOUNDS_S, BEATS = 1.0, (0.3, 10.0), 4
"""A node whose loop shows no sign for so long while a trial runs is stuck. Whether its process lives the system tells
where it runs on this host; elsewhere it beats 20 times a second, and a quarter of this without a beat, it is dead."""
_REQUIRED = ("clock", "bed", "tracker")
_DRIVERS = ("serial_bed", "serial_legs", "serial_dorsal", "serial_lateral")
"""Of sandbot_hardware: each says on /diagnostics where its cable is out."""
_HEARD = ("dorsal_camera", "lateral_camera", *_DRIVERS)
"""Required once they have been heard: a robot or camera of another maker need not tell its health."""

PAUSE_IMAGES = "/recorder/pause_images"
_UNNAMED = "_NODE_NAME_UNKNOWN_"
_START_THEM = "start the nodes with: ros2 launch sandbot_bringup trackway.launch.py"

_ROBOT, _ROBOTS = "robot", ("lab", "serial_legs")
"""Whoever reports the legs, and which of our nodes do."""
_BED = Sign("bed", topics.BED_STATUS.name, 1.0)
# Its first frame may take seconds where nothing is compiled yet; a dead one is missed sooner, as its node is silent.
_TRACKER = Sign("tracker", topics.SPEED.name, 5.0)
_WALKING = (
    Sign("clock", topics.LEG_SETPOINTS.name, 0.5),
    Sign(_ROBOT, topics.LEG_STATES.name, 0.5),
    _TRACKER,
)


def mark(bag: Path, exit_status: str) -> None:
    """Write into a closed bag how its trial ended, where only its judge could know."""
    with suppress(InputError, OSError):  # a full disk: trials.csv says it all the same
        add_metadata(bag, "trial", {**Bag.open(bag).provenance.get("trial", {}), "exit_status": exit_status})


class TrialFailed(RuntimeError):
    """A trial could not be completed; the campaign goes on with the next one."""


class CampaignEnds(InputError):
    """Nothing more can be run, or somebody stopped it by hand; what was finished is kept."""


class Operator(Node):
    """Does what a person at the trackway does, through the same services and parameters."""

    desk: Desk
    """Set once there is a folder to keep what is asked for."""

    def __init__(self, plan: Plan, robot: Robot, stop: Stop, silence_s: float = SILENCE_S) -> None:
        super().__init__("campaign")
        self._plan, self._robot, self._stop, self._silence_s = plan, robot, stop, silence_s
        self.hold = Hold()
        self._executor = EventsExecutor()
        self._executor.add_node(self)
        self._trial = publisher(self, topics.TRIAL)
        self._lease: Publisher | None = None
        self._commanding, self._renewed_s = False, -math.inf
        self._supervisor = Supervisor()
        self._vital = [_BED]
        # Each look waits for RENEW_S at most: what passes beyond twice that is our own delay.
        self._listening = Listening(2 * RENEW_S)
        self._told: dict[str, tuple[int, str, Mapping[str, str]]] = {}
        self._neighbours = Neighbours()
        self._turned_ns: dict[str, int] = {}
        self._phi: float | None = None
        self._bed_stage = self._bed_text = ""
        self._bed_height_m = math.nan
        self._heights = 0
        self._leg_time_ns: int | None = None
        self._motion_start_ns: int | None = None
        self._speed_ns = 0
        self._moving = False
        self._running = ""
        subscription(self, topics.BED_PHI, self._on_phi)
        subscription(self, topics.BED_STATUS, self._on_bed)
        subscription(self, topics.BED_HEIGHT, self._on_height, raw=True, best_effort=True)
        subscription(self, topics.LEG_STATES, self._on_legs)
        # Only whether it comes is asked: a reliable reader would hear nothing until what was lost has been sent again.
        subscription(self, topics.LEG_SETPOINTS, self._on_setpoint, raw=True, best_effort=True)
        subscription(self, topics.SPEED, self._on_speed)
        subscription(self, topics.DIAGNOSTICS, self._on_diagnostics)
        subscription(self, topics.HEARTBEAT, self._on_heartbeat, best_effort=True)
        self._health = Health(self, lambda: {"trial": self._running}, sole=True)
        self._triggers = {
            name: self.create_client(Trigger, topics.relative(name))
            for name in ("/clock/home", "/clock/start", "/clock/stop", "/bed/prepare", "/bed/abort", "/lab/reset")
        }
        self._pause_images = self.create_client(SetBool, topics.relative(PAUSE_IMAGES))
        self._setters = {
            node: self.create_client(SetParameters, f"{node}/set_parameters") for node in ("clock", "bed", "lab")
        }
        self._has_lab = False
        self._recorder: RecorderProcess | None = None

    def find_nodes(self) -> None:
        """Wait for all that a trial needs; InputError naming what is missing."""
        for name in ("/clock/start", "/bed/prepare"):
            if not self._wait(self._triggers[name].service_is_ready, DISCOVERY_S):
                raise InputError(f"no node offers {name}; {_START_THEM}")
        for topic in (topics.LEG_STATES, topics.COM):
            if not self._wait(partial(self._is_published, topic), DISCOVERY_S):
                raise InputError(f"no node publishes {topic.name}; {_START_THEM}")
        # Seeing its service is not enough: a preparation fails at once while the bed has not heard its height sensor.
        if not self._wait(lambda: math.isfinite(self._bed_height_m), DISCOVERY_S):
            raise InputError(f"the bed node has no reading on {topics.BED_HEIGHT.name}; {_START_THEM}")
        # Whoever reports the legs is the robot: the virtual lab takes a seed and a reset, a real one is carried back.
        # A publisher can be seen before the name of its node is: guessing then would leave the seed unset.
        if not self._wait(lambda: _UNNAMED not in self._who_publishes(topics.LEG_STATES), DISCOVERY_S):
            raise InputError(f"the node that publishes {topics.LEG_STATES.name} does not tell its name; {_START_THEM}")
        self._has_lab = "lab" in self._who_publishes(topics.LEG_STATES)
        if self._has_lab and not self._wait(self._triggers["/lab/reset"].service_is_ready, DISCOVERY_S):
            raise InputError(f"the virtual lab does not offer /lab/reset; {_START_THEM}")
        if not self._wait(lambda: set(self._required) <= self._told.keys(), DISCOVERY_S):
            missing = next(name for name in self._required if name not in self._told)
            raise InputError(f"the {missing} does not tell its health on {topics.DIAGNOSTICS.name}; {_START_THEM}")
        # By now another campaign would have been heard. From here on clock and bed obey nobody but this one.
        self._lease = publisher(self, topics.OPERATOR_LEASE)

    def await_go(self) -> None:
        """While the campaign is held, wait for the operator: without a limit, for nothing moves and nothing blows."""
        self.hold.between_trials()
        if not self.hold.why:
            return
        self.desk.enter("")
        self._spin_until(lambda: not self.hold.why or self._ending, math.inf)
        self._end_if_asked()

    def wait_for(self, condition: Callable[[], bool]) -> None:
        """Go on hearing everybody until something that is done elsewhere is over; nothing moves meanwhile."""
        self._spin_until(lambda: condition() or self._ending, math.inf)
        self._end_if_asked()

    def run(self, trial: PlannedTrial, folder: CampaignFolder, attachments: Sequence[Path]) -> Row:
        """One trial from bed preparation to the closed bag, and its row of the table.

        TrialFailed with the reason otherwise, Held where a person stopped it.
        """
        # Recorded aside and renamed when complete and judged: a bag in trials/ is always a whole trial.
        aside = folder.aside(trial.trial_id)
        self._gate(folder)
        self._running = trial.trial_id
        self._set_up(trial)
        # Judging the bag takes a second of CPU and is nobody's lease.
        with real_time(PRIORITY):
            recorder = self._run(trial, aside, attachments)
        if recorder.code != 0:
            raise TrialFailed(f"the recorder ended with exit code {recorder.code}; its bag is {aside}")
        # The same judge as that of the table: what it would not call ok is no finished trial.
        if (row := row_from_bag(aside)).status != OK:
            mark(aside, row.status)
            raise TrialFailed(f"{row.status}; its bag is kept in {aside}")
        aside.rename(folder.bag(trial))
        return row

    def _run(self, trial: PlannedTrial, aside: Path, attachments: Sequence[Path]) -> RecorderProcess:
        """From the recorder's start to its end: the time in which legs and air are commanded."""
        self._commanding, ended = True, "interrupted"
        images = frames_kept(self._plan, trial)
        self.desk.enter("starting the recorder")
        recorder = RecorderProcess(aside, images, attachments, self.get_namespace())
        try:
            self._begin_recording(recorder, trial)
            self._prepare_bed()
            if images != "none":
                self._film()
            self.desk.enter("standing")
            self._wait(lambda: False, self._plan.standing_s)
            self.desk.enter("walking")
            self._walk(self._plan.duration_s(trial.omega_rad_s))
            ended = OK
        except (TrialFailed, CampaignEnds, Held) as error:
            ended = str(error)
            raise
        finally:
            if ended != OK:
                self._make_safe()
            self._recorder, self._commanding, self._running = None, False, ""
            self._supervisor.watch(now_s=0.0)
            self.desk.enter("closing the bag")
            self._end_recording(recorder, ended)
        return recorder

    def _gate(self, folder: CampaignFolder) -> None:
        """All that a trial needs is there, once, and alive; CampaignEnds with what is not."""
        needed = [*self._required, *(name for name in _HEARD if name in self._told)]
        self._vital = [Sign(name, LOOP, self._silence_s) for name in needed] + [_BED]

        def missing() -> list[str]:
            ages = ((sign, self._supervisor.age_s(sign.who, sign.topic, self._listening.now_s)) for sign in self._vital)
            faults = [f"{sign.who} {fault}" for sign in self._vital if (fault := self._neighbours.faults.get(sign.who))]
            return faults + [sign.missing for sign, age_s in ages if age_s > sign.limit_s] + self._unplugged()

        if not self._wait(lambda: not missing(), DISCOVERY_S):
            raise CampaignEnds(f"the {missing()[0]}; {_START_THEM}, then start the campaign again to go on")
        self._pace()
        for topic in (topics.LEG_SETPOINTS, topics.BED_BLOWER, topics.OPERATOR_LEASE):
            if not self._wait(lambda topic=topic: len(self._who_publishes(topic)) == 1, DISCOVERY_S):  # type: ignore[misc]
                names = " and ".join(self._who_publishes(topic)) or "nobody"
                raise CampaignEnds(f"{names} publish {topic.name}: one commander is needed, and only one")
        if (free := shutil.disk_usage(folder.path).free) < FREE_BYTES:
            raise CampaignEnds(f"{folder.path}: only {free >> 20} MiB free, a trial needs {FREE_BYTES >> 20}")

    def _pace(self) -> None:
        """Sensors run at their rates; CampaignEnds with what does not."""
        bed = self._plan.bed_protocol
        # With fewer heights than that a rest of the bed would time out.
        least_hz = bed.min_readings / (bed.average_s + bed.overrun_s)
        since_s, heights, before = self._listening.now_s, self._heights, self._told["tracker"][2]
        faults = [""]

        def paced() -> bool:
            rate_hz = (self._heights - heights) / max(self._listening.now_s - since_s, PACE_S)
            slow = f"{topics.BED_HEIGHT.name} comes at {rate_hz:.1f} Hz, {least_hz:.1f} are needed"
            # The virtual lab takes frames when it has the time, and gives them the stamps of even ones.
            cameras = "" if self._has_lab else pace_fault(before, self._told["tracker"][2])
            faults[0] = slow if rate_hz < least_hz else cameras
            return not faults[0] and self._listening.now_s - since_s >= PACE_S

        if not self._wait(paced, DISCOVERY_S):
            raise CampaignEnds(f"{faults[0]}; mend it, then start the campaign again to go on")

    def _set_up(self, trial: PlannedTrial) -> None:
        self._phi, self._bed_stage, self._motion_start_ns = None, "", None
        plan = self._plan.of(trial)
        gait = plan.clock_gait
        self._set("clock", "omega_rad_s", trial.omega_rad_s)
        self._set("clock", "gait", plan.gait)
        if plan.gait == "CUSTOM":
            for name in ("theta_s_rad", "theta_0_rad", "duty"):
                self._set("clock", name, getattr(gait, name))
        self._set("clock", "rate_hz", self._plan.setpoint_rate_hz)
        self._set("clock", "max_run_s", self._plan.duration_s(trial.omega_rad_s) + CALL_S)
        # After the trial before, the legs stand where they stopped; every trial starts from the same stance.
        self._call("/clock/home")
        self._set("bed", "target_phi", trial.phi)
        if self._has_lab:
            self._set("lab", "trial_seed", trial.seed)
            self._set("lab", "batch_seed", trial.occasion.batch_seed)
            self._set("lab", "progress", trial.occasion.progress)
            self._call("/lab/reset")

    def _begin_recording(self, recorder: RecorderProcess, trial: PlannedTrial) -> None:
        if not self._wait(lambda: recorder.ready or recorder.ended, CLOSE_S) or recorder.ended:
            raise TrialFailed(f"the recorder did not start: {recorder.last_line}")
        self._recorder, ready_s = recorder, self._listening.now_s
        self._neighbours.forget("recorder")  # that of the trial before
        self._told.pop("recorder", None)
        self._watch()
        # On a busy machine it may be found seconds after it is ready.
        if not self._wait(lambda: self._supervisor.heard_since("recorder", "", ready_s), DISCOVERY_S):
            raise TrialFailed(f"the recorder is not heard on {topics.DIAGNOSTICS.name}")
        self._vital.append(Sign("recorder", LOOP, self._silence_s))
        self._watch()
        # Only now: a bag begins with the state of its own trial.
        self._trial.publish(messages.string(trial_message(self._plan.of(trial), trial, self._robot, time.time_ns())))

    def _end_recording(self, recorder: RecorderProcess, ended: str) -> None:
        recorder.tell(ended)
        if not self._spin_until(lambda: recorder.ended, CLOSE_S):
            recorder.kill()

    def _prepare_bed(self) -> None:
        self.desk.enter("preparing the bed")
        self._call("/bed/prepare")
        begun: list[str] = []

        def over() -> bool:
            if self._bed_stage not in ("", "idle", "ready", "failed"):
                begun.append(self._bed_stage)
            return self._phi is not None or (bool(begun) and self._bed_stage in ("failed", "idle"))

        done = self._wait(over, BED_S)
        if self._bed_stage == "idle":
            self._stopped_by_hand(self._bed_text)
        if not done or self._phi is None:
            raise TrialFailed(f"the bed was not prepared: {self._bed_text or f'no end within {BED_S:g} s'}")

    def _film(self) -> None:
        """Keep frames from here on; those of the bed's preparation would only fill the disk."""
        if not self._wait(self._pause_images.service_is_ready, CALL_S):
            raise TrialFailed(f"the recorder does not offer {PAUSE_IMAGES}")
        self._ask(self._pause_images, SetBool.Request(data=False), PAUSE_IMAGES)

    def _walk(self, duration_s: float) -> None:
        before = self._told["tracker"][2]
        self._call("/clock/start")
        moved = self._wait(lambda: self._motion_start_ns is not None, CALL_S)
        if not moved:
            raise TrialFailed("the clock was started but no leg moved (/leg_states)")
        end_ns = (self._motion_start_ns or 0) + int(duration_s * 1e9)
        self._watch(*_WALKING)

        def over() -> bool:
            return (self._leg_time_ns or 0) >= end_ns or not self._moving

        if not self._wait(over, duration_s + CALL_S):
            raise TrialFailed(f"the trial was not over {CALL_S:g} s after its time (/leg_states)")
        if not self._moving:
            self._explain_rest()
        self._watch()
        self._call("/clock/stop")
        # Until the legs report rest, late reports of this trial could be taken for the start of the next.
        if not self._wait(lambda: not self._moving, CALL_S):
            raise TrialFailed("the legs did not report rest after /clock/stop (/leg_states)")
        # The last frames are still on their way through the tracker: milliseconds, or seconds on a busy machine.
        last_ns = max(end_ns, (self._leg_time_ns or 0) - LAST_FRAME_NS)
        self._wait(lambda: self._speed_ns >= last_ns or self._is_quiet(_TRACKER), DRAIN_S)
        asked_s = self._listening.now_s
        self._wait(lambda: self._supervisor.heard_since("tracker", topics.DIAGNOSTICS.name, asked_s), CALL_S)
        if fault := camera_fault(before, self._told["tracker"][2]):
            raise TrialFailed(fault)

    def _watch(self, *more: Sign) -> None:
        beats = (
            Sign(sign.who, topics.HEARTBEAT.name, self._silence_s / BEATS)
            for sign in self._vital
            if sign.who != "recorder" and sign.who not in self._neighbours
        )
        now_s = self._listening.now_s
        # Those of other makers need not beat; the recorder is our own child, of which the system tells.
        beating = [beat for beat in beats if math.isfinite(self._supervisor.age_s(beat.who, beat.topic, now_s))]
        self._supervisor.watch(*more, *self._vital, *beating, now_s=now_s)

    def _is_quiet(self, sign: Sign) -> bool:
        return self._supervisor.age_s(sign.who, sign.topic, self._listening.now_s) > QUIET_S

    def _explain_rest(self) -> None:
        """Legs came to rest in the middle: a fault ends the trial, a hand on the stop the campaign."""
        self._commanding = False
        # Whoever reports the legs may have seen before us that the clock is gone.
        self._spin_until(lambda: self._told["clock"][0] > 1 or self.hold.now or bool(self._fault()), EXPLAIN_S)
        if self.hold.now:
            raise Held(self.hold.why)
        if fault := self._fault():
            raise TrialFailed(fault)
        level, text, _ = self._told["clock"]
        if level > 1:
            raise TrialFailed(f"the clock: {text}")
        self._stopped_by_hand("the legs were stopped by hand")

    def _stopped_by_hand(self, what: str) -> NoReturn:
        """Somebody stopped legs or air, and perhaps has not told us yet: nothing goes on unless he says so."""
        self._spin_until(lambda: self.hold.now, EXPLAIN_S)
        if not self.hold.now and not self.desk.attended:
            raise CampaignEnds(f"{what}; start the campaign again to go on")
        if not self.hold.now:
            self.hold.stop(what)
        raise Held(self.hold.why)

    @property
    def _required(self) -> tuple[str, ...]:
        """Who must tell his health: a robot of another maker need not."""
        return (*_REQUIRED, "lab") if self._has_lab else _REQUIRED

    def _who_publishes(self, topic: topics.Topic) -> list[str]:
        return names_of(self.get_publishers_info_by_topic(topic.relative))

    def _is_published(self, topic: topics.Topic) -> bool:
        return bool(self.count_publishers(topic.relative))

    def _make_safe(self) -> None:
        """Ask clock and bed to stop; should they not hear it, the lease they no longer get does."""
        self._commanding = False
        for name in ("/clock/stop", "/bed/abort"):
            self._triggers[name].call_async(Trigger.Request())
        self._spin_until(lambda: False, 0.1)
        self._spin_until(lambda: not self._moving, SAFE_S)

    def _call(self, name: str) -> None:
        answer = self._ask(self._triggers[name], Trigger.Request(), name)
        if not answer.success:
            raise TrialFailed(f"{name} refused: {answer.message}")

    def _set(self, node: str, name: str, value: Any) -> None:
        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
        answer = self._ask(self._setters[node], request, f"parameters of {node}")
        if not answer.results[0].successful:
            raise TrialFailed(f"{node} refused {name}={value}: {answer.results[0].reason}")

    def _ask(self, client: Client, request: Any, what: str) -> Any:
        answer = ask(client, request, self._wait, CALL_S)
        if answer is None:
            raise TrialFailed(f"no answer from {what} within {CALL_S:g} s")
        return answer

    def _wait(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Whether the condition came to hold; raises as soon as there is no point in waiting any longer."""

        def wrong() -> bool:
            return self._ending or self.hold.now or bool(self._fault())

        self._spin_until(lambda: condition() or wrong(), timeout_s)
        self._end_if_asked()
        if self.hold.now:
            raise Held(self.hold.why)
        if fault := self._fault():
            raise TrialFailed(fault)
        return condition()

    @property
    def _ending(self) -> bool:
        return self._stop.asked or bool(self._health.refused)

    def _end_if_asked(self) -> None:
        if self._stop.asked:
            raise KeyboardInterrupt
        if self._health.refused:
            raise CampaignEnds(self._health.refused)

    def _fault(self) -> str:
        level, text, _ = self._told.get("recorder", (0, "", {}))
        if self._recorder is not None and level > 1:
            # A full disk, say: what the legs do from now on is lost, so they stop.
            return f"the recorder {text if text.startswith('ended: ') else f'failed: {text}'}"
        if self._recorder is not None and self._recorder.ended:
            return f"the recorder ended: {self._recorder.why_ended}"
        if self._recorder is not None and self._recorder.frozen:
            return "the recorder is frozen"
        for sign in self._vital if self._recorder is not None else ():
            # Who ends in order says so, and of who does not the system tells; nobody waits for his silence.
            if (text := self._told.get(sign.who, (0, "", {}))[1]).startswith("ended: "):
                return f"the {sign.who} {text}"
            if sign.who != "recorder" and (fault := self._neighbours.faults.get(sign.who)):
                return f"the {sign.who} {fault}"
        if self._recorder is not None and (unplugged := self._unplugged()):
            return f"the {unplugged[0]}"
        silent = self._supervisor.silent(self._listening.now_s)
        level, text, _ = self._told.get("clock", (0, "", {}))
        # A clock that has stopped is silent by right, and has said why: the robot's reports may lag behind it.
        return "" if not silent else f"the clock: {text}" if level > 1 else f"the {silent}"

    def _unplugged(self) -> list[str]:
        """Drivers that are there, but not their devices."""
        said = ((who, *self._told[who][:2]) for who in _DRIVERS if who in self._told)
        return [f"{who} has lost its device: {text}" for who, level, text in said if level > 1]

    def _spin_until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        deadline = time.monotonic() + timeout_s
        while not condition():
            now_s = time.monotonic()
            if now_s >= deadline:
                return False
            self._listening.look(now_s)
            for who, starved_s in self._neighbours.look(now_s).items():
                for name in (who, _ROBOT) if who in _ROBOTS else (who,):
                    self._supervisor.starved(name, starved_s)
            self._renew(now_s)
            self._executor.spin_once(timeout_sec=min(deadline - now_s, RENEW_S))
        return True

    def _renew(self, now_s: float) -> None:
        # From this loop, not from a thread: a campaign that is stuck commands nothing.
        if self._commanding and self._lease is not None and now_s - self._renewed_s >= RENEW_S:
            self._renewed_s = now_s
            self._lease.publish(messages.header(self.get_clock().now().nanoseconds, self.get_name()))

    def _heard(self, who: str, topic: topics.Topic) -> None:
        self._supervisor.heard(who, topic.name, self._listening.now_s)

    def _on_phi(self, message: Any) -> None:
        # The latched value of the trial before arrives on subscription only; set_up clears it.
        self._phi = float(message.data)

    def _on_bed(self, message: Any) -> None:
        self._heard("bed", topics.BED_STATUS)
        for status in message.status:
            values = status_values(status)
            self._bed_stage, self._bed_text = values.get("stage", self._bed_stage), status.message
            self._bed_height_m = float(values.get("height_m", math.nan))

    def _on_height(self, _: bytes) -> None:
        self._heights += 1

    def _on_legs(self, message: Any) -> None:
        self._heard(_ROBOT, topics.LEG_STATES)
        self._leg_time_ns = messages.nanoseconds(message.header.stamp)
        self._moving = any(rate != 0.0 for rate in message.velocity)
        if self._motion_start_ns is None and self._moving:
            self._motion_start_ns = self._leg_time_ns

    def _on_setpoint(self, _: bytes) -> None:
        self._heard("clock", topics.LEG_SETPOINTS)

    def _on_speed(self, message: Any) -> None:
        self._heard("tracker", topics.SPEED)
        self._speed_ns = messages.nanoseconds(message.header.stamp)

    def _on_heartbeat(self, message: Any) -> None:
        self._heard(message.frame_id, topics.HEARTBEAT)
        if (turned_ns := messages.nanoseconds(message.stamp)) > self._turned_ns.get(message.frame_id, 0):
            self._turned_ns[message.frame_id] = turned_ns
            self._supervisor.heard(message.frame_id, LOOP, self._listening.now_s)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = status_values(status)
            if not self._neighbours.meet(status.name, values.get(PROCESS, "")):
                continue
            self._heard(status.name, topics.DIAGNOSTICS)
            self._supervisor.heard(status.name, LOOP, self._listening.now_s)
            self._told[status.name] = (status.level[0], status.message, values)
