"""The virtual lab as a node: leg set-points and blower in; leg states, LED, bed height and both cameras out.

A trial begins when the legs start from rest: the robot is back at the start on virgin ground of the bed's volume
fraction, and the LED flashes. Frames are taken in the robot's time, t0 + k / frame rate. No topic carries the truth.

Legs and air stop by themselves when their commands are late, as with a real driver: a killed or frozen clock or bed
can't stop them. They then stay stopped until they have been told to rest or to be off; legs also until /lab/reset. The
same holds for legs or air with two commanders, which obey neither, and for legs that join in mid-gait, whose first
set-point is of a walk more than a turn on. While legs move or air blows the lab has real-time priority where permitted,
as a real robot needs no CPU to stop. Frames have none while their readers are behind: each waits for the set-points
received before it, and for its readers, so that a machine too slow for two cameras shows them late, but loses none.
"""

import time
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, JointState
from std_msgs.msg import Float64, String
from std_srvs.srv import Trigger

from sandbot_common import health, messages, topics
from sandbot_common.config import config_file
from sandbot_common.errors import InputError
from sandbot_common.lease import Lease
from sandbot_common.legs import by_leg
from sandbot_common.process import ordinary, real_time_while
from sandbot_common.robot import read_robot, robot_of_trial
from sandbot_common.ros import endpoints, node, ros_health, ros_parameters
from sandbot_common.ros.command_node import Partners, Rivals
from sandbot_common.ros.timer import Timer, call_soon
from sandbot_common.ros.window_node import Window
from sandbot_common.yaml_text import read_yaml
from sandbot_lab.bed import LabBed
from sandbot_lab.calibration import Calibration, calibration
from sandbot_lab.cameras import LabCamera, check_cameras
from sandbot_lab.lab_parameters import LabParameters
from sandbot_lab.live_trial import NANO, LiveTrial, warm_up
from sandbot_lab.week import Occasion, trial_seed
from sandbot_lab.world import null_world, read_world

HEIGHT_RATE_HZ = 50.0
IDLE_RATE_HZ = 100.0
WATCH_RATE_HZ = 100.0
SENSOR_RANGE_M = (0.02, 0.5)
A_TURN_RAD = 2 * np.pi
"""If the first set-point is farther on, the walk had begun before: the legs would jump to its present angle."""
CAMERAS = tuple(topics.VIEWS)
PRIORITY = 1
"""Below all nodes that command."""
MAX_UNREAD = 40
"""The most unread frames of both cameras together: a fifth of the memory that readers share with the lab."""
KEEPING_UP = 6
"""With more unread frames the readers are behind, and the lab's priority must not keep them from the CPU."""
CLOCK, BED = "clock", "bed"
"""The nodes that command legs and air; if they run on this host, their end is detected at once."""


class LabNode(Node):
    """Wires bed, robot and cameras to their topics."""

    def __init__(self) -> None:
        super().__init__("lab")
        self._settings = ros_parameters.Parameters(self, LabParameters, self._check)
        current = self._settings.current
        self._ground = read_world(Path(current.world)) if current.world else null_world()
        self._world = self._ground.walked_by(read_robot(current.robot or config_file("robot.yaml")))
        self._sections = self._read_cameras(current.cameras)
        self._info = {name: camera_info(calibration(self._sections[name], name)) for name in CAMERAS}
        warm_up(self._sections)
        self._bed, self._bed_s = LabBed(current.seed), time.monotonic()
        self._trial: LiveTrial | None = None
        self._filming = False
        self._standing = True
        self._held, self._commanded_ns = np.zeros(len(self._order)), 0
        self._legs, self._air = Lease(current.legs_lease_s), Lease(current.air_lease_s)
        self._legs_lapsed: bool | None = None
        """Whether legs stay at rest until told to rest; None before the first set-point."""
        self._air_lapsed, self._blower = False, 0.0
        self._urgent, self._air_stops = False, 0
        self._partners = Partners(self)
        self._rivals, self._blowers = Rivals(self, topics.LEG_SETPOINTS), Rivals(self, topics.BED_BLOWER)
        self._idle = self._idle_cameras()
        self._setpoints = self._refused = self._trials = 0

        self._health = ros_health.Health(self, self._figures, sole=True)
        self._states = endpoints.publisher(self, topics.LEG_STATES)
        self._led = endpoints.publisher(self, topics.SYNC_LED)
        self._height = endpoints.publisher(self, topics.BED_HEIGHT)
        filming = topics.VIEWS if current.images else {}  # a publisher would be a second one beside another camera
        self._images = {name: endpoints.publisher(self, view.image) for name, view in filming.items()}
        self._window = Window(list(self._images.values()), MAX_UNREAD)
        self._infos = {name: endpoints.publisher(self, view.info) for name, view in topics.VIEWS.items()}
        endpoints.subscription(self, topics.LEG_SETPOINTS, self._on_setpoint)
        endpoints.subscription(self, topics.BED_BLOWER, self._on_blower)
        endpoints.subscription(self, topics.TRIAL, self._on_trial)
        self.create_service(Trigger, "lab/reset", self._on_reset)
        Timer(self, 1.0 / HEIGHT_RATE_HZ, self._publish_height)
        Timer(self, 1.0 / WATCH_RATE_HZ, self._watch)
        Timer(self, 1.0 / IDLE_RATE_HZ, self._publish_idle)

    def _check(self, new: LabParameters) -> None:
        fixed = ("world", "cameras", "robot", "seed", "images")
        for name in fixed:
            if getattr(new, name) != getattr(self._settings.current, name):
                raise InputError(f"lab parameters: {name} is fixed when the node starts")
        self._legs.limit_s, self._air.limit_s = new.legs_lease_s, new.air_lease_s

    def _read_cameras(self, path: str) -> dict[str, Any]:
        file = Path(path) if path else config_file("cameras.yaml")
        sections = read_yaml(file)
        check_cameras(sections, str(file))
        return {name: sections[name] for name in CAMERAS}

    @property
    def _order(self) -> tuple[str, ...]:
        """Names of the robot's legs, in order."""
        return self._world.body.leg_order

    def _idle_cameras(self) -> dict[str, LabCamera]:
        seed = self._settings.current.trial_seed
        return {
            name: LabCamera(name, self._sections[name], seed, self._world.body, self._world.film) for name in CAMERAS
        }

    def _now_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _on_trial(self, message: String) -> None:
        try:
            robot = robot_of_trial(message.data)
        except InputError as error:
            self._health.level, self._health.text = 1, str(error)
            return
        if robot is not None:
            self._world = self._ground.walked_by(robot)
            self._idle = self._idle_cameras()

    def _on_setpoint(self, message: JointState) -> None:
        self._setpoints += 1
        self._stop_legs()
        if rivals := self._rivals.fault():
            self._refuse(rivals)
        elif self._obey(message):
            # Renewed after the work, whose duration must not count as the commander's silence.
            self._legs.renew(time.monotonic())

    def _obey(self, message: JointState) -> bool:
        """Obey a set-point, and return whether it was valid: a refused one does not renew the lease."""
        try:
            angles, rates = by_leg(message, self._order)
        except InputError as error:
            self._refuse(str(error))
            return False
        t_ns = messages.nanoseconds(message.header.stamp)
        moving = bool(np.any(rates))
        began_before = moving and self._legs_lapsed is None and np.abs(angles).max() > A_TURN_RAD
        if self._legs_lapsed or began_before:
            # Nothing resumes by itself: late commands from before the silence must not start the legs.
            self._legs_lapsed = moving
            if moving:
                self._refuse("legs are told to move before they have been told to rest")
            return not moving
        self._legs_lapsed = False
        try:
            if moving and self._standing:
                self._begin(t_ns)
            elif self._standing:
                return True  # still at rest: nothing moves, and the last trial has no more frames
            self._standing = not moving
            if self._trial is not None:
                self._advance(self._trial, t_ns, angles, rates)
                self._held, self._commanded_ns = angles, t_ns
        except InputError as error:
            self._refuse(str(error))
            return False
        return True

    def _refuse(self, why: str) -> None:
        self._refused += 1
        if not self._legs_lapsed or self._health.level < 2:  # the reason why the legs stopped takes precedence
            self._health.level, self._health.text = 1, f"set-point refused: {why}"

    def _begin(self, t_ns: int) -> None:
        self._partners.begin(CLOCK)
        current = self._settings.current
        cameras = {name: self._sections[name] for name in CAMERAS} if current.images else {}
        phi = current.phi or self._bed.phi
        seed = current.trial_seed or trial_seed(current.seed, self._trials)
        occasion, scene = Occasion(current.batch_seed, seed, current.progress), current.trial_seed
        self._trial = LiveTrial(self._world, phi, seed, current.start_x, cameras, t_ns, occasion, scene)
        self._trials += 1
        self._health.level, self._health.text = 0, "ok"
        self._led.publish(messages.header(t_ns, "sync_led"))

    def _advance(self, trial: LiveTrial, t_ns: int, angles: Any, rates: Any) -> None:
        state = trial.advance(t_ns, angles, rates)
        legs = state.leg_angle_rad, state.leg_rate_rad_s, state.leg_effort_n_m
        self._states.publish(messages.joint_state(t_ns, self._order, *legs))
        self._film_soon()

    def _film_soon(self) -> None:
        """Have the loop take a frame, if one is due and there is room for it, after all pending messages."""
        if not self._filming and self._behind and self._window.open:
            self._filming = True
            call_soon(self, self._film)

    def _film(self) -> None:
        self._filming = False
        if self._trial is not None and self._behind:
            with ordinary() if self._window.unread > KEEPING_UP else nullcontext():
                for frame in self._trial.take():
                    self._publish_frame(*frame)
                    self._window.sent()
        self._film_soon()

    @property
    def _behind(self) -> bool:
        """Whether frames of the trial are due."""
        return self._trial is not None and self._trial.due

    def _publish_frame(self, name: str, t_ns: int, pixels: Any) -> None:
        info = self._info[name]
        info.header = messages.header(t_ns, topics.optical_frame(name))
        self._images[name].publish(messages.image(t_ns, info.header.frame_id, pixels))
        self._infos[name].publish(info)

    def _watch(self) -> None:
        """Stop what is no longer commanded."""
        self._stop_legs()
        silence = f"nothing on {topics.BED_BLOWER.name}"
        if self._blower > 0 and (why := self._blowers.fault() or self._partners.lost(BED, self._air, silence)):
            self._end_air(why)
        if self._urgent != (commanded := not self._standing or self._blower > 0):
            self._urgent = commanded
            real_time_while(commanded, PRIORITY)
        self._film_soon()  # its readers may have made room

    def _stop_legs(self) -> None:
        if self._standing:
            return
        if why := self._rivals.fault() or self._partners.lost(CLOCK, self._legs, "no set-point"):
            self._legs_lapsed = self._standing = True
            if self._trial is not None:
                # In the commander's time, as its clock may be ahead of ours, and ours may have been changed since.
                silent_ns = max(round((time.monotonic() - self._legs.renewed_s) * NANO), 1)
                self._advance(self._trial, self._commanded_ns + silent_ns, self._held, np.zeros_like(self._held))
            self._alarm(f"{health.LEGS_STOPPED}{why}")

    def _alarm(self, text: str) -> None:
        self._health.level, self._health.text = 2, text
        self._health.publish()
        self.get_logger().error(text)

    def _on_blower(self, message: Float64) -> None:
        if rivals := self._blowers.fault():
            if self._blower > 0:
                self._end_air(rivals)
            self._air_lapsed = True
            return
        if self._air_lapsed and message.data != 0:
            return  # as with the legs: nothing resumes by itself
        self._air_lapsed = False
        if self._blower <= 0 < message.data:
            self._partners.begin(BED)
        try:
            self._blow(message.data)
            self._air.renew(time.monotonic())
        except InputError as error:
            # An invalid level does not renew the lease.
            self._health.level, self._health.text = 1, str(error)
            if self._blower > 0:
                self._end_air(str(error))

    def _end_air(self, why: str) -> None:
        self._air_lapsed = True
        self._air_stops += 1
        self._blow(0.0)
        self._alarm(f"air off: {why}")

    def _blow(self, level: float) -> None:
        self._pass_time()
        self._bed.set_blower(level)
        self._blower = level

    def _pass_time(self) -> None:
        # In monotonic time, however the system clock or simulated time is set.
        before_s, self._bed_s = self._bed_s, time.monotonic()
        self._bed.advance(self._bed_s - before_s)

    def _publish_height(self) -> None:
        self._pass_time()
        if not self._health.settled:
            return  # another lab may be publishing its own bed's height
        self._height.publish(messages.range_(self._now_ns(), self._bed.read_height_m(), *SENSOR_RANGE_M, "bed"))

    def _publish_idle(self) -> None:
        current = self._settings.current
        if not (current.images and current.idle_frames and self._standing and self._health.settled) or self._behind:
            return
        now_ns = self._now_ns()
        with ordinary():
            for name, camera in self._idle.items():
                self._publish_frame(name, now_ns, camera.render(current.start_x, self._world.body.axle_height_m))

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self._standing:
            response.success, response.message = False, "the legs are moving; stop the clock first"
            return response
        self._trial, self._legs_lapsed = None, False
        self._health.level, self._health.text = 0, "ok"
        self._idle = self._idle_cameras()
        response.success, response.message = True, "the robot is at the start, the ground is virgin"
        return response

    def _figures(self) -> dict[str, object]:
        return {
            "legs": "standing" if self._standing else "moving",
            "blower": self._blower,
            health.AIR_STOPS: self._air_stops,
            "trials": self._trials,
            "setpoints": self._setpoints,
            "refused": self._refused,
        }


def camera_info(camera: Calibration) -> CameraInfo:
    """A camera's intrinsics as a message; its header is set when it is sent."""
    matrix = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    return messages.camera_info(0, "", (camera.width, camera.height), matrix, camera.distortion)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node."""
    return node.run(LabNode, argv, frames=True)


if __name__ == "__main__":
    raise SystemExit(main())
