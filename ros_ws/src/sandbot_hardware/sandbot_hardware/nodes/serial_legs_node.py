"""The leg controller on a serial line: /leg_setpoints out, /leg_states and /sync_led in.

Motion is leased here as everywhere: if no set-point arrives for legs_lease_s, the legs are brought to rest, and stay so
until a set-point at rest has been received; this is also the initial state, as a driver may start in the middle of a
gait. The angles of that set-point are not a target: the legs are told to rest at the angles they report. A second
commander also brings them to rest, and nobody's set-points are forwarded while there are two; so does a set-point that
no leg can follow. The controller does the same by itself when the line is silent.

A line too slow for the set-points, or a driver held up, loses old ones; if a set-point is forwarded legs_lease_s later
than it could have been, the legs are brought to rest, as they would otherwise walk on after a stop.
"""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import JointState

from sandbot_common import messages, topics
from sandbot_common.errors import InputError
from sandbot_common.health import LEGS_STOPPED
from sandbot_common.host_clock import HostClock
from sandbot_common.lease import Lease
from sandbot_common.legs import FARTHEST_RAD, by_leg, check_turning
from sandbot_common.robot import SANDBOT, read_robot
from sandbot_common.ros import endpoints, node, ros_health, ros_parameters
from sandbot_common.ros.command_node import Partners, Rivals
from sandbot_common.ros.timer import Timer
from sandbot_hardware import lines
from sandbot_hardware.device_clock import DeviceClock
from sandbot_hardware.lines import Line
from sandbot_hardware.port import Port, fixed
from sandbot_hardware.serial_legs_parameters import SerialLegsParameters

WATCH_S = 0.01
KEPT = 50
"""Queued set-points: a stop waits behind at most this many, and losing older ones is harmless."""
CLOCK = "clock"
"""The commanding node; if it runs on this host, its end is detected at once."""


class SerialLegs(Node):
    """Forwards set-points at once, in the thread that receives them."""

    def __init__(self) -> None:
        super().__init__("serial_legs")
        given = ros_parameters.Parameters(self, SerialLegsParameters, fixed).current
        self._order = (read_robot(given.robot) if given.robot else SANDBOT).leg_order
        self._lease, self._moving, self._lapsed = Lease(given.legs_lease_s), False, True
        self._commanded_ns, self._why = 0, ""
        self._least_ns = 0
        self._commanded: list[float] = []
        self._held: list[float] = []
        self._partners = Partners(self)
        self._rivals = Rivals(self, topics.LEG_SETPOINTS)
        self._device_clock, self._host_clock, self._ahead_ns = DeviceClock(), HostClock(), 0
        self._health = ros_health.Health(self, self._figures, sole=True)
        self._states = endpoints.publisher(self, topics.LEG_STATES)
        self._led = endpoints.publisher(self, topics.SYNC_LED)
        endpoints.subscription(self, topics.LEG_SETPOINTS, self._on_setpoint, depth=KEPT)
        self._sent = self._refused = self._watchdog = self._watchdog_before = 0
        self._port = Port(given.device, given.baud, self._heard, self.get_logger().warning, reports="L")
        Timer(self, WATCH_S, self._watch)

    def close(self) -> None:
        """Legs at rest before the node ends."""
        if self._moving:
            self._rest()
        self._port.close()

    def _on_setpoint(self, message: JointState) -> None:
        self._watch()
        try:
            angles, rates = (values.tolist() for values in by_leg(message, self._order))
        except InputError as error:
            self._refused += 1
            self._stop(str(error))
            return
        t_ns, moving = messages.nanoseconds(message.header.stamp), any(rates)
        if why := self._refusal(t_ns, angles, rates):
            self._refused += 1
            self._stop(why)
            return
        if moving and not self._moving:
            self._partners.begin(CLOCK)
            self._watchdog_before, self._why = self._watchdog, ""
        if not (moving or self._moving):
            # Set-points keep to the wall clock as it was when the walk began; the controller's time is never set.
            self._ahead_ns = self._host_clock.ahead_ns()
        held = self._held if self._lapsed and self._held else angles
        self._held = held
        self._moving, self._lapsed = moving, False
        self._lease.renew(time.monotonic())
        self._commanded_ns, self._commanded = t_ns, angles
        self._sent += self._say(t_ns, held, rates)

    def _refusal(self, t_ns: int, angles: Sequence[float], rates: Sequence[float]) -> str:
        """Why a set-point is not forwarded; an empty string if it is."""
        if why := self._rivals.fault():
            return why
        now_ns, moving = time.monotonic_ns(), any(rates)
        if moving and (self._lapsed or self._lease.late(now_ns * 1e-9)):
            # Nothing resumes by itself: late commands from before a silence must not start the legs.
            return "they are told to move before they have been told to rest"
        # The commander's clock may have any offset: a late set-point is later than others since the last one at rest.
        delay_ns = now_ns - t_ns
        self._least_ns = min(self._least_ns, delay_ns) if moving else delay_ns
        if (late_s := (delay_ns - self._least_ns) * 1e-9) > self._lease.limit_s:
            return f"set-points are forwarded {late_s:.2g} s late"
        if moving or self._moving:
            step_s = np.array([0, max(t_ns - self._commanded_ns, 1)]) * 1e-9
            try:
                check_turning(step_s, np.array([self._commanded, angles]), np.array(rates))
            except InputError as error:
                return str(error)
        return ""

    def _watch(self) -> None:
        if self._moving and (why := self._rivals.fault() or self._lost):
            self._stop(why)

    @property
    def _lost(self) -> str:
        """Why the legs are no longer commanded; an empty string while they are."""
        if self._watchdog != self._watchdog_before:
            return "their controller heard no set-point in time"
        return self._partners.lost(CLOCK, self._lease, "no set-point")

    def _stop(self, why: str) -> None:
        if self._moving or not (self._lapsed and self._why):  # the first reason is the informative one
            self._why = f"{LEGS_STOPPED if self._moving else 'set-point refused: '}{why}"
            self.get_logger().error(self._why)
            self._health.publish()  # a campaign that sees the legs at rest asks why
        self._lapsed = True
        if self._moving:
            self._rest()

    def _rest(self) -> None:
        # The thread that hears them writes _held once they do not move.
        held, self._moving = self._held, False
        # In the commander's time, as the system clock may have been changed since.
        silent_ns = round((time.monotonic() - self._lease.renewed_s) * 1e9)
        self._say(self._commanded_ns + silent_ns, held, [0.0] * len(self._order))

    def _say(self, t_ns: int, angles: Sequence[float], rates: Sequence[float]) -> bool:
        return self._port.write(lines.encode("S", (t_ns - self._ahead_ns) // 1000, *map(float, (*angles, *rates))))

    def _heard(self, line: Line, received_ns: int) -> None:
        if line.kind == "W":
            self._watchdog += 1
            return
        if line.kind not in ("L", "E") or not line.values:
            return
        sent_ns = self._device_clock.host_ns(int(line.values[0]) * 1000, received_ns)
        t_ns = sent_ns + self._host_clock.ahead_ns()
        if line.kind == "E":
            self._led.publish(messages.header(t_ns, "sync_led"))
        elif len(line.values) == 1 + 3 * len(self._order):
            angles, rates, efforts = map(np.asarray, lines.split(line.values[1:], len(self._order)))
            if not self._moving and (np.abs(angles) <= FARTHEST_RAD).all():  # NaN is no place to hold a leg at
                self._held = angles.tolist()
            self._states.publish(messages.joint_state(t_ns, self._order, angles, rates, efforts))

    def _figures(self) -> dict[str, Any]:
        self._health.level, self._health.text = self._port.health
        if not self._health.level and (why := self._why or self._rivals.fault()):
            # A warning: an error would mean that the line is out.
            self._health.level, self._health.text = 1, why
        return {
            "set_points": self._sent,
            "refused": self._refused,
            "damaged": self._port.damaged,
            "opened": self._port.opened,
            "watchdog": self._watchdog,
        }


def main(argv: Sequence[str] | None = None) -> int:
    """Run the driver until Ctrl-C."""
    return node.run(SerialLegs, argv)


if __name__ == "__main__":
    raise SystemExit(main())
