"""The clock node: /leg_setpoints at an absolute-time schedule, started and stopped by services.

Set-points are published only while the clock runs, stamped with their *scheduled* instants, and once more with rate 0
when it stops: that last one holds the legs. After /clock/stop, /clock/start goes on from the angles held; /clock/home
forgets them, so that the next start is t = 0 of the gait (lift the robot: the legs may jump then).

Interlock: the clock does not start, and stops, while the bed's air is on (/bed/blower > 0).
"""

import os
import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rclpy.node import Node
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from sandbot_clock.gait import PRESETS, Gait
from sandbot_clock.phase_clock import PhaseClock
from sandbot_clock.schedule import NANO, Schedule, keep
from sandbot_common import messages, node, topics
from sandbot_common.parameters import parameter, specs

CUSTOM = "CUSTOM"
# Long enough to hear whether a bed blows before legs move by themselves.
_AUTOSTART_DELAY_S = 1.0
_NO_TORQUE = np.zeros(len(topics.LEGS))


def _of_gait(name: str) -> Any:
    # The gait's own field, bounds and all, as a parameter of the node.
    spec = next(spec for spec in specs(Gait) if spec.name == name)
    default = getattr(PRESETS["SGCS"], name)
    return parameter(default, unit=spec.unit, doc=f"{spec.doc}; of gait CUSTOM", low=spec.low, high=spec.high)


@dataclass(frozen=True)
class ClockParameters:
    """Parameters of the clock node."""

    omega_rad_s: float = parameter(8.0, unit="rad/s", doc="mean leg rate ω; may change while running", low=0, high=60)
    gait: str = parameter("SGCS", doc="clock signal; may change while running", choices=(*PRESETS, CUSTOM))
    theta_s_rad: float = _of_gait("theta_s_rad")
    theta_0_rad: float = _of_gait("theta_0_rad")
    duty: float = _of_gait("duty")
    rate_hz: float = parameter(200.0, unit="Hz", doc="set-points a second, from the next start on", low=20, high=1000)
    autostart: bool = parameter(False, doc="start by itself, one second after the node")

    @property
    def gait_used(self) -> Gait:
        """The preset named, or the three gait parameters where it is CUSTOM."""
        if self.gait == CUSTOM:
            return Gait(self.theta_s_rad, self.theta_0_rad, self.duty)
        return Gait.from_name(self.gait)


class ClockNode(Node):
    """Publishes leg set-points; the schedule runs in a thread of its own (measured: steadier than an rclpy timer)."""

    def __init__(self) -> None:
        super().__init__("clock")
        self._settings = node.Parameters(self, ClockParameters)
        self._setpoints = node.publisher(self, topics.LEG_SETPOINTS)
        node.subscription(self, topics.BED_BLOWER, self._on_blower)
        self._blower: float | None = None
        self._legs: PhaseClock | None = None  # None: at home, whatever the gait will be at the next start
        self._thread: threading.Thread | None = None
        self._stopping = threading.Event()
        self._late_ns: deque[int] = deque(maxlen=2000)
        self._published = self._missed = 0
        self._real_time = False
        self._health = node.Health(self, self._figures)
        self.create_service(Trigger, "/clock/start", self._on_start)
        self.create_service(Trigger, "/clock/stop", self._on_stop)
        self.create_service(Trigger, "/clock/home", self._on_home)
        if self._settings.current.autostart:
            self._autostart = self.create_timer(_AUTOSTART_DELAY_S, self._start_once)

    @property
    def running(self) -> bool:
        """Whether set-points are being published."""
        return self._thread is not None

    def start(self) -> str:
        """Start the schedule; the reason why not, or an empty string."""
        if self.running:
            return "the clock is running already"
        if self._air_on:
            return f"the bed's air is on (/bed/blower is {self._blower:g}); legs move only when it is 0"
        self._health.level, self._health.text = 0, "ok"
        schedule = Schedule(time.monotonic_ns(), self._settings.current.rate_hz)
        to_ros_ns = self.get_clock().now().nanoseconds - schedule.start_ns
        start_s = schedule.start_ns / NANO
        wanted = self._settings.current
        held = self._legs or PhaseClock(wanted.gait_used, wanted.omega_rad_s)
        self._legs = held.started(start_s)
        self._stopping.clear()
        self._thread = threading.Thread(target=self._run, args=(schedule, to_ros_ns), name="clock", daemon=True)
        self._thread.start()
        return ""

    def stop(self) -> None:
        """Stop, and return when the last set-point (rate 0) is out."""
        if self._thread is not None:
            self._stopping.set()
            self._thread.join()
            self._thread = None

    def close(self) -> None:
        """Hold the legs before the node goes."""
        self.stop()

    def _run(self, schedule: Schedule, to_ros_ns: int) -> None:
        def duty(instant_ns: int) -> bool:
            self._late_ns.append(time.monotonic_ns() - instant_ns)
            stopping = self._stopping.is_set()
            self._legs = clock = self._next(instant_ns / NANO, stopping)
            position, velocity = clock.at(instant_ns / NANO)
            stamp_ns = instant_ns + to_ros_ns
            self._setpoints.publish(messages.joint_state(stamp_ns, topics.LEGS, position, velocity, _NO_TORQUE))
            self._published += 1
            return not stopping

        self._real_time = _ask_for_real_time()
        keep(schedule, duty, time.monotonic_ns, time.sleep, self._count_missed)

    def _next(self, t_s: float, stopping: bool) -> PhaseClock:
        # Changes take effect at a scheduled instant, in the thread that owns the phase.
        clock, wanted = self._legs, self._settings.current
        assert clock is not None
        if clock.omega_rad_s != wanted.omega_rad_s:
            clock = clock.with_omega(t_s, wanted.omega_rad_s)
        if clock.gait != wanted.gait_used:
            clock = clock.with_gait(t_s, wanted.gait_used)
        return clock.stopped(t_s) if stopping else clock

    def _count_missed(self, count: int) -> None:
        self._missed += count

    @property
    def _air_on(self) -> bool:
        # "not <= 0" so that NaN counts as on.
        return self._blower is not None and not self._blower <= 0

    def _on_blower(self, message: Float64) -> None:
        self._blower = message.data
        if self._air_on and self.running:
            self.stop()
            self._health.level, self._health.text = 2, "stopped: the bed's air came on while the legs moved"
            self._health.publish()
            self.get_logger().error(self._health.text)

    def _start_once(self) -> None:
        self._autostart.cancel()
        if reason := self.start():
            self.get_logger().error(f"autostart: {reason}")

    def _on_start(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self.running:
            response.success, response.message = True, "was running"
            return response
        reason = self.start()
        response.success, response.message = not reason, reason or "running"
        return response

    def _on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        was_running = self.running
        self.stop()
        response.success, response.message = True, "stopped" if was_running else "was not running"
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
        late_us = np.array(self._late_ns, dtype=np.float64) / 1e3
        p99 = float(np.percentile(late_us, 99)) if late_us.size else float("nan")
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


def _ask_for_real_time() -> bool:
    # For the calling thread only, which sleeps nearly all the time; most users may not, and then it runs as it is.
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(20))
    except (AttributeError, OSError):
        return False
    return True


def main(argv: Sequence[str] | None = None) -> int:
    """Run the clock node until Ctrl-C."""
    return node.run(ClockNode, argv)


if __name__ == "__main__":
    raise SystemExit(main())
