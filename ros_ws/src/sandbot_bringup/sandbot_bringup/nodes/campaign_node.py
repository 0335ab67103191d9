"""Run a campaign's trials live over the real nodes: prepare the bed, record, start the clock, stop.

While a trial's air may blow or its legs move, this node renews /operator/lease: if it ends, freezes or is killed, bed
and clock stop by themselves. It watches all nodes a trial needs (``monitor_node``); if one falls silent, the trial ends
at once.
"""

import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any, NoReturn

from rclpy.duration import Duration
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher

from sandbot_bed.protocol import ProtocolParameters, Stage
from sandbot_bringup.endings import CampaignEnds, Held, StoppedByHand, TrialFailed
from sandbot_bringup.folder import CampaignFolder, frames_kept, lossless_s
from sandbot_bringup.hold import Hold
from sandbot_bringup.nodes.hold_node import HoldServices
from sandbot_bringup.nodes.monitor_node import RECORDER, TRACKER_SPEED, Monitor, NodeStatus
from sandbot_bringup.nodes.operator_node import OperatorInterface
from sandbot_bringup.nodes.preflight_node import DISCOVERY_S, Preflight
from sandbot_bringup.nodes.services_node import CALL_S, ServiceClients
from sandbot_bringup.plan import Plan, PlannedTrial
from sandbot_bringup.preparation import Preparation
from sandbot_bringup.provenance import trial_message
from sandbot_bringup.recorder_process import RecorderProcess
from sandbot_bringup.supervision import SILENCE_S
from sandbot_common import messages, topics
from sandbot_common.errors import InputError
from sandbot_common.health import ending, has_ended
from sandbot_common.parameters import from_mapping, specs
from sandbot_common.process import real_time
from sandbot_common.robot import Robot
from sandbot_common.ros.command_node import AIR, LEGS, NOTHING
from sandbot_common.ros.endpoints import publisher
from sandbot_common.ros.node import spin_once
from sandbot_common.ros.ros_health import Health
from sandbot_common.ros.ros_parameters import refuse_parameters
from sandbot_common.standstill import RAN
from sandbot_common.stop import Stop
from sandbot_record.bags.reader import Bag
from sandbot_record.bags.writer import add_metadata
from sandbot_record.trials.camera_reports import camera_fault
from sandbot_record.trials.from_bags import plan_of, row_from_bag
from sandbot_record.trials.table import OK, Row

BED_S = 600.0
DRAIN_S = 20.0
LAST_FRAME_NS = 30_000_000
"""The last frame may precede the legs' rest by this much."""
CLOSE_S = 30.0
PRIORITY = 5
"""Real-time priority while it commands, below the clock's; also that of the threads that receive its messages."""
RENEW_S = 0.02
"""Period of the lease's renewal: a dozen renewals before the clock takes it for lost."""
HEARD_S = 1.0
"""How long to wait until all obeying nodes have received what may begin; it takes milliseconds unless one is frozen."""
EXPLAIN_S = 0.7
"""How long to wait for an explanation after legs have come to rest unasked."""
LEAVE_S = 2.0
SAFE_S = 3.0
"""How long to wait for legs that still report motion, before the recorder is ended."""


def mark(bag: Path, exit_status: str) -> None:
    """Write a trial's exit status into its closed bag, if it was only known after judging the bag."""
    with suppress(InputError, OSError):  # a full disk: trials.csv has the status all the same
        add_metadata(bag, "trial", {**Bag.open(bag).provenance.get("trial", {}), "exit_status": exit_status})


def checked_row(bag: Path) -> Row:
    """The row of a closed bag. Raises TrialFailed if it is not ok or unreadable, after marking the bag if possible."""
    try:
        row = row_from_bag(bag)
    except (InputError, OSError) as error:
        # E.g. a damaged disk: this trial is lost but the campaign is not, and the bag is kept for `recover`.
        why = f"unreadable: {str(error).removeprefix(f'{bag}: ')}"
    else:
        if row.status == OK:
            return row
        why = row.status
    mark(bag, why)
    raise TrialFailed(f"{why}; its bag is kept in {bag}")


def keep_complete(folder: CampaignFolder, trials: Iterable[PlannedTrial]) -> None:
    """Keep trials that were over, and are ok, but whose bags a killed campaign could not move to their places."""
    for trial in folder.missing(trials):
        if _is_complete(folder.partial(trial.trial_id), trial):
            folder.keep(trial)
            print(f"{trial.trial_id}: was complete when the campaign was killed: kept")


def _is_complete(path: Path, trial: PlannedTrial) -> bool:
    """Whether the bag is of this very trial, ended as it should, and is ok for the table."""
    try:
        bag = Bag.open(path)
        of_trial = {"trial_id": trial.trial_id, "seed": trial.seed}
        ended = {bag.provenance.get(name, {}).get("exit_status") for name in ("trial", "recording")}
        return ended == {OK} and of_trial.items() <= plan_of(bag).items() and row_from_bag(path).status == OK
    except (InputError, OSError):
        return False


def _clock_parameters(plan: Plan, trial: PlannedTrial) -> dict[str, Any]:
    """The clock's parameters for a trial; ``plan`` is the one for this trial."""
    walk = {"omega_rad_s": trial.omega_rad_s, "gait": plan.gait, "rate_hz": plan.setpoint_rate_hz}
    if plan.gait == "CUSTOM":
        walk |= {name: getattr(plan.clock_gait, name) for name in ("theta_s_rad", "theta_0_rad", "duty")}
    return walk | {"max_run_s": plan.duration_s(trial.omega_rad_s) + CALL_S}


class CampaignNode(Node):
    """Does what a person at the trackway does, through the same services and parameters."""

    interface: OperatorInterface
    """Set once there is a folder for its journal."""

    def __init__(self, plan: Plan, robot: Robot, stop: Stop, silence_s: float = SILENCE_S) -> None:
        super().__init__("campaign")
        refuse_parameters(self)
        self._plan, self._robot, self._stop = plan, robot, stop
        self.hold = Hold()
        self.hold_services = HoldServices(self, self.hold)
        self._executor = EventsExecutor()
        self._executor.add_node(self)
        self._health = Health(self, lambda: {"trial": self._running}, sole=True)
        self._trial = publisher(self, topics.TRIAL)
        self._lease: Publisher | None = None
        self._commanding, self._renewed_s, self._allowed = False, -math.inf, NOTHING
        self._running, self._begun_s = "", -math.inf
        self._recorder: RecorderProcess | None = None
        self._monitor = Monitor(self, silence_s, RENEW_S)
        self._service_clients = ServiceClients(self, self._wait)
        self._found: dict[str, dict[str, Any]] = {}
        self._bed = plan.bed_protocol
        self._preflight = Preflight(self, self._monitor, self._service_clients, self._wait)

    def find_nodes(self) -> None:
        """Wait for everything a trial needs. Raises InputError naming what is missing."""
        self._preflight.find_nodes()
        # The nodes may be heard sooner than another campaign, beside which this one must not make a folder.
        self._wait(lambda: self._health.settled, math.inf)
        # From here on clock and bed obey only this one.
        self._lease = publisher(self, topics.OPERATOR_LEASE)

    def await_go(self) -> None:
        """While the campaign is held, wait for the operator, without a time limit: nothing moves and nothing blows."""
        if not self.hold.why:
            return
        self.interface.enter("")
        self._spin_until(lambda: not self.hold.why or self._ending, math.inf)
        self._end_if_asked()

    def wait_for(self, condition: Callable[[], bool]) -> None:
        """Keep spinning until work elsewhere is done; nothing moves meanwhile."""
        self._spin_until(lambda: condition() or self._ending, math.inf)
        self._end_if_asked()

    def run(self, trial: PlannedTrial, folder: CampaignFolder, attachments: Sequence[Path]) -> Row:
        """One trial from bed preparation to the closed bag, and its row of the table.

        Raises TrialFailed with the reason otherwise, Held if a person stopped it.
        """
        # Recorded under .partial and moved when complete and judged: a bag in trials/ is always a whole trial.
        partial = folder.partial_bag(trial.trial_id)
        # After a standstill another campaign may have begun, and is heard within this time.
        self._wait(lambda: not self._health.held_up_s, math.inf)
        self._read_settings()
        self._preflight.before_trial(self._bed, folder, lossless_s(self._plan, trial))
        self._service_clients.await_answers()
        self._running, self._begun_s = trial.trial_id, time.monotonic()
        self._set_up(trial)
        # Judging the bag takes a second of CPU and needs no lease.
        with real_time(PRIORITY):
            recorder = self._run(trial, partial, attachments)
        if recorder.code is None:
            raise TrialFailed(f"its disk does not answer; the recorder is left to close {partial}")
        if recorder.code != 0:
            raise TrialFailed(f"the recorder {ending(recorder.why_ended)}; its bag is {partial}")
        # Judged as for the table: a trial that is not ok there is not finished.
        row = checked_row(partial)
        folder.keep(trial)
        return row

    def _run(self, trial: PlannedTrial, bag: Path, attachments: Sequence[Path]) -> RecorderProcess:
        """From the recorder's start to its end: the time in which legs and air are commanded."""
        self._commanding, ended = True, "interrupted"
        images = frames_kept(self._plan, trial)
        self.interface.enter("starting the recorder")
        recorder = RecorderProcess(bag, images, attachments, self.get_namespace())
        try:
            self._begin_recording(recorder, trial)
            self._prepare_bed()
            if images != "none":
                # Frames of the bed's preparation would only fill the disk.
                self._service_clients.film()
            self.interface.enter("standing")
            self._wait(lambda: False, self._plan.standing_s)
            self._await_first_record()
            self.interface.enter("walking")
            self._walk(trial)
            ended = OK
        except (TrialFailed, CampaignEnds, Held) as error:
            ended = str(error)
            raise
        finally:
            if ended != OK:
                self._make_safe()
            self._recorder, self._commanding, self._running = None, False, ""
            self._monitor.stop_watching()
            self.interface.enter("closing the bag")
            self._end_recording(recorder, ended)
        return recorder

    def _read_settings(self) -> None:
        """Before the first trial: bed settings that the plan leaves open are as launched, in all trials."""
        if self._found:
            return
        bed = self._service_clients.get("bed", [spec.name for spec in specs(ProtocolParameters)])
        where = f"plan {self._plan.name}: bed, beside what the bed node has"
        self._bed = from_mapping(ProtocolParameters, {**bed, **self._plan.bed}, where)
        target = self._service_clients.get("bed", ["target_phi"])
        self._found = {"bed": bed | target, "clock": self._service_clients.get("clock", ["max_run_s"])}

    def restore_settings(self) -> None:
        """Restore the parameters that bed and clock had before the first trial, unless another campaign has them."""
        if self._health.refused:
            return
        answers = [self._service_clients.send_values(name, values) for name, values in self._found.items()]
        self._spin_until(lambda: all(answer.done() for answer in answers), LEAVE_S)

    def _set_up(self, trial: PlannedTrial) -> None:
        self._monitor.forget_trial()
        self._set_gait(trial)
        self._service_clients.set("bed", asdict(self._bed) | {"target_phi": trial.phi})
        if self._preflight.has_lab:
            occasion = {"batch_seed": trial.occasion.batch_seed, "progress": trial.occasion.progress}
            self._service_clients.set("lab", {"trial_seed": trial.seed} | occasion)
            self._service_clients.call("/lab/reset")

    def _set_gait(self, trial: PlannedTrial) -> None:
        # The legs stand where the last trial stopped, but every trial starts from the same stance. Home comes first: a
        # clock that runs for somebody else refuses it, and its gait then stays unchanged.
        self._service_clients.call("/clock/home")
        self._service_clients.set("clock", _clock_parameters(self._plan.for_trial(trial), trial))

    def _begin_recording(self, recorder: RecorderProcess, trial: PlannedTrial) -> None:
        if not self._wait(lambda: recorder.ready or recorder.ended, CLOSE_S) or recorder.ended:
            raise TrialFailed(f"the recorder did not start: {recorder.last_line}")
        self._recorder, ready_s = recorder, self._monitor.now_s
        self._monitor.expect_recorder(recorder.pid)
        # On a busy machine it may be discovered seconds after it is ready.
        if not self._wait(lambda: self._monitor.heard_since(RECORDER, ready_s), DISCOVERY_S):
            raise TrialFailed(f"the recorder is not heard on {topics.DIAGNOSTICS.name}")
        self._monitor.require_recorder()
        # Only now, so that the bag begins with its own trial.
        content = trial_message(self._plan.for_trial(trial), trial, self._robot, time.time_ns(), self._bed)
        self._trial.publish(messages.string(content))

    def _await_first_record(self) -> None:
        """A recorder that replaces a killed one sometimes is heard but receives nothing itself."""
        if not self._wait(lambda: self._monitor.recorded > 0, DISCOVERY_S):
            raise TrialFailed("the recorder receives nothing, so the legs do not start; the next trial gets a new one")

    def _end_recording(self, recorder: RecorderProcess, ended: str) -> None:
        """Wait until the bag is closed, however long its disk does not answer: a kill would tear the bag."""
        recorder.tell(ended)
        blocked: list[bool] = []

        def over() -> bool:
            blocked.append(recorder.awaits_disk)
            return recorder.ended

        while not self._spin_until(over, CLOSE_S) and any(blocked) and not self._ending:
            self.interface.enter("closing the bag: its disk does not answer")
            blocked.clear()
        if not recorder.ended and not any(blocked):
            recorder.kill(f"its bag was not closed within {CLOSE_S:g} s")

    def _prepare_bed(self) -> None:
        self.interface.enter("preparing the bed")
        bed = self._monitor
        asked = Preparation(bed.bed_preparation)
        self._start(AIR, "/bed/prepare", lambda: asked.begun(bed.bed_preparation, bed.bed_stage))
        done = self._wait(lambda: asked.over(bed.bed_preparation, bed.bed_stage), BED_S)
        if bed.bed_stage == Stage.IDLE:
            self._stopped_by_hand(bed.bed_text)
        if not done or bed.bed_stage != Stage.READY:
            raise TrialFailed(f"the bed was not prepared: {bed.bed_text or f'no end within {BED_S:g} s'}")
        bed.prepared = bed.bed_stage, bed.bed_preparation

    def _walk(self, trial: PlannedTrial) -> None:
        legs, before = self._monitor, self._monitor.statuses["tracker"].values
        duration_s = self._plan.duration_s(trial.omega_rad_s)
        # Once more: somebody may have set another ω while the bed was prepared, but the row will have the plan's.
        self._set_gait(trial)
        legs.may_move = True
        self._start(LEGS, "/clock/start", lambda: legs.motion_start_ns is not None)
        if not self._wait(lambda: legs.motion_start_ns is not None, CALL_S):
            if why := legs.robot_warns:
                self._stopped_by_hand(f"the robot does not move as it is told ({why})")
            moved = "no leg moved" if legs.reports_legs else "whether a leg moved is not known: nothing is heard"
            raise TrialFailed(f"the clock was started but {moved} ({topics.LEG_STATES.name})")
        end_ns = (legs.motion_start_ns or 0) + int(duration_s * 1e9)
        legs.watch_walking()

        def over() -> bool:
            return (legs.leg_time_ns or 0) >= end_ns or not legs.moving

        if not self._wait(over, duration_s + CALL_S):
            raise TrialFailed(f"the trial was not over {CALL_S:g} s after its time (/leg_states)")
        if not legs.moving:
            self._explain_rest()
        legs.watch()
        self._service_clients.call("/clock/stop")
        # Before the legs report rest, late reports of this trial could be mistaken for the start of the next.
        if not self._wait(lambda: not legs.moving, CALL_S):
            raise TrialFailed("the legs did not report rest after /clock/stop (/leg_states)")
        self._await_last_frame(max(end_ns, (legs.leg_time_ns or 0) - LAST_FRAME_NS))
        if fault := camera_fault(before, self._monitor.statuses["tracker"].values):
            raise TrialFailed(fault)

    def _start(self, what: str, service: str, begun: Callable[[], bool]) -> None:
        """Have legs or air begin, unless somebody has stopped them since this trial began."""
        try:
            with self._allowing(what):
                self._service_clients.call(service, begun, self._begun_s)
        except StoppedByHand as error:
            self._stopped_by_hand(str(error))

    @contextmanager
    def _allowing(self, what: str) -> Iterator[None]:
        """Context in which legs or air may begin: by the lease, so that nobody else's request starts anything."""
        self._allowed, self._renewed_s = what, -math.inf
        self._renew(time.monotonic())
        try:
            if (lease := self._lease) is not None:
                self._wait(lambda: lease.wait_for_all_acked(Duration()), HEARD_S)
            yield
        finally:
            self._allowed = NOTHING

    def _await_last_frame(self, last_ns: int) -> None:
        """Wait for frames that the tracker still processes: milliseconds, or seconds on a busy machine."""
        tracker = self._monitor
        self._wait(lambda: tracker.speed_ns >= last_ns or tracker.is_quiet(TRACKER_SPEED), DRAIN_S)
        asked_s = tracker.now_s
        self._wait(lambda: tracker.heard_since("tracker", asked_s, topics.DIAGNOSTICS.name), CALL_S)

    def _explain_rest(self) -> None:
        """Legs came to rest in mid-trial: a fault ends the trial; a stop by hand, or of the robot, the campaign."""
        monitor = self._monitor
        monitor.watch()  # a clock that was stopped is rightly silent on /leg_setpoints
        # Still under the lease: a clock that loses it stops, and can't say any more that legs rested while it ran.
        clock_ran = self._service_clients.words("/clock/stop") == RAN
        self._commanding = False

        def fault() -> str:
            # The node that reports the legs may have noticed before us that the clock is gone.
            return self._fault() or monitor.clock_fault or monitor.robot_lapsed

        self._spin_until(lambda: bool(fault()) or self.hold.now, EXPLAIN_S)
        if self.hold.now:
            raise Held(self.hold.why)
        if why := fault():
            raise TrialFailed(why)
        self._stopped_by_hand(self._robot_stopped if clock_ran else "the legs were stopped by hand")

    @property
    def _robot_stopped(self) -> str:
        """What is known of a robot that came to rest while the clock moved it: perhaps by a hand on its own switch."""
        why = self._monitor.robot_warns or "its emergency stop, or its own watchdog?"
        return f"the robot stopped by itself while it was told to move ({why})"

    def _stopped_by_hand(self, what: str) -> NoReturn:
        """Somebody stopped legs or air, perhaps without telling us yet: hold until they say go, or end the campaign."""
        self._spin_until(lambda: self.hold.now, EXPLAIN_S)
        if not self.hold.now and not self.interface.attended:
            raise CampaignEnds(f"{what}; start the campaign again to go on")
        if not self.hold.now:
            self.hold.stop(what)
        raise Held(self.hold.why)

    def _make_safe(self) -> None:
        """Ask clock and bed to stop; if they don't hear it, the lease that is no longer renewed stops them."""
        self._commanding = False
        if self._health.held_up_s:
            return  # its leases have run out: what moves or blows by now is another's
        for name in ("/clock/stop", "/bed/abort"):
            self._service_clients.send(name)
        self._spin_until(lambda: False, 0.1)
        self._spin_until(lambda: not self._monitor.moving, SAFE_S)

    def _wait(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Whether the condition became true in time; raises as soon as there is no point in waiting any longer."""

        def hopeless() -> bool:
            return self._ending or self._stopped or bool(self._fault())

        self._spin_until(lambda: condition() or hopeless(), timeout_s)
        self._end_if_asked()
        if self._stopped:
            raise Held(self.hold.why)
        if fault := self._fault():
            raise TrialFailed(fault)
        return condition()

    @property
    def _stopped(self) -> bool:
        """Whether the trial under way is to end at once; there is none while nodes are still being looked for."""
        return self.hold.now and self._lease is not None

    @property
    def _ending(self) -> bool:
        return self._stop.asked or bool(self._health.refused)

    def _end_if_asked(self) -> None:
        if self._stop.asked:
            raise KeyboardInterrupt
        if self._health.refused:
            raise CampaignEnds(self._health.refused)

    def _fault(self) -> str:
        """Why the trial under way is spoilt; an empty string if it is not, or if there is none."""
        if self._recorder is None:
            return ""
        if held_s := self._health.held_up_s:
            return f"the campaign was held up for {held_s:.2g} s"
        level, text, values = self._monitor.statuses.get(RECORDER, NodeStatus())
        if level > 1:
            # E.g. a full disk: nothing more is recorded, so the legs stop.
            return f"the recorder {text if has_ended(text) else f'failed: {text}'}"
        if values.get("state", "recording") != "recording":
            # By /recorder/pause or /recorder/stop: the legs must not walk on unrecorded.
            return f"the recorder {text}"
        if self._recorder.ended:
            return f"the recorder {ending(self._recorder.why_ended)}"
        if self._recorder.frozen:
            return "the recorder is frozen"
        return self._monitor.fault()

    def _spin_until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        deadline = time.monotonic() + timeout_s
        while not condition():
            now_s = time.monotonic()
            if now_s >= deadline:
                return False
            self._monitor.listen()
            self._renew(now_s)
            spin_once(self._executor, self, min(deadline - now_s, RENEW_S))
        return True

    def _renew(self, now_s: float) -> None:
        # From this loop, not from a thread: a stuck campaign must not command.
        if not self._commanding or self._lease is None or self._health.held_up_s:
            return
        if now_s - self._renewed_s >= RENEW_S:
            self._renewed_s = now_s
            says = f"{self.get_name()} {self._allowed}"
            self._lease.publish(messages.header(self.get_clock().now().nanoseconds, says))
