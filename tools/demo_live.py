"""demo_live OUT: two trials over the real nodes, /speed while they run, and each bag once more into another tracker.

Trackways run beside each other, each in a namespace of its own: /demo is walked on, /replay_1 and /replay_2 hear its
bags. What they print goes to OUT.log. Where a step does not come to its end, one line says what was missing: exit code
1, or 130 after Ctrl-C.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import IO, Any

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from sandbot_bringup.config import config_folder
from sandbot_bringup.plan import Plan, read_plan, trials_of
from sandbot_common import messages, topics
from sandbot_common.cli import INTERRUPTED
from sandbot_common.dead_ports import fresh_participant_number
from sandbot_common.errors import InputError
from sandbot_common.files import write_text
from sandbot_common.ros.endpoints import subscription
from sandbot_common.ros.node import use_shared_memory
from sandbot_common.stop import Stop, stop_signals
from sandbot_common.yaml_text import dump_yaml
from sandbot_record.bags.reader import Bag
from sandbot_record.trials.from_bags import row_from_bag
from sandbot_record.trials.table import Row
from speed_plot import TOP_M_S, SpeedPlot

PLAN = {
    "name": "demo-live", "seed": 16, "gait": "SGCS", "order": "as_listed", "phi": [0.600, 0.632], "omega_rad_s": [16],
    "replicates": 1, "periods": 8, "images": "video",
    # Shortened, and with longer pulses: a bed of poppy seed takes a quarter of a minute and more.
    "bed": {
        "fluidise_s": 0.7, "ramp_s": 0.3, "settle_s": 0.4, "pulse_on_s": 0.4, "pulse_off_s": 0.2, "average_s": 0.15,
        "tolerance": 0.002,
    },
}  # fmt: skip
CAMPAIGN_S, READY_S, REPLAY_S, END_S = 150.0, 40.0, 60.0, 10.0
"""Longer than a busy machine needs: what has not come by then does not come."""
ATTEMPTS = 4
SAME = 1e-3
"""Speeds are the same within this part: a replay shows the other tracker the same frames, bit for bit."""
PATIENCE_S = (3, 10)
"""So long a replay waits to be found; a busy machine gets a second try."""
TO_TRACKER = (
    topics.TRIAL, topics.BED_PHI, topics.BED_STATUS, topics.SYNC_LED, topics.LEG_STATES, topics.DORSAL_IMAGE,
    topics.LATERAL_IMAGE,
)  # fmt: skip
FROM_TRACKER = (topics.COM, topics.FRONT_AXLE, topics.REAR_AXLE, topics.SPEED, topics.SPEED_MEAN, topics.LIFT)
PATIENT = ("clock.lease_s:=1.0", "clock.robot_s:=1.0", "clock.late_s:=0.25", "lab.legs_lease_s:=1.0")
"""A demonstration may share its machine with anything."""
LOOK_S = 0.05


class LiveFailed(RuntimeError):
    """A step of the live part did not complete."""


def main(out: Path) -> int:
    """Run everything; all started processes are ended in any case."""
    out.parent.mkdir(parents=True, exist_ok=True)
    use_shared_memory(frames=False)
    with stop_signals() as stop, open(f"{out}.log", "w", encoding="utf-8") as log:
        programs = Programs(log, stop)
        try:
            live(out, programs)
        except (LiveFailed, InputError) as failure:
            print(f"demo: the live part did not come to its end: {failure}; see {out}.log", file=sys.stderr)
            return INTERRUPTED if stop.asked else 1
        finally:
            programs.end_all()
    return 0


def live(out: Path, programs: "Programs") -> None:
    """Walk while plotting the speed, then replay and compare."""
    plan_file = Path(f"{out}.yaml")
    write_text(plan_file, dump_yaml(PLAN | {"robot": str(config_folder() / "sgcs_robot.yaml")}))
    plan = read_plan(plan_file)
    nodes = programs.start("ros2", "launch", "sandbot_bringup", "trackway.launch.py", *launch_arguments(plan))
    trials = [trial.trial_id for trial in trials_of(plan)]
    spaces = [f"/replay_{number}" for number in range(1, len(trials) + 1)]
    trackers = [programs.start("ros2", "run", "sandbot_tracking", "tracker", *in_namespace(space)) for space in spaces]
    with Watch("/demo", spaces) as watch:
        walk(plan_file, out, programs, nodes, watch)
        there = "the start of the other trackers"
        programs.until(lambda: watch.all_there or ended(*trackers), READY_S, there, watch.look)
    programs.end(nodes)

    print("\nEach bag is played into another tracker, which sees the frames and nothing of the first one:")
    with ThreadPoolExecutor() as pool:  # a replay lasts as long as its trial did
        for compared in pool.map(
            lambda trial, space: compare(programs, out / "trials" / trial, out / "replayed" / trial, space),
            trials,
            spaces,
        ):
            print(compared, flush=True)


def walk(plan_file: Path, out: Path, programs: "Programs", nodes: "subprocess.Popen[str]", watch: "Watch") -> None:
    """Run the campaign, repeating trials that fail on a busy machine. Raises LiveFailed if it fails repeatedly."""
    command = ("ros2", "run", "sandbot_bringup", "campaign", str(plan_file), "--out", str(out), "--silence", "5")
    for _ in range(ATTEMPTS):
        campaign = programs.start(*command, "--redo", "failed", *in_namespace("/demo"))
        programs.until(lambda: ended(campaign, nodes), CAMPAIGN_S, "the two trials", watch.look)  # noqa: B023
        if campaign.poll() == 0:
            return
        if ended(nodes):
            raise LiveFailed("a node has ended")
    raise LiveFailed("a trial failed again and again; is the machine too busy to render two cameras in real time?")


def launch_arguments(plan: Plan) -> list[str]:
    """Launch arguments for the paper's robot and ground, and the plan's bed protocol."""
    files = {"world": "li09_world.yaml", "robot": "sgcs_robot.yaml"}
    given = [f"{name}:={config_folder() / file}" for name, file in files.items()]
    return ["namespace:=demo", *given, *(f"bed.{name}:={value}" for name, value in plan.bed.items()), *PATIENT]


def ended(*programs: "subprocess.Popen[str]") -> bool:
    """Whether any of these processes has ended."""
    return any(program.poll() is not None for program in programs)


def in_namespace(name: str) -> tuple[str, ...]:
    """ROS arguments that put a node into a namespace."""
    return ("--ros-args", "-r", f"__ns:={name}")


def compare(programs: "Programs", bag: Path, again: Path, space: str) -> str:
    """A line with the speeds measured live and in the replay. Raises LiveFailed if they differ."""
    first = row_from_bag(bag)
    for delay_s in PATIENCE_S:
        second = replayed(programs, bag, again.with_name(f"{again.name}_{delay_s}"), space, delay_s)
        if abs(second.speed_m_s - first.speed_m_s) <= SAME * abs(first.speed_m_s):
            break
    else:
        raise LiveFailed(
            f"the replay of {bag.name} gave {100 * second.speed_m_s:.3f} cm/s for {100 * first.speed_m_s:.3f}: "
            "messages were lost on the way"
        )
    return (
        f"  φ {first.phi:.3f}, ω {first.omega_rad_s:g} rad/s: {100 * first.speed_m_s:.3f} cm/s live, "
        f"{100 * second.speed_m_s:.3f} cm/s replayed: the same"
    )


def replayed(programs: "Programs", bag: Path, again: Path, space: str, delay_s: int) -> Row:
    """Replay a bag to the tracker in a namespace and record its output; returns the result as for any other bag."""
    again.parent.mkdir(exist_ok=True)
    played = [topic.name for topic in TO_TRACKER]
    heard = [topic.name for topic in (*TO_TRACKER, *FROM_TRACKER) if "image" not in topic.name]
    record = programs.start(
        "ros2", "run", "sandbot_record", "record", *heard, "--out", str(again), *in_namespace(space)
    )
    replay = programs.start(
        "ros2", "run", "sandbot_record", "replay", str(bag), "--delay", str(delay_s), "--start",
        f"{standing_s(bag):.1f}", "--topics", *played, *in_namespace(space),
    )  # fmt: skip
    programs.until(lambda: ended(replay), REPLAY_S, "a replay")
    if replay.poll() != 0:
        raise LiveFailed(f"the replay of {bag.name} failed")
    programs.end(record)
    return row_from_bag(again)


def standing_s(bag: Path) -> float:
    """Start of the replay, shortly before the legs start [s after the first message], to skip the bed's preparation."""
    opened = Bag.open(bag)
    led_ns = int(opened.columns(topics.SYNC_LED.name).log_time_ns[0])
    return max((led_ns - opened.start_ns) * 1e-9 - 0.5, 0.0)


class Programs:
    """The started programs, each in its own session, so that all of its processes can be ended."""

    def __init__(self, log: IO[str], stop: Stop) -> None:
        self._log, self._stop = log, stop
        self._running: list[subprocess.Popen[str]] = []

    def start(self, *command: str) -> "subprocess.Popen[str]":
        """Start a program whose output goes to the log."""
        self._running.append(
            subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=self._log, stderr=subprocess.STDOUT, text=True,
                start_new_session=True, env={**os.environ, "PYTHONUNBUFFERED": "1"},
            )
        )  # fmt: skip
        return self._running[-1]

    def until(
        self, done: Callable[[], bool], limit_s: float, what: str, look: Callable[[], None] = lambda: time.sleep(LOOK_S)
    ) -> None:
        """Wait for a condition, polling meanwhile. Raises LiveFailed beyond the limit or on a request to end."""
        end = time.monotonic() + limit_s
        while not done():
            if self._stop.asked:
                raise LiveFailed(f"stopped: {self._stop.why}")
            if time.monotonic() > end:
                raise LiveFailed(f"{what} took longer than {limit_s:g} s")
            look()

    def end(self, program: "subprocess.Popen[str]") -> None:
        """Send Ctrl-C to the program and all it has started, then kill it if necessary."""
        for sign in (signal.SIGINT, signal.SIGKILL):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(program.pid, sign)
            with contextlib.suppress(subprocess.TimeoutExpired):
                program.wait(END_S)
                return

    def end_all(self) -> None:
        """End all programs, the last one first."""
        for program in reversed(self._running):
            if program.poll() is None:
                self.end(program)


class Watch:
    """Listens to /trial and /speed of a trackway, and prints them as a plot; and to the health of other trackers."""

    def __init__(self, namespace: str, others: Sequence[str]) -> None:
        self._namespace, self._silent = namespace, set(others)

    def __enter__(self) -> "Watch":
        # We handle Ctrl-C ourselves, to end the started programs.
        rclpy.init(args=["demo", *in_namespace(self._namespace)], signal_handler_options=SignalHandlerOptions.NO)
        with fresh_participant_number(rclpy.get_default_context().get_domain_id()):
            self._node = Node("demo")
        self._plot = SpeedPlot()
        subscription(self._node, topics.TRIAL, self._on_trial)
        subscription(self._node, topics.SPEED, self._on_speed)
        health = messages.message_class(topics.DIAGNOSTICS.type)
        for space in self._silent:
            heard = partial(self._on_other, space)
            self._node.create_subscription(health, f"{space}{topics.DIAGNOSTICS.name}", heard, 10)
        return self

    def __exit__(self, *_: object) -> None:
        self._print_rest()
        # Not left to the interpreter's exit, at which DDS threads can deadlock as other nodes come and go.
        self._node.destroy_node()
        rclpy.try_shutdown()

    @property
    def all_there(self) -> bool:
        """Whether every other tracker has been heard."""
        return not self._silent

    def look(self) -> None:
        """Process pending messages, at most one of each topic."""
        rclpy.spin_once(self._node, timeout_sec=LOOK_S)

    def _on_trial(self, message: Any) -> None:
        told = json.loads(message.data)
        self._print_rest()
        self._plot = SpeedPlot()
        head = f"φ {told['phi_target']:.3f}, ω {told['omega_rad_s']:g} rad/s"
        top = f"0 to {100 * TOP_M_S:g} cm/s"
        print(f"\n{head}: the bed is prepared (pulses shortened), then /speed, {top}:", flush=True)

    def _on_speed(self, message: Any) -> None:
        stamp_s = messages.nanoseconds(message.header.stamp) * 1e-9
        for line in self._plot.add(stamp_s, message.twist.twist.linear.x):
            print(line, flush=True)

    def _on_other(self, space: str, _: Any) -> None:
        self._silent.discard(space)

    def _print_rest(self) -> None:
        for line in self._plot.rest():
            print(line, flush=True)


if __name__ == "__main__":
    raise SystemExit(main(Path(sys.argv[1])))
