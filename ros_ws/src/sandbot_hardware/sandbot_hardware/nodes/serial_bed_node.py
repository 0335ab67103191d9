"""The bed on a serial line: /bed/blower out, /bed/height in.

Air is leased: if no /bed/blower arrives for air_lease_s, the air is turned off, and stays off until a /bed/blower of 0
has been received. Of two commanders neither is obeyed. The bed's controller has the same watchdog.
"""

import time
from collections.abc import Sequence
from typing import Any

from rclpy.node import Node
from std_msgs.msg import Float64

from sandbot_common import health, messages, topics
from sandbot_common.host_clock import HostClock
from sandbot_common.lease import Lease
from sandbot_common.ros import endpoints, node, ros_health, ros_parameters
from sandbot_common.ros.command_node import Partners, Rivals
from sandbot_common.ros.timer import Timer
from sandbot_hardware import lines
from sandbot_hardware.lines import Line
from sandbot_hardware.port import Port, fixed
from sandbot_hardware.serial_bed_parameters import SerialBedParameters

WATCH_S = 0.02
BED = "bed"
"""The commanding node; if it runs on this host, its end is detected at once."""


class SerialBed(Node):
    """Forwards the blower level to the device, and the height to ROS."""

    def __init__(self) -> None:
        super().__init__("serial_bed")
        self._given = ros_parameters.Parameters(self, SerialBedParameters, fixed).current
        self._lease, self._level = Lease(self._given.air_lease_s), 0.0
        self._watchdog = self._stops = self._blown_since = 0
        self._partners, self._lapsed = Partners(self), False
        self._rivals = Rivals(self, topics.BED_BLOWER)
        self._health = ros_health.Health(self, self._figures, sole=True)
        self._height = endpoints.publisher(self, topics.BED_HEIGHT)
        endpoints.subscription(self, topics.BED_BLOWER, self._on_blower)
        self._host_clock = HostClock()
        self._port = Port(self._given.device, self._given.baud, self._heard, self.get_logger().warning, reports="H")
        Timer(self, WATCH_S, self._watch)

    def close(self) -> None:
        """Air off before the node ends."""
        self._blow(0.0)
        self._port.close()

    def _on_blower(self, message: Float64) -> None:
        self._lease.renew(time.monotonic())
        # NaN is off.
        level = message.data if 0.0 <= message.data <= 1.0 else 0.0
        rivals = self._rivals.fault()
        if rivals and self._level > 0.0:
            self._end_air(rivals)
        # Nothing resumes by itself: stopped air can come on again only after a level of 0 from a single commander.
        self._lapsed = bool(rivals) or (self._lapsed and level > 0.0)
        if self._level <= 0.0 < level:
            self._partners.begin(BED)
        self._blow(0.0 if self._lapsed else level)

    def _blow(self, level: float) -> None:
        # Every time, changed or not: the controller's watchdog needs it.
        if level > 0.0 >= self._level:
            self._blown_since = self._port.opened
        self._level = level
        self._port.write(lines.encode("B", float(level)))

    def _watch(self) -> None:
        if self._level > 0.0 and (why := self._stopped()):
            self._end_air(why)

    def _end_air(self, why: str) -> None:
        self._lapsed = True
        self._stops += 1
        self._blow(0.0)
        self._health.publish()  # at once: the bed node relies on it
        self.get_logger().error(f"air off: {why}")

    def _stopped(self) -> str:
        """Why the air must stop; an empty string while it may go on."""
        # If the line is lost, the controller turns the air off and can't report it: even if the cable is back by now,
        # the bed had less air than commanded.
        if self._port.trouble or self._port.opened != self._blown_since:
            return self._port.trouble or "the line was lost for a moment"
        return self._rivals.fault() or self._partners.lost(BED, self._lease, f"nothing on {topics.BED_BLOWER.name}")

    def _heard(self, line: Line, received_ns: int) -> None:
        self._watchdog += line.kind == "W"
        if line.kind == "H" and len(line.values) == 1:
            limits_m = self._given.range_low_m, self._given.range_high_m
            t_ns = received_ns + self._host_clock.ahead_ns()
            self._height.publish(messages.range_(t_ns, line.values[0], *limits_m, "bed"))

    def _figures(self) -> dict[str, Any]:
        self._health.level, self._health.text = self._port.health
        if not self._health.level and (rivals := self._rivals.fault()):
            # A warning: an error would mean that the line is out.
            self._health.level, self._health.text = 1, rivals
        return {
            "blower": self._level,
            "damaged": self._port.damaged,
            "opened": self._port.opened,
            "watchdog": self._watchdog,
            health.AIR_STOPS: self._stops + self._watchdog,
        }


def main(argv: Sequence[str] | None = None) -> int:
    """Run the driver until Ctrl-C."""
    return node.run(SerialBed, argv)


if __name__ == "__main__":
    raise SystemExit(main())
