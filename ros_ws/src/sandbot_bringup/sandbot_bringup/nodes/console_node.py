"""The console node: shows all topics on a page of this host, and carries out the operator's commands.

The safety state is based on every message of legs and blower, none dropped. Frames and speeds may get lost: the page
must show the present.
"""

import json
import threading
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from rclpy.client import Client
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from std_srvs.srv import Trigger

from sandbot_bringup.console import Console, Throttle
from sandbot_bringup.console_page import HOST, serve
from sandbot_bringup.console_parameters import ConsoleParameters
from sandbot_bringup.marks import SEEN_BY, Drawn, MarkedView
from sandbot_bringup.nodes.page_lease_node import PageLease
from sandbot_common import messages, topics
from sandbot_common.config import config_file
from sandbot_common.errors import InputError
from sandbot_common.ros import endpoints, node, ros_parameters
from sandbot_common.topics import Topic
from sandbot_tracking.calibration import read_cameras
from sandbot_tracking.pixels import grey

ACTIONS: Mapping[str, str] = {
    "prepare": "/bed/prepare",
    "abort": "/bed/abort",
    "start": "/clock/start",
    "halt": "/clock/stop",
    "pause": "/campaign/pause",
    "go": "/campaign/go",
}
"""What the page's buttons call: std_srvs/Trigger services."""
LEASED = ("prepare", "start")
"""Actions whose effect lasts only while the console is alive and the page that asked is open."""
ENDS_LEASED = ("abort", "halt")
"""Actions that end what is leased, as STOP does."""
STOP: Mapping[str, str] = {"legs": "/clock/stop", "air": "/bed/abort", "campaign": "/campaign/stop"}
"""Services that STOP calls, all at once; each alone is enough to end motion and air of a campaign."""

CALL_S = 5.0
STOP_S, ASK_AGAIN_S, LOOK_S = 3.0, 0.25, 0.01
"""How long STOP waits for rest, after which time it repeats an unanswered call, and how often it checks."""

SHOWN = (
    *(topic for topic in topics.ALL if topic not in {view.jpeg for view in topics.VIEWS.values()}),
    topics.CAMPAIGN_STATUS,
    topics.MODEL_CURVE,
)
_IMAGES = {view.image: name for name, view in topics.VIEWS.items()}
_LANDMARKS = {topic: name for name, topic in topics.LANDMARKS.items()}
_NUMBERS = {
    topics.BED_PHI: "phi",
    topics.SPEED_MEAN: "speed_mean_m_s",
    topics.MODEL_SPEED_MEAN: "model_speed_mean_m_s",
    topics.MODEL_ERROR: "model_error_m_s",
    topics.LIFT: "lift_m",
}
_EXACT = {topics.LEG_STATES, topics.BED_BLOWER, topics.BED_STATUS, topics.DIAGNOSTICS}
"""None of these may be lost. The others are best effort, as a reliable reader on a busy host stalled for 1 to 2 s."""
PICTURES_KEPT = 10
"""Queued frames. The topic's own depth would, on a busy machine, fill up with 60 MB of old frames per camera."""


def delivery(topic: Topic) -> QoSProfile:
    """The QoS with which the console subscribes to a topic."""
    best_effort = not topic.latched and topic not in _EXACT
    return endpoints.qos(topic, best_effort=best_effort, depth=PICTURES_KEPT if topic in _IMAGES else None)


_FIXED = ros_parameters.fixed("the console's parameters are read at the start: restart it to change them")


class ConsoleNode(Node):
    """Messages arrive serialized; only what is shown is decoded, and pictures only as often as they are shown."""

    actions = ACTIONS.keys()

    def __init__(self) -> None:
        super().__init__("console")
        self._settings = ros_parameters.Parameters(self, ConsoleParameters, _FIXED).current
        self._lock = threading.Lock()
        self._stops = 0
        self._state = Console({topic.name: topic.latched for topic in SHOWN})
        self._pictures: dict[str, bytes] = {}
        cameras = read_cameras(self._settings.cameras or config_file("cameras.yaml"))
        self._views = {name: MarkedView(cameras[name], marks) for name, marks in SEEN_BY.items() if name in cameras}
        names = {*ACTIONS.values(), *STOP.values()}
        self._triggers = {name: self.create_client(Trigger, topics.relative(name)) for name in names}
        self._orders = endpoints.publisher(self, topics.CAMPAIGN_COMMAND)
        self._lease = PageLease(self, self._under_way)
        self._closing = threading.Event()
        self._server = serve(self, self._settings.port)
        for topic in SHOWN:
            kind = messages.message_class(topic.type)
            self.create_subscription(kind, topic.relative, self._listener(topic), delivery(topic), raw=True)
        self.get_logger().info(f"console: http://{HOST}:{self._server.port}/")

    def snapshot(self, page: str) -> Mapping[str, Any]:
        """What a page draws (called from the server's threads)."""
        self._lease.seen(page)
        with self._lock:
            return {**self._state.snapshot(time.monotonic()), "explorer_port": self._settings.explorer_port}

    def picture(self, camera: str) -> bytes | None:
        """The latest JPEG of a camera."""
        return self._pictures.get(camera)

    def call(self, action: str, page: str) -> tuple[bool, str]:
        """Call the service of an action and wait for its response (called from the server's threads)."""
        with self._lock:
            self._stops += action in ENDS_LEASED
            stops = self._stops
        if action not in LEASED:
            return self._call(action, ACTIONS[action], stops)
        with self._lease.taken():
            success, message = self._call(action, ACTIONS[action], stops)
            if success:
                self._lease.hold(page)
        return success, message

    def _call(self, action: str, service: str, stops: int) -> tuple[bool, str]:
        client = self._triggers[service]
        if not client.service_is_ready():
            return self._logged(action, False, f"nobody offers {service}")
        answered = threading.Event()
        with self._lock:  # any later stop is sent after this call
            future = client.call_async(Trigger.Request()) if stops == self._stops or action not in LEASED else None
        if future is None:
            return self._logged(action, False, "stopped meanwhile")
        future.add_done_callback(lambda _: answered.set())
        if not answered.wait(CALL_S):
            return self._logged(action, False, f"no answer from {service} within {CALL_S:g} s")
        response = future.result()
        if response.success and "campaign" in service:  # its journal has it
            return True, response.message
        return self._logged(action, response.success, response.message)

    def stop(self) -> tuple[bool, str]:
        """End motion and air and hold the campaign; returns whether all was seen at rest, and how soon."""
        begun_s = time.monotonic()
        with self._lock:
            self._stops += 1
        calls = {name: _RepeatedCall(self._triggers[service]) for name, service in STOP.items()}
        answered = at_rest = False
        while not (answered and at_rest) and time.monotonic() - begun_s < STOP_S:
            answered = all([call.poll(time.monotonic()) for call in calls.values()])  # a list: each must be called
            with self._lock:
                at_rest = self._state.safety.at_rest(time.monotonic())
            self._closing.wait(LOOK_S)
        return self._logged("STOP", at_rest, f"{self._what_stopped(begun_s)}; {calls['campaign'].said('the campaign')}")

    def order(self, what: Mapping[str, Any]) -> tuple[bool, str]:
        """Send an order to the campaign (skip, repeat, add) and wait for its answer."""
        if not self.count_subscribers(topics.CAMPAIGN_COMMAND.relative):
            return False, "no campaign is running"
        name = uuid.uuid4().hex
        self._orders.publish(messages.string(json.dumps({**what, "id": name})))
        deadline_s = time.monotonic() + CALL_S
        while time.monotonic() < deadline_s:
            with self._lock:
                answer = self._state.campaign.get("answers", {}).get(name)
            if answer is not None and answer["success"]:
                return True, answer["message"]
            if answer is not None:
                return self._logged(str(what.get("do")), False, answer["message"])
            self._closing.wait(LOOK_S)
        return self._logged(str(what.get("do")), False, f"no answer from the campaign within {CALL_S:g} s")

    def acknowledge(self) -> tuple[bool, str]:
        """The operator has seen that air was on while legs moved."""
        with self._lock:
            self._state.safety.acknowledge()
        return self._logged("acknowledge", True, "seen")

    def close(self) -> None:
        """End pending calls, and the server."""
        self._closing.set()
        self._server.shutdown()

    def _under_way(self) -> bool:
        """Whether legs or air are being commanded."""
        with self._lock:
            return self._state.under_way(time.monotonic())

    def _what_stopped(self, begun_s: float) -> str:
        now_s = time.monotonic()
        with self._lock:
            safety = self._state.safety
            legs, air = safety.legs(now_s), safety.air(now_s)
            rest_s, off_s = safety.rest_s - begun_s, safety.off_s - begun_s
        rest = f"legs at rest after {rest_s:.2f} s" if legs.state == "still" and rest_s > 0 else legs.text
        off = f"air off after {off_s:.2f} s" if air.state == "off" and off_s > 0 else air.text
        return f"{rest}; {off}"

    def _logged(self, action: str, success: bool, message: str) -> tuple[bool, str]:
        with self._lock:
            self._state.note(_now(), "operator", f"{action}: {'' if success else 'REFUSED: '}{message}")
        return success, message

    def _listener(self, topic: Topic) -> Callable[[bytes], None]:
        kind = messages.message_class(topic.type)
        show = self._handler(topic)
        # Frames are decoded only as often as they are shown, all other messages always.
        due = Throttle(1 / self._settings.picture_rate_hz, time.monotonic) if topic in _IMAGES else lambda: True

        def on_message(data: bytes) -> None:
            with self._lock:
                self._state.heard(topic.name, time.monotonic())
            if show is not None and due():
                show(deserialize_message(data, kind))

        return on_message

    def _handler(self, topic: Topic) -> Callable[[Any], None] | None:
        state = self._state
        if topic in _IMAGES:
            return lambda message: self._on_picture(_IMAGES[topic], message)
        if topic in _LANDMARKS:
            return lambda message: self._on_landmark(_LANDMARKS[topic], message)
        changes: dict[Topic, Callable[[Any], None]] = {
            topics.LEG_STATES: lambda message: state.safety.on_legs(message.velocity, time.monotonic()),
            topics.BED_BLOWER: lambda message: state.safety.on_air(message.data, time.monotonic()),
            topics.BED_STATUS: self._on_bed,
            topics.DIAGNOSTICS: self._on_diagnostics,
            topics.TRIAL: lambda message: state.set_trial(message.data),
            topics.CAMPAIGN_STATUS: lambda message: state.set_campaign(message.data, time.monotonic()),
            topics.MODEL_CURVE: lambda message: state.set_curve(message.data),
            topics.SPEED: lambda message: state.measured.add(*_v_x(message)),
            topics.MODEL_SPEED: lambda message: state.predicted.add(*_v_x(message)),
            **{number: self._setter(name) for number, name in _NUMBERS.items()},
        }
        return self._locked(changes[topic]) if topic in changes else None

    def _setter(self, name: str) -> Callable[[Any], None]:
        return lambda message: self._state.values.update({name: message.data})

    def _on_bed(self, message: Any) -> None:
        for status in message.status:
            self._state.set_bed(messages.values_of(status), time.monotonic())

    def _on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            level, before = status.level[0], self._state.nodes.get(status.name)
            if (before.level if before else 0) != level:
                text = ("is ok again", "warns: " + status.message, "error: " + status.message)[min(level, 2)]
                self._state.note(_now(), status.name, text)
            self._state.set_node(status.name, level, status.message, messages.values_of(status), time.monotonic())

    def _locked(self, change: Callable[[Any], object]) -> Callable[[Any], None]:
        def guarded(message: Any) -> None:
            with self._lock:
                change(message)

        return guarded

    def _on_picture(self, camera: str, message: Any) -> None:
        if camera not in self._views:
            return
        try:
            pixels = grey(message)
        except InputError as error:
            self.get_logger().error(f"{camera}: {error}", throttle_duration_sec=5.0)
            return
        self._show(camera, self._views[camera].picture(messages.nanoseconds(message.header.stamp), pixels))

    def _on_landmark(self, name: str, message: Any) -> None:
        point, t_ns = message.point, messages.nanoseconds(message.header.stamp)
        for camera, view in self._views.items():
            if name in view.names:
                self._show(camera, view.landmark(name, t_ns, (point.x, point.y, point.z)))

    def _show(self, camera: str, drawn: Drawn | None) -> None:
        if drawn is None:
            return
        self._pictures[camera] = drawn.jpeg
        with self._lock:
            self._state.new_picture(camera, drawn.seen)


class _RepeatedCall:
    """A Trigger service that is called until it answers; one that nobody offers is not waited for."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._futures: list[Any] = []
        self._next_s = 0.0

    @property
    def response(self) -> Any:
        """Its response, None before there is one."""
        return next((future.result() for future in self._futures if future.done()), None)

    def said(self, who: str) -> str:
        """Its response in words, or that there is none."""
        if (response := self.response) is not None:
            return str(response.message)
        return f"{who} DOES NOT ANSWER" if self._futures else f"{who} is not there"

    def poll(self, now_s: float) -> bool:
        """Call again if due; returns whether there is nothing more to wait for."""
        if self.response is not None or not self._client.service_is_ready():
            return True
        if now_s >= self._next_s:
            self._next_s = now_s + ASK_AGAIN_S
            self._futures.append(self._client.call_async(Trigger.Request()))
        return False


def _v_x(message: Any) -> tuple[float, float]:
    return messages.nanoseconds(message.header.stamp) / 1e9, message.twist.twist.linear.x


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def main(argv: Sequence[str] | None = None) -> int:
    """Serve the console until Ctrl-C."""
    return node.run(ConsoleNode, argv)


if __name__ == "__main__":
    raise SystemExit(main())
