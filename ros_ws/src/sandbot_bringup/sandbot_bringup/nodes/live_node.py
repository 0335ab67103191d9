"""A campaign over the real nodes: the queue, trial by trial, under the operator's control."""

import math
import multiprocessing
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from pathlib import Path
from typing import Any

import rclpy
from tqdm import tqdm

from sandbot_bringup.config import robot_of
from sandbot_bringup.endings import CampaignEnds, Held, TrialFailed
from sandbot_bringup.folder import CampaignFolder
from sandbot_bringup.journal import Event, Journal
from sandbot_bringup.nodes.campaign_node import PRIORITY, CampaignNode, keep_complete
from sandbot_bringup.nodes.operator_node import OperatorInterface
from sandbot_bringup.plan import Plan, PlannedTrial, trials_of, with_block
from sandbot_bringup.queue import Queue, State
from sandbot_bringup.streak import Streak
from sandbot_bringup.supervision import SILENCE_S
from sandbot_bringup.until import Entry, decide, looks_of
from sandbot_common.dead_ports import fresh_participant_number
from sandbot_common.errors import InputError
from sandbot_common.process import real_time
from sandbot_common.ros.node import start_ros, use_shared_memory
from sandbot_common.ros.timer import end_timers
from sandbot_common.shared_memory import note_shortage
from sandbot_common.stop import stop_signals
from sandbot_common.workers import pool
from sandbot_record.trials.from_bags import row_from_bag
from sandbot_record.trials.table import Row

HELD = "held: {}; to go on: ros2 service call /campaign/go std_srvs/srv/Trigger, or the console"


def run_live(
    plan: Plan,
    folder: CampaignFolder,
    files: Mapping[str, str],
    *,
    redo: Callable[[], Mapping[str, str]] | None = None,
    silence_s: float = SILENCE_S,
    ros_arguments: Sequence[str] = (),
) -> Queue:
    """Run every trial that has no bag yet, and those the operator adds meanwhile; returns the final queue.

    ``redo``: gives names and statuses of bags whose trials are run again; trials that fail are then repeated once, too.
    ``silence_s``: a node that is silent for longer ends the trial under way. ``ros_arguments``: as for any node, e.g.
    ``--ros-args -r __ns:=/robot1``. The nodes must be running (``ros2 launch sandbot_bringup trackway.launch.py``);
    raises InputError if they are not.
    On Ctrl-C, kill or a closed terminal legs and air are stopped and the bag under way is closed and set aside.
    """
    use_shared_memory(frames=False)
    note_shortage()
    with stop_signals() as stop:
        # ROS's own handlers would end the context before the legs are stopped.
        # Inherited by the receiving threads: late reception would be mistaken for silence.
        with real_time(PRIORITY, inherited=True):
            start_ros([plan.name, *ros_arguments])
        node: CampaignNode | None = None
        try:
            domain = rclpy.get_default_context().get_domain_id()
            with real_time(PRIORITY, inherited=True), fresh_participant_number(domain):
                node = CampaignNode(plan, robot_of(files), stop, silence_s)
            node.find_nodes()
            # A trackway has one campaign; the folder may belong to one in another namespace or on another host.
            with folder.adopted(plan, files):
                keep_complete(folder, trials_of(plan))
                folder.set_aside(redo() if redo else {})
                campaign = _Campaign(node, plan, folder, files)
                try:
                    campaign.run_all()
                    if redo is not None and campaign.repeat_failed():
                        campaign.run_all()
                finally:
                    node.restore_settings()
        finally:
            if node is not None:
                end_timers(node)
            rclpy.try_shutdown()
    return campaign.queue


class _Campaign:
    """The queue with its journal, status and plan on disk."""

    def __init__(self, node: CampaignNode, plan: Plan, folder: CampaignFolder, files: Mapping[str, str]) -> None:
        self._node, self._folder = node, folder
        self._attachments: list[Path] = [folder.plan_file, *(folder.path / name for name in files)]
        self._files, self._streak = files, Streak()
        journal = Journal(folder.journal, time.time)
        waiting = {trial.trial_id for trial in folder.missing(trials_of(plan))}
        finished = {trial.trial_id for trial in trials_of(plan)} - waiting
        self.queue = Queue(plan, finished, journal.earlier)
        self._interface = node.interface = OperatorInterface(
            node, folder.path, self.queue, node.hold_services, journal, lambda grown: folder.adopt(grown, files)
        )
        self._interface.look = _shown(looks_of(folder))
        self._interface.note("begin", trials=len(self.queue.entries), finished=len(finished))
        self._note_kept(journal.earlier)
        if node.hold.why:  # held before there was a journal
            self._interface.note("hold", who="operator", reason=node.hold.why)

    def _note_kept(self, earlier: Sequence[Event]) -> None:
        """Write the events of trials that were over when a campaign was killed, before it could write them itself."""
        last = {str(event.get("trial_id")): event["do"] for event in earlier}
        for name, entry in self.queue.entries.items():
            if entry.state is State.DONE and last.get(name) == "start":
                with suppress(InputError, OSError):  # damaged since: it has no figures
                    measured = _measured(row_from_bag(self._folder.bag(entry.trial)))
                    self.queue.finish(name, math.nan, measured)
                    self._interface.note("done", trial_id=name, measured=measured)

    def run_all(self) -> None:
        """Run until nothing waits. However it ends, the journal records it."""
        reason = "interrupted"
        # Without a total a bar would be drawn of no trials at all.
        waiting = self.queue.waiting
        bar: Any = tqdm(total=waiting, unit="trial", desc="campaign", disable=not (waiting or self.queue.plan.until))
        try:
            with bar:
                while self._run_next(bar) or self._look(bar):
                    bar.refresh()
            reason = "nothing waits"
        except Exception as error:
            reason = str(error)
            raise
        finally:
            self._interface.end(reason)

    def repeat_failed(self) -> bool:
        """Queue the failed trials again; returns whether there were any."""
        failed = list(self.queue.failed)
        for trial_id in failed:
            self._interface.note("repeat", trial_id=trial_id, reason=self.queue.failed[trial_id])
            self.queue.repeat(trial_id)
        return bool(failed)

    def _run_next(self, bar: Any) -> bool:
        """Run the next trial, once the campaign is not held; returns whether there was one."""
        hold = self._node.hold
        hold.between_trials()
        if hold.why:
            bar.write(HELD.format(hold.why))
        self._node.await_go()
        trial = self.queue.next()
        if trial is None:
            return False
        bar.total = bar.n + self.queue.waiting + len(self.queue.failed)
        self._run(trial, bar)
        return True

    def _look(self, bar: Any) -> bool:
        """Nothing waits: in a campaign until a verdict, plan the next block. Returns whether there is one."""
        if not self.queue.plan.until or not self.queue.measured:
            return False
        self._interface.enter("looking at the trials so far")
        entry = self._take_look()
        self._interface.look = _shown([entry])
        self._interface.note("look", **{key: entry[key] for key in ("look", "text", "stop")})
        bar.write(f"look {entry['look']}: {entry['text']}")
        if entry["next"]:
            # In addition to trials that the operator has added meanwhile, which are run in any case.
            plan = with_block(self.queue.plan, entry["next"])
            self._folder.adopt(plan, self._files)
            self.queue.grow(plan)
        return bool(self.queue.waiting)

    def _take_look(self) -> Entry:
        """The result of a look at all trials so far, in a separate process, so that the nodes are still heard here."""
        with pool(1, "spawn") as looking:
            future = looking.submit(decide, self.queue.plan, self._folder, self.queue.skipped)
            try:
                self._node.wait_for(future.done)
            except BaseException:
                # The result is no longer wanted.
                for worker in multiprocessing.active_children():
                    worker.terminate()
                raise
            try:
                return future.result()[1]
            except BrokenProcessPool:
                why = "the process that looked at the trials was killed (out of memory?)"
                raise CampaignEnds(f"{why}; start the campaign again to go on") from None

    def _run(self, trial: PlannedTrial, bar: Any) -> None:
        name, begun_s = trial.trial_id, time.monotonic()
        self.queue.begin(name)
        self._interface.note("start", trial_id=name)
        try:
            row = self._node.run(trial, self._folder, self._attachments)
        except Held as error:
            self.queue.put_back(name, str(error))
            self._interface.note("stopped", trial_id=name, reason=str(error))
        except TrialFailed as error:
            self.queue.fail(name, str(error))
            bar.write(f"{name}: failed: {error}")  # before the journal, whose disk may be the reason
            self._interface.note("failed", trial_id=name, reason=str(error))
            if self.queue.waiting and (why := self._streak.failed(str(error))):
                self._hold_or_end(why)
        else:
            self._streak.end()
            seconds, measured = round(time.monotonic() - begun_s, 2), _measured(row)
            self.queue.finish(name, seconds, measured)
            self._interface.note("done", trial_id=name, seconds=seconds, measured=measured)
            bar.update()

    def _hold_or_end(self, why: str) -> None:
        """Hold the campaign if a console runs, otherwise end it."""
        if not self._interface.attended:
            raise CampaignEnds(f"{why}; fix it, then start the campaign again to go on")
        self._streak.end()
        self._node.hold.stop(why)
        self._interface.note("hold", reason=why)


def _shown(looks: Sequence[Entry]) -> Entry | None:
    """The last look as the page shows it, without the next trials, which are in the queue."""
    return {key: value for key, value in looks[-1].items() if key != "next"} if looks else None


def _measured(row: Row) -> Mapping[str, float]:
    """Measured values of a finished trial for the page, without NaN."""
    values = {name: float(getattr(row, name)) for name in ("phi", "speed_m_s", "speed_sd_m_s", "lift_m")}
    return {name: value for name, value in values.items() if math.isfinite(value)}
