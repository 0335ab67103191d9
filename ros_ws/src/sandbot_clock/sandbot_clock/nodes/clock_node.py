"""The clock node: /leg_setpoints on an absolute-time schedule, started and stopped by services.

Set-points are published only while the clock runs, stamped with their *scheduled* instants. The first has rate 0: a
receiver that missed it has joined in mid-gait, and must not obey. The last has rate 0, too, and holds the legs.
After /clock/stop, /clock/start resumes from the angles held; /clock/home discards them, so that the next start is
t = 0 of the gait (lift the robot: the legs may jump then); so does starting with a robot that was absent before.

The legs stop by themselves, at the angles last sent, and /diagnostics says why, if
- the commander (a campaign) does not renew /operator/lease; a run started by hand needs none, and ends after max_run_s;
- the robot falls silent (/leg_states), if there is one, or one appears where there was none;
- a set-point is late by more than late_s, as when the process was held up; a shorter delay is made up for gradually, as
  from one set-point to the next no leg ever turns further than in ten periods;
- the bed's air is on (/bed/blower > 0), or another node publishes /leg_setpoints: then the clock does not start either.
A start may be older than a /clock/stop that was received before it: for 3 s after one, none is obeyed (``standstill``).
"""

import math
import threading
import time
import traceback
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from rclpy.node import Node
from std_msgs.msg import Float64, String
from std_srvs.srv import Trigger

from sandbot_clock.clock_parameters import ClockParameters
from sandbot_clock.phase_clock import PhaseClock
from sandbot_clock.schedule import NANO, Schedule, keep, missed_warning
from sandbot_common import messages, topics
from sandbot_common.arrays import Floats
from sandbot_common.errors import InputError
from sandbot_common.lease import Lease
from sandbot_common.process import ask_for_real_time
from sandbot_common.robot import SANDBOT, read_robot, robot_of_trial
from sandbot_common.ros import endpoints, node, ros_health, ros_parameters
from sandbot_common.ros.command_node import LEGS, Command, Rivals
from sandbot_common.ros.timer import Timer, watched
from sandbot_common.standstill import RAN

# Long enough to hear whether a bed's air is on before legs move by themselves.
_AUTOSTART_DELAY_S = 1.0
_CATCH_UP = 10
"""The most periods that one set-point makes up for; a tighter limit would change the gait (decision 16)."""
# Real-time priorities of the schedule's thread and of the rest of the process.
_SCHEDULE_PRIORITY, _PRIORITY = 20, 10


class ClockNode(Node):
    """Publishes leg set-points; the schedule runs in a thread of its own (measured: steadier than an rclpy timer)."""

    def __init__(self) -> None:
        super().__init__("clock")
        self._settings = ros_parameters.Parameters(self, ClockParameters, self._check)
        file = self._settings.current.robot
        self._robot_used = read_robot(file) if file else SANDBOT
        self._health = ros_health.Health(self, self._figures, sole=True)
        self._setpoints = endpoints.publisher(self, topics.LEG_SETPOINTS)
        # Best effort matches any driver, and in continuous data a reliable reader would wait for what was lost.
        endpoints.subscription(self, topics.BED_BLOWER, self._on_blower, best_effort=True)
        endpoints.subscription(self, topics.LEG_STATES, self._on_states, raw=True, best_effort=True)
        endpoints.subscription(self, topics.TRIAL, self._on_trial)
        self._rivals = Rivals(self, topics.LEG_SETPOINTS)
        self._command = Command(self, self._settings.current.lease_s, LEGS)
        self._robot, self._robot_there = Lease(self._settings.current.robot_s), False
        self._blower: float | None = None
        self._legs: PhaseClock | None = None  # None: at home in whatever gait the next start has
        self._thread: threading.Thread | None = None
        self._running = False
        self._stopping = threading.Event()
        self._late_ns: deque[int] = deque(maxlen=2000)
        self._published = self._published_before = self._missed = 0
        self._real_time = False
        self._standstill = watched(self)
        self.create_service(Trigger, "clock/start", self._on_start)
        self.create_service(Trigger, "clock/stop", self._on_stop)
        self.create_service(Trigger, "clock/home", self._on_home)
        wanted = self._settings.current.autostart
        self._autostart = Timer(self, _AUTOSTART_DELAY_S, self._start_once) if wanted else None

    @property
    def running(self) -> bool:
        """Whether set-points are being published; false once the last one is sent."""
        return self._running

    def start(self) -> str:
        """Start the schedule; returns why it could not, or an empty string."""
        wanted = self._settings.current
        if reason := self._refusal(wanted):
            return reason
        self.stop()
        self._health.level, self._health.text = 0, "ok"
        self._stopping.clear()
        schedule = Schedule(time.monotonic_ns(), wanted.rate_hz)
        present = bool(self.count_publishers(topics.LEG_STATES.relative))
        if present and not self._robot_there:
            self._legs = None  # no robot holds those angles
        self._robot_there = present
        self._robot = Lease(wanted.robot_s, schedule.start_ns / NANO if present else -math.inf)
        held = self._legs or PhaseClock(wanted.gait_used, wanted.omega_rad_s)
        held = replace(held, tripod=self._robot_used.legs_per_tripod)
        legs, to_ros_ns = self._robot_used.leg_order, self.get_clock().now().nanoseconds - schedule.start_ns
        self._send(schedule.instant(-1) + to_ros_ns, legs, held.at(schedule.start_ns / NANO))
        self._legs = held.started(schedule.start_ns / NANO)
        self._missed, self._published_before = 0, self._published
        self._thread = threading.Thread(target=self._run, args=(schedule, to_ros_ns, legs), name="clock", daemon=True)
        self._running = True
        self._thread.start()
        self._health.publish()
        return ""

    def _refusal(self, wanted: ClockParameters) -> str:
        if self.running:
            return "the clock is running already"
        if self._air_on:
            return f"the bed's air is on (/bed/blower is {self._blower:g}); legs move only when it is 0"
        if unheard := endpoints.unheard(self, topics.BED_BLOWER):
            return f"whether the bed's air is on is not known: {unheard}"
        if rivals := self._rivals.fault():
            return f"{rivals}; one commander at a time"
        return self._command.begin(wanted.lease_s)

    def stop(self) -> None:
        """Stop, and return when the last set-point (rate 0) is out."""
        if self._thread is not None:
            self._stopping.set()
            self._thread.join()
            self._thread = None

    def close(self) -> None:
        """Hold the legs before the node ends."""
        self.stop()

    def _run(self, schedule: Schedule, to_ros_ns: int, legs: Sequence[str]) -> None:
        """Publish until stopped; a fault holds the legs where the last set-point left them."""
        most_ns = math.ceil(_CATCH_UP * NANO / schedule.rate_hz)
        last_ns, lost_ns, fault, skipped = schedule.start_ns, 0, "", 0

        def duty(instant_ns: int) -> bool:
            nonlocal last_ns, lost_ns, fault, skipped
            now_ns = time.monotonic_ns()
            self._late_ns.append(now_ns - instant_ns)
            # Skipped instants are late as well: if sending was held up, this instant is only the latest one due.
            first_ns, skipped = instant_ns - round(skipped * NANO / schedule.rate_hz), 0
            fault = self._fault(now_ns, first_ns) or self._overrun(instant_ns - schedule.start_ns)
            moment_ns = now_ns if fault else instant_ns
            # However late this is, the gait's own time advances by a few periods at most; the rest is made up later.
            passed_ns = moment_ns - last_ns
            lost_ns += passed_ns - (0 if fault else min(passed_ns + lost_ns, most_ns))
            last_ns = moment_ns
            stopping = bool(fault) or self._stopping.is_set()
            gait_s = (last_ns - lost_ns) / NANO
            self._legs = clock = self._next(gait_s, stopping)
            self._running = not stopping
            self._send(moment_ns + to_ros_ns, legs, clock.at(gait_s))
            return not stopping

        def skip(count: int) -> None:
            nonlocal skipped
            skipped = count
            self._missed += count

        self._real_time = ask_for_real_time(_SCHEDULE_PRIORITY)
        try:
            keep(schedule, duty, time.monotonic_ns, time.sleep, skip)
        except Exception as error:  # nothing else reports failures in this thread; the robot's own lease holds the legs
            traceback.print_exception(error)
            fault = f"{type(error).__name__}: {error}"
            self._legs = self._legs and self._legs.stopped((last_ns - lost_ns) / NANO)
            self._running = False
        if fault:
            self._health.level, self._health.text = 2, f"stopped: {fault}"
            self._health.publish()
            self.get_logger().error(self._health.text)

    def _send(self, stamp_ns: int, legs: Sequence[str], angles_rates: tuple[Floats, Floats]) -> None:
        self._setpoints.publish(messages.joint_state(stamp_ns, legs, *angles_rates, np.zeros(len(legs))))
        self._published += 1

    def _fault(self, now_ns: int, instant_ns: int) -> str:
        """Why the legs must stop now; an empty string if they may go on."""
        wanted, late_s = self._settings.current, (now_ns - instant_ns) / NANO
        if late_s > wanted.late_s:
            return f"a set-point was late by {late_s:.3g} s: the clock's process was held up"
        if self._air_on:
            return f"the bed's air came on while the legs moved (/bed/blower is {self._blower:g})"
        silent = self._robot.late(now_ns / NANO)
        if self._robot_there and silent:
            return f"the robot was silent for {wanted.robot_s:g} s (/leg_states)"
        if not self._robot_there and not silent:
            return "a robot came while the clock ran (/leg_states)"
        return self._rivals.fault() or self._command.lost()

    def _overrun(self, run_ns: int) -> str:
        longest_s = self._settings.current.max_run_s
        return f"the run was {longest_s:g} s long (max_run_s)" if run_ns / NANO > longest_s else ""

    def _next(self, t_s: float, stopping: bool) -> PhaseClock:
        # Changes take effect at a scheduled instant, in the thread that owns the phase.
        clock, wanted = self._legs, self._settings.current
        assert clock is not None
        if clock.omega_rad_s != wanted.omega_rad_s:
            clock = clock.with_omega(t_s, wanted.omega_rad_s)
        if clock.gait != wanted.gait_used:
            clock = clock.with_gait(t_s, wanted.gait_used)
        return clock.stopped(t_s) if stopping else clock

    @property
    def _air_on(self) -> bool:
        # "not <= 0" so that NaN counts as on.
        return self._blower is not None and not self._blower <= 0

    def _on_blower(self, message: Float64) -> None:
        self._blower = message.data

    def _on_states(self, _: bytes) -> None:
        self._robot.renew(time.monotonic())

    def _on_trial(self, message: String) -> None:
        """Use the leg names of the trial's robot from the next start on."""
        try:
            self._robot_used = robot_of_trial(message.data) or self._robot_used
        except InputError as error:
            self.get_logger().error(str(error))

    def _check(self, new: ClockParameters) -> None:
        if new.robot != self._settings.current.robot:
            raise InputError("clock parameters: robot is fixed when the node starts")
        for name in ("lease_s", "robot_s"):
            if self.running and getattr(new, name) != getattr(self._settings.current, name):
                raise InputError(f"clock parameters: {name} is of the run under way; call /clock/stop first")

    def _start_once(self) -> None:
        self._cancel_autostart()
        if reason := self.start():
            self.get_logger().error(f"autostart: {reason}")

    def _cancel_autostart(self) -> None:
        if self._autostart is not None:
            self._autostart.cancel()

    def _on_start(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self.running:
            response.success, response.message = True, "was running"
            return response
        reason = self._standstill.refusal(time.monotonic()) or self.start()
        longest = f"running, for {self._settings.current.max_run_s:g} s at most (max_run_s)"
        response.success, response.message = not reason, reason or longest
        return response

    def _on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        was_running = self.running
        self._standstill.stop(time.monotonic())
        self._cancel_autostart()
        self.stop()
        response.success, response.message = True, RAN if was_running else "was not running"
        return response

    def _on_home(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self.running:
            response.success, response.message = False, "the clock is running; call /clock/stop first"
            return response
        self._legs = None
        response.success, response.message = True, "the next start is t = 0 of the gait"
        return response

    def _figures(self) -> Mapping[str, object]:
        wanted = self._settings.current
        late_us = np.array(list(self._late_ns), dtype=np.float64) / 1e3
        p99 = float(np.percentile(late_us, 99)) if late_us.size else float("nan")
        if self._health.level < 2:  # a fault takes precedence
            warning = missed_warning(self._missed, self._published - self._published_before)
            self._health.level, self._health.text = (1, warning) if warning else (0, "ok")
        return {
            "running": self.running,
            "gait": wanted.gait,
            "omega_rad_s": wanted.omega_rad_s,
            "rate_hz": wanted.rate_hz,
            "published": self._published,
            "missed_deadlines": self._missed,
            "real_time": self._real_time,
            "late_p99_us": round(p99, 1),
            "bed_blower": "not heard" if self._blower is None else self._blower,
        }


def main(argv: Sequence[str] | None = None) -> int:
    """Run the clock node until Ctrl-C."""
    # For the whole process: a main thread that waits for a CPU while holding the GIL would stop the schedule, too.
    ask_for_real_time(_PRIORITY)
    return node.run(ClockNode, argv)


if __name__ == "__main__":
    raise SystemExit(main())
