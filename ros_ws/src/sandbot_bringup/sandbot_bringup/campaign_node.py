"""Run a campaign live over the real nodes: prepare the bed, record, start the clock, stop, next trial."""

import math
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger
from tqdm import tqdm

from sandbot_bringup.config import robot_of
from sandbot_bringup.folder import PARTIAL, CampaignFolder, frames_kept
from sandbot_bringup.plan import Plan, PlannedTrial
from sandbot_bringup.provenance import trial_message
from sandbot_common import messages, topics
from sandbot_common.errors import InputError
from sandbot_common.node import ask, publisher, subscription, use_shared_memory
from sandbot_common.robot import Robot

DISCOVERY_S = 20.0
"""Nodes that just started need this long at most to be seen on a busy machine."""

CALL_S = 10.0
BED_S = 600.0
DRAIN_S = 3.0

_UNNAMED = "_NODE_NAME_UNKNOWN_"
_START_THEM = "start the nodes with: ros2 launch sandbot_bringup trackway.launch.py"


class TrialFailed(RuntimeError):
    """A trial could not be completed; the campaign goes on with the next one."""


def run_live(
    plan: Plan, folder: CampaignFolder, files: Mapping[str, str], trials: Sequence[PlannedTrial]
) -> Sequence[tuple[str, str]]:
    """Run every trial that has no bag yet; returns the failed ones with their reasons.

    The nodes must be running (``ros2 launch sandbot_bringup trackway.launch.py``); InputError where they are not.
    On Ctrl-C the legs are stopped, the air is turned off and the bag under way is closed and set aside.
    """
    use_shared_memory(frames=False)
    rclpy.init()
    failed: list[tuple[str, str]] = []
    try:
        operator = Operator(plan, robot_of(files))
        operator.find_nodes()
        folder.adopt(plan, files)
        for trial in tqdm(folder.missing(trials), unit="trial", desc="campaign"):
            try:
                operator.run(trial, folder)
            except TrialFailed as error:
                failed.append((trial.trial_id, str(error)))
    finally:
        rclpy.try_shutdown()
    return failed


class Operator(Node):
    """Does what a person at the trackway does, through the same services and parameters."""

    def __init__(self, plan: Plan, robot: Robot) -> None:
        super().__init__("campaign")
        self._plan, self._robot = plan, robot
        self._trial = publisher(self, topics.TRIAL)
        self._phi: float | None = None
        self._bed_stage = ""
        self._bed_height_m = math.nan
        self._leg_time_ns: int | None = None
        self._motion_start_ns: int | None = None
        self._speed_ns = 0
        self._moving = False
        subscription(self, topics.BED_PHI, self._on_phi)
        subscription(self, topics.BED_STATUS, self._on_bed)
        subscription(self, topics.LEG_STATES, self._on_legs)
        subscription(self, topics.SPEED, self._on_speed)
        self._triggers = {
            name: self.create_client(Trigger, name)
            for name in ("/clock/home", "/clock/start", "/clock/stop", "/bed/prepare", "/bed/abort", "/lab/reset")
        }
        self._pause_images = self.create_client(SetBool, "/recorder/pause_images")
        self._setters = {
            node: self.create_client(SetParameters, f"/{node}/set_parameters") for node in ("clock", "bed", "lab")
        }
        self._has_lab = False
        self._recorder: subprocess.Popen[str] | None = None

    def find_nodes(self) -> None:
        """Wait for all that a trial needs; InputError naming what is missing."""
        for name in ("/clock/start", "/bed/prepare"):
            if not self._triggers[name].wait_for_service(DISCOVERY_S):
                raise InputError(f"no node offers {name}; {_START_THEM}")
        for topic in (topics.LEG_STATES.name, topics.COM.name):
            if not self._wait(partial(self._is_published, topic), DISCOVERY_S):
                raise InputError(f"no node publishes {topic}; {_START_THEM}")
        # Seeing its service is not enough: a preparation fails at once while the bed has not heard its height sensor.
        if not self._wait(lambda: math.isfinite(self._bed_height_m), DISCOVERY_S):
            raise InputError(f"the bed node has no reading on {topics.BED_HEIGHT.name}; {_START_THEM}")
        # Whoever reports the legs is the robot: the virtual lab takes a seed and a reset, a real one is carried back.
        # A publisher can be seen before the name of its node is: guessing then would leave the seed unset.
        if not self._wait(lambda: _UNNAMED not in self._robots(), DISCOVERY_S):
            raise InputError(f"the node that publishes {topics.LEG_STATES.name} does not tell its name; {_START_THEM}")
        self._has_lab = "lab" in self._robots()
        if self._has_lab and not self._triggers["/lab/reset"].wait_for_service(DISCOVERY_S):
            raise InputError(f"the virtual lab does not offer /lab/reset; {_START_THEM}")

    def run(self, trial: PlannedTrial, folder: CampaignFolder) -> None:
        """One trial from bed preparation to the closed bag; TrialFailed with the reason otherwise."""
        # Recorded aside and renamed when complete: a bag in trials/ is always a whole trial.
        aside = folder.trials / PARTIAL / trial.trial_id
        _set_aside_torn(aside)
        self._set_up(trial)
        images = frames_kept(self._plan, trial)
        self._recorder = recorder = _start_recorder(aside, images)
        try:
            self._prepare_bed()
            if images != "none":
                self._film()
            self._wait(lambda: False, self._plan.standing_s)
            self._walk(self._plan.duration_s(trial.omega_rad_s))
        except (TrialFailed, KeyboardInterrupt):
            self._make_safe()
            raise
        finally:
            self._recorder = None
            code = _stop_recorder(recorder)
        if code != 0:
            raise TrialFailed(f"the recorder ended with exit code {code}; its bag is {aside}")
        aside.rename(folder.bag(trial))

    def _set_up(self, trial: PlannedTrial) -> None:
        self._phi, self._bed_stage, self._motion_start_ns = None, "", None
        gait = self._plan.clock_gait
        self._set("clock", "omega_rad_s", trial.omega_rad_s)
        self._set("clock", "gait", self._plan.gait)
        if self._plan.gait == "CUSTOM":
            for name in ("theta_s_rad", "theta_0_rad", "duty"):
                self._set("clock", name, getattr(gait, name))
        self._set("clock", "rate_hz", self._plan.setpoint_rate_hz)
        # After the trial before, the legs stand where they stopped; every trial starts from the same stance.
        self._call("/clock/home")
        self._set("bed", "target_phi", trial.phi)
        if self._has_lab:
            self._set("lab", "trial_seed", trial.seed)
            self._set("lab", "batch_seed", trial.occasion.batch_seed)
            self._set("lab", "progress", trial.occasion.progress)
            self._call("/lab/reset")
        self._trial.publish(messages.string(trial_message(self._plan, trial, self._robot, time.time_ns())))

    def _prepare_bed(self) -> None:
        self._call("/bed/prepare")
        done = self._wait(lambda: self._phi is not None or self._bed_stage == "failed", BED_S)
        if not done or self._phi is None:
            raise TrialFailed(f"the bed was not prepared (stage {self._bed_stage or 'unknown'})")

    def _film(self) -> None:
        """Keep frames from here on; those of the bed's preparation would only fill the disk."""
        if not self._pause_images.wait_for_service(CALL_S):
            raise TrialFailed(f"the recorder does not offer {self._pause_images.srv_name}")
        self._ask(self._pause_images, SetBool.Request(data=False), self._pause_images.srv_name)

    def _walk(self, duration_s: float) -> None:
        self._call("/clock/start")
        moved = self._wait(lambda: self._motion_start_ns is not None, CALL_S)
        if not moved:
            raise TrialFailed("the clock was started but no leg moved (/leg_states)")
        end_ns = (self._motion_start_ns or 0) + int(duration_s * 1e9)
        if not self._wait(lambda: (self._leg_time_ns or 0) >= end_ns, duration_s + CALL_S):
            raise TrialFailed("the legs stopped reporting during the trial (/leg_states)")
        self._call("/clock/stop")
        # Until the legs report rest, late reports of this trial could be taken for the start of the next.
        if not self._wait(lambda: not self._moving, CALL_S):
            raise TrialFailed("the legs did not report rest after /clock/stop (/leg_states)")
        # The frames of the last milliseconds are still on their way through the tracker.
        self._wait(lambda: self._speed_ns >= end_ns, DRAIN_S)

    def _robots(self) -> list[str]:
        return [str(one.node_name) for one in self.get_publishers_info_by_topic(topics.LEG_STATES.name)]

    def _is_published(self, topic: str) -> bool:
        return bool(self.count_publishers(topic))

    def _make_safe(self) -> None:
        for name in ("/clock/stop", "/bed/abort"):
            self._triggers[name].call_async(Trigger.Request())
        self._wait(lambda: False, 0.2)

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
        deadline = time.monotonic() + timeout_s
        while not condition():
            if self._recorder is not None and self._recorder.poll() is not None:
                # A full disk, say: what the legs do from now on is lost, so they stop (_make_safe).
                recorder, self._recorder = self._recorder, None
                raise TrialFailed(f"the recorder ended: {_last_line(recorder)}")
            left = deadline - time.monotonic()
            if left <= 0:
                return False
            rclpy.spin_once(self, timeout_sec=min(left, 0.1))
        return True

    def _on_phi(self, message: Any) -> None:
        # The latched value of the trial before arrives on subscription only; set_up clears it.
        self._phi = float(message.data)

    def _on_bed(self, message: Any) -> None:
        values = {pair.key: pair.value for status in message.status for pair in status.values}
        self._bed_stage = values.get("stage", self._bed_stage)
        self._bed_height_m = float(values.get("height_m", math.nan))

    def _on_legs(self, message: Any) -> None:
        self._leg_time_ns = messages.nanoseconds(message.header.stamp)
        self._moving = any(rate != 0.0 for rate in message.velocity)
        if self._motion_start_ns is None and self._moving:
            self._motion_start_ns = self._leg_time_ns

    def _on_speed(self, message: Any) -> None:
        self._speed_ns = messages.nanoseconds(message.header.stamp)


def _start_recorder(bag: Path, images: str) -> subprocess.Popen[str]:
    """``images``: none, jpeg, video or raw."""
    bag.parent.mkdir(parents=True, exist_ok=True)
    left_out = _ENCODED if images != "none" else _ENCODED | _FRAMES
    names = [topic.name for topic in topics.ALL if topic not in left_out]
    command = [sys.executable, "-m", "sandbot_record.tools.record", *names, "--images", images, "--pause-images"]
    command += ["--out", str(bag)]
    # A process of its own: if this one dies, the run under way is still recorded. Its own session, so that
    # Ctrl-C reaches us first and the legs are stopped while it still records.
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True)
    assert process.stdout is not None
    for line in process.stdout:
        if line.startswith("recording to"):
            return process
    raise TrialFailed(f"the recorder did not start (exit code {process.wait()})")


def _stop_recorder(process: subprocess.Popen[str]) -> int:
    process.send_signal(signal.SIGINT)
    try:
        process.communicate(timeout=30)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
    return process.returncode


def _last_line(process: subprocess.Popen[str]) -> str:
    """The last thing a process that has ended said."""
    assert process.stdout is not None
    return (process.stdout.read().strip().splitlines() or [f"exit code {process.returncode}"])[-1]


def _set_aside_torn(bag: Path) -> None:
    """Keep what an interrupted run left behind, out of the way of the new one."""
    if bag.exists():
        number = 1
        while (kept := bag.with_name(f"{bag.name}.interrupted{number}")).exists():
            number += 1
        bag.rename(kept)


_FRAMES = {topics.DORSAL_IMAGE, topics.LATERAL_IMAGE}
_ENCODED = {topics.DORSAL_JPEG, topics.LATERAL_JPEG}
"""Written by the recorder itself, from the frames."""
