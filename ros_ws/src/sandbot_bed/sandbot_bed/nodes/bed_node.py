"""The bed node: runs the pulse protocol against the blower and the height sensor.

/bed/prepare starts a preparation for the parameter target_phi and returns at once; /bed/status reports its progress and
/bed/volume_fraction (latched) its result. /bed/abort turns the air off, and so does the end of the node; for 3 s after
it none is prepared, as the request may be older than the abort (``standstill``).

Interlock: a preparation is refused while legs are commanded to move or report that they do, and fails if they begin to;
a silent or absent robot does not prevent one. It fails, too, if its commander (a campaign) does not renew
/operator/lease, or if the node itself was held up: air that nobody watches is turned off. And it fails if another node
publishes /bed/blower, or the blower's driver has turned the air off by itself: the bed then had other air than
commanded.
"""

import math
import time
from collections.abc import Mapping, Sequence
from functools import partial

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from sensor_msgs.msg import JointState, Range
from std_srvs.srv import Trigger

from sandbot_bed.bed_parameters import BedParameters
from sandbot_bed.hardware import BedHardware
from sandbot_bed.protocol import Command, PulseProtocol, Stage
from sandbot_bed.status import status_message
from sandbot_common import health, messages, topics
from sandbot_common.errors import InputError
from sandbot_common.legs import at_rest
from sandbot_common.process import real_time_while
from sandbot_common.ros import command_node, endpoints, node, ros_health, ros_parameters
from sandbot_common.ros.timer import Timer
from sandbot_common.standstill import Standstill

PRIORITY = 3
"""Real-time priority while the bed is prepared: a delay of the node longer than the lease ends the preparation."""
_LEGS_STILL_S = 0.2
_STATUS_PERIOD_S = 0.1
# An older reading counts as missing.
_FRESH_S = 0.5


class TopicHardware:
    """The bed behind topics: a driver node or the virtual lab obeys /bed/blower and publishes /bed/height."""

    def __init__(self, ros: Node) -> None:
        self._height_m, self._heard_s = math.nan, -math.inf
        self._blower = endpoints.publisher(ros, topics.BED_BLOWER)
        endpoints.subscription(ros, topics.BED_HEIGHT, self._on_height, best_effort=True)  # as sensors' drivers send

    def set_blower(self, level: float) -> None:
        """Publish /bed/blower."""
        self._blower.publish(messages.float64(level))

    def read_height_m(self) -> float:
        """The latest /bed/height; NaN if it is older than half a second."""
        return self._height_m if time.monotonic() - self._heard_s < _FRESH_S else math.nan

    def _on_height(self, message: Range) -> None:
        self._height_m, self._heard_s = message.range, time.monotonic()


class PublishedHardware:
    """A driver class in this process; what it does and reads is published as well, for the interlock and the bag."""

    def __init__(self, ros: Node, driver: BedHardware, low_m: float, high_m: float) -> None:
        self._ros, self._driver, self._limits_m = ros, driver, (low_m, high_m)
        self._blower = endpoints.publisher(ros, topics.BED_BLOWER)
        self._height = endpoints.publisher(ros, topics.BED_HEIGHT)

    def set_blower(self, level: float) -> None:
        """To the driver and /bed/blower; to the latter even if the driver fails."""
        try:
            self._driver.set_blower(level)
        finally:
            self._blower.publish(messages.float64(level))

    def read_height_m(self) -> float:
        """From the driver, and to /bed/height."""
        height_m = self._driver.read_height_m()
        now_ns = self._ros.get_clock().now().nanoseconds
        self._height.publish(messages.range_(now_ns, height_m, *self._limits_m, topics.FRAME))
        return height_m


class BedNode(Node):
    """Wires the pulse protocol to topics; ``driver`` takes the place of the topic-based hardware."""

    def __init__(self, driver: BedHardware | None = None) -> None:
        super().__init__("bed")
        self._settings = ros_parameters.Parameters(self, BedParameters, self._on_change)
        settings = self._settings.current
        self._protocol = PulseProtocol(settings)
        self._health = ros_health.Health(self, self._figures, sole=True)
        self._rivals = command_node.Rivals(self, topics.BED_BLOWER)
        self._hardware: BedHardware = (
            TopicHardware(self)
            if driver is None
            else PublishedHardware(self, driver, settings.height_low_m, settings.height_high_m)
        )
        self._phi = endpoints.publisher(self, topics.BED_PHI)
        self._status = endpoints.publisher(self, topics.BED_STATUS)
        for topic in (topics.LEG_SETPOINTS, topics.LEG_STATES):
            # Continuous data: a reliable reader would receive nothing until a lost message has been resent.
            endpoints.subscription(self, topic, partial(self._on_legs, topic.name), best_effort=True)
        self._command = command_node.Command(self, settings.lease_s, command_node.AIR)
        # Air stops by driver node, now and when the preparation began.
        self._air_stops: dict[str, str] = {}
        self._air_stops_before: dict[str, str] = {}
        endpoints.subscription(self, topics.DIAGNOSTICS, self._on_diagnostics)
        self._legs_moved_s = self._status_s = -math.inf
        self._motion_topic = ""
        self._step_s = math.inf
        self._standstill = Standstill()
        self._reported = ""
        self.create_service(Trigger, "bed/prepare", self._on_prepare)
        self.create_service(Trigger, "bed/abort", self._on_abort)
        Timer(self, 1 / settings.rate_hz, self._step)

    def close(self) -> None:
        """Air off before the node ends."""
        if not self._health.settled:
            return  # the air may be another bed's; this one has not blown
        try:
            self._obey(self._protocol.abort("the bed node stopped"))
        except OSError as error:  # of a driver's device; the blower's own watchdog remains
            self.get_logger().error(f"the driver did not turn the air off: {error}")

    def _step(self) -> None:
        now_s = time.monotonic()
        if self._protocol.command.stage.busy and (reason := self._fault(now_s)):
            self._protocol.fail(reason)
        self._step_s = now_s
        self._standstill.turn(now_s)
        if not self._health.settled:
            return  # "air off" would reach another bed's blower
        self._obey(self._protocol.step(now_s, self._hardware.read_height_m()))

    def _fault(self, now_s: float) -> str:
        """Why a preparation under way must end; an empty string if it may go on."""
        if self._legs_move:
            return f"legs began to move ({self._motion_topic}) while the bed was being prepared"
        if (late_s := now_s - self._step_s) > self._settings.current.lease_s:
            return f"the bed node was held up for {late_s:.2g} s"
        return self._rivals.fault() or self._air_stopped or self._command.lost()

    @property
    def _air_stopped(self) -> str:
        """That a blower's driver has turned the air off by itself since this preparation began; empty if none has."""
        for name, before in self._air_stops_before.items():
            if self._air_stops[name] != before:
                return f"{name} turned the air off by itself while the bed was being prepared"
        return ""

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            for pair in status.values:
                if pair.key == health.AIR_STOPS:
                    self._air_stops[status.name] = pair.value

    def _obey(self, command: Command) -> None:
        # At every step, also when idle: nodes that start later must learn that the air is off.
        self._hardware.set_blower(command.blower)
        changed = f"{command.stage} {command.reason}" != self._reported
        if changed:
            self._on_new_stage(command)
        if changed or time.monotonic() - self._status_s >= _STATUS_PERIOD_S:
            self._status_s = time.monotonic()
            self._status.publish(status_message(self.get_clock().now().nanoseconds, command))

    def _on_new_stage(self, command: Command) -> None:
        self._reported = f"{command.stage} {command.reason}"
        real_time_while(command.stage.busy, PRIORITY)
        if command.stage is Stage.FAILED:
            self.get_logger().error(f"preparation failed: {command.reason}")
        if command.stage is Stage.READY:
            self._phi.publish(messages.float64(command.phi))

    @property
    def _legs_move(self) -> bool:
        return time.monotonic() - self._legs_moved_s < _LEGS_STILL_S

    def _on_legs(self, topic: str, message: JointState) -> None:
        if not at_rest(message.velocity):
            self._legs_moved_s = time.monotonic()
            self._motion_topic = topic if message.velocity else f"{topic} gives no rates"

    def _on_change(self, settings: BedParameters) -> None:
        if self._protocol.command.stage.busy:
            raise InputError("bed: parameters can't change during a preparation; call /bed/abort first")
        if settings.rate_hz != self._settings.current.rate_hz:
            raise InputError("bed: rate_hz is fixed when the node starts")
        self._protocol.parameters = settings

    def _on_prepare(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        target_phi = self._settings.current.target_phi
        if self._protocol.command.stage.busy:
            # The same target: it can't change during a preparation.
            response.success, response.message = True, f"φ = {target_phi:g} was being prepared"
            return response
        if self._legs_move:
            response.success = False
            response.message = f"legs move ({self._motion_topic}); call /clock/stop first"
            return response
        refusal = self._standstill.refusal(time.monotonic()) or self._rivals.fault()
        if reason := refusal or self._command.begin(self._settings.current.lease_s):
            response.success, response.message = False, reason
            return response
        self._air_stops_before = dict(self._air_stops)
        try:
            self._protocol.prepare(target_phi)
        except InputError as error:
            response.success, response.message = False, str(error)
            return response
        # A delay before now must not fail this preparation; and clients that wait for its end must first see it begin.
        self._step_s = time.monotonic()
        self._step()
        response.success, response.message = True, f"preparing φ = {target_phi:g}"
        return response

    def _on_abort(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        busy = self._protocol.command.stage.busy
        self._standstill.stop(time.monotonic())
        self._obey(self._protocol.abort("aborted by /bed/abort"))
        done, rivals = "aborted" if busy else "nothing to abort", self._rivals.fault()
        response.success, response.message = not rivals, f"{done}, but {rivals}" if rivals else f"{done}, air off"
        return response

    def _figures(self) -> Mapping[str, object]:
        command = self._protocol.command
        why = self._rivals.fault() or (command.reason if command.stage is Stage.FAILED else "")
        self._health.level, self._health.text = (2, why) if why else (0, "ok")
        return {
            "stage": command.stage.value,
            "blower": command.blower,
            "phi": command.phi,
            "tolerance": self._settings.current.tolerance,
            "height_m": command.height_m,
        }


def main(argv: Sequence[str] | None = None) -> int:
    """Run the bed node until Ctrl-C."""
    return node.run(BedNode, argv)


if __name__ == "__main__":
    raise SystemExit(main())
