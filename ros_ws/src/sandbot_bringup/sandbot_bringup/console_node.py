"""The console node: hears everything, shows it on a page of this host, and calls the services its buttons name."""

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from std_srvs.srv import Trigger

from sandbot_bringup.console import ACTIONS, Console, Throttle
from sandbot_bringup.console_page import HOST, serve
from sandbot_common import messages, node, topics
from sandbot_common.errors import InputError
from sandbot_common.parameters import parameter
from sandbot_common.topics import Topic
from sandbot_tracking.pixels import grey

CALL_S = 5.0
SHOWN = tuple(topic for topic in topics.ALL if topic not in (topics.DORSAL_JPEG, topics.LATERAL_JPEG))
_CAMERAS = {topics.DORSAL_IMAGE: "dorsal", topics.LATERAL_IMAGE: "lateral"}
_NUMBERS = {
    topics.BED_BLOWER: "blower",
    topics.BED_PHI: "phi",
    topics.SPEED_MEAN: "speed_mean_m_s",
    topics.MODEL_SPEED_MEAN: "model_speed_mean_m_s",
    topics.MODEL_ERROR: "model_error_m_s",
    topics.LIFT: "lift_m",
}


@dataclass(frozen=True)
class ConsoleParameters:
    """The console's settings."""

    port: int = parameter(8060, doc="TCP port of the page on this host; 0: any free one", low=0, high=65535)
    picture_rate_hz: float = parameter(5.0, unit="Hz", doc="pictures a second of each camera", low=0.1, high=25.0)


class ConsoleNode(Node):
    """Messages come serialized; only what is shown is ever decoded, and pictures only as often as they are shown."""

    def __init__(self) -> None:
        super().__init__("console")
        self._settings = node.Parameters(self, ConsoleParameters).current
        self._lock = threading.Lock()
        self._state = Console({topic.name: topic.latched for topic in SHOWN})
        self._pictures: dict[str, bytes] = {}
        self._triggers = {name: self.create_client(Trigger, topics.relative(name)) for name in ACTIONS.values()}
        self._closing = threading.Event()
        self._server = serve(self, self._settings.port, self._closing)
        for topic in SHOWN:
            kind = messages.message_class(topic.type)
            self.create_subscription(kind, topic.relative, self._listener(topic), _watching(topic), raw=True)
        self.get_logger().info(f"console: http://{HOST}:{self._server.port}/")

    def snapshot(self) -> Mapping[str, Any]:
        """What the page draws (called from the server's threads)."""
        with self._lock:
            return self._state.snapshot(time.monotonic())

    def picture(self, camera: str) -> bytes | None:
        """The latest JPEG of a camera."""
        return self._pictures.get(camera)

    def call(self, service: str) -> tuple[bool, str]:
        """Call a Trigger service and wait for its answer (called from the server's threads)."""
        client = self._triggers[service]
        if not client.service_is_ready():
            return False, f"nobody offers {service}"
        answered = threading.Event()
        future = client.call_async(Trigger.Request())
        future.add_done_callback(lambda _: answered.set())
        if not answered.wait(CALL_S):
            return False, f"no answer from {service} within {CALL_S:g} s"
        response = future.result()
        return response.success, response.message

    def close(self) -> None:
        """End the streams and the server."""
        self._closing.set()
        self._server.shutdown()

    def _listener(self, topic: Topic) -> Callable[[bytes], None]:
        kind = messages.message_class(topic.type)
        show = self._shower(topic)
        # The plot wants every speed; a picture or a status only as often as someone can look.
        period_s = 0.0 if topic in (topics.SPEED, topics.MODEL_SPEED) else 1 / self._settings.picture_rate_hz
        due = Throttle(period_s, time.monotonic)

        def on_message(data: bytes) -> None:
            with self._lock:
                self._state.heard(topic.name, time.monotonic())
            if show is not None and (topic.latched or due()):
                show(deserialize_message(data, kind))

        return on_message

    def _shower(self, topic: Topic) -> Callable[[Any], None] | None:
        state = self._state
        if topic in _CAMERAS:
            return lambda message: self._show_picture(_CAMERAS[topic], message)
        if topic in _NUMBERS:
            return self._locked(lambda message: state.values.update({_NUMBERS[topic]: message.data}))
        if topic in (topics.SPEED, topics.MODEL_SPEED):
            series = state.measured if topic is topics.SPEED else state.predicted
            return self._locked(
                lambda message: series.add(
                    messages.nanoseconds(message.header.stamp) / 1e9, message.twist.twist.linear.x
                )
            )
        if topic is topics.BED_STATUS:
            return self._locked(
                lambda message: state.bed.update({p.key: p.value for one in message.status for p in one.values})
            )
        if topic is topics.TRIAL:
            return self._locked(lambda message: state.set_trial(message.data))
        if topic is topics.LEG_STATES:
            return self._locked(lambda message: state.set_legs(message.velocity))
        return None

    def _locked(self, change: Callable[[Any], None]) -> Callable[[Any], None]:
        def guarded(message: Any) -> None:
            with self._lock:
                change(message)

        return guarded

    def _show_picture(self, camera: str, message: Any) -> None:
        try:
            pixels = grey(message)
        except InputError as error:
            self.get_logger().error(f"{camera}: {error}", throttle_duration_sec=5.0)
            return
        good, jpeg = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, 80])
        if good:
            self._pictures[camera] = jpeg.tobytes()
            with self._lock:
                self._state.new_picture(camera)


def _watching(topic: Topic) -> QoSProfile:
    """As delivered, but a message that got lost is not waited for.

    Measured: a reliable reader of a busy host stood still for 1 to 2 s at a loss; a page must show what is now.
    """
    qos = node.qos(topic)
    if not topic.latched:
        qos.reliability = ReliabilityPolicy.BEST_EFFORT
        qos.depth = min(topic.depth, 50)
    return qos


def main(argv: Sequence[str] | None = None) -> int:
    """Serve the console until Ctrl-C."""
    return node.run(ConsoleNode, argv, parameters=ConsoleParameters)


if __name__ == "__main__":
    raise SystemExit(main())
