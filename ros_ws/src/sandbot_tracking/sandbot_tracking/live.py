"""Live tracking without ROS: samples and period means from frames, leg angles and LED edges in order of arrival.

Each frame is searched for markers as it arrives, converted to the robot's time (camera_clock.py), joined with the other
camera's view (pairing.py) and passed to the tracker. A period's mean waits for the leg angle at its frame's time.
"""

from collections import deque
from collections.abc import Mapping
from heapq import merge

import cv2
import numpy as np

from sandbot_common import health, topics
from sandbot_common.arrays import Floats, Frame
from sandbot_common.robot import SANDBOT, Robot
from sandbot_tracking.calibration import Camera
from sandbot_tracking.camera_clock import NANO, CameraClock
from sandbot_tracking.camera_motion import CameraMotion
from sandbot_tracking.frame_times import FrameTimes
from sandbot_tracking.led import LedEdge
from sandbot_tracking.marker_tracker import Marks
from sandbot_tracking.offline import Axles, OfflineTracker, Sample, check_size
from sandbot_tracking.pairing import Instant, Pairing
from sandbot_tracking.period import PeriodMean, PeriodMeans
from sandbot_tracking.speed import HarmonicSpeed

MAX_HELD = 1000
"""Frames of a camera that may wait for its clock to be known."""
LEG_PATIENCE_NS = NANO // 5
"""How long to wait, after a sample's time, for the leg angle at that time."""
LEGS_KEPT_NS = NANO
"""How long leg angles are kept for an LED edge that is announced after them."""


def warm_up(cameras: Mapping[str, Camera]) -> None:
    """Compile the tracking functions (a second or more, once per machine), so that no frame waits for it."""
    rng = np.random.default_rng(0)
    tracker, speed = LiveTracker(cameras), HarmonicSpeed()
    for n in range(5):
        t_ns = 10_000_000 * n
        tracker.legs(t_ns, np.full(6, 0.2 * n), t_ns)
        for name, camera in tracker.views.items():
            frame = rng.integers(50, 70, camera.shape, dtype=np.uint8)
            for x in np.array((0.4, 0.6)) * camera.shape[1]:
                cv2.circle(frame, (round(x) + n, camera.shape[0] // 2), 7, 240, -1)
            tracker.frame(name, t_ns, frame, t_ns)
        # These discs are no robot, so the filter gets nothing from them.
        speed.update(t_ns / NANO, 0.0, 1e-6, 12.0)


class LiveView:
    """One camera: its clock, its frame times, and the frames waiting for the clock."""

    def __init__(self, camera: Camera) -> None:
        period_s = 1.0 / camera.frame_rate_hz
        self.shape = camera.height, camera.width
        self._rate_hz = camera.frame_rate_hz
        self.motion = CameraMotion(camera.frame_rate_hz)
        self.times = FrameTimes(period_s)
        self.clock = CameraClock(period_s, camera.exposure_s, led=camera.led_region is not None)
        self.unplaced = self.frozen = 0
        """Frames discarded before the clock was known; identical frames in a row."""
        self.held: deque[tuple[int, Marks | Axles]] = deque()
        self._led = LedEdge(camera.led_region) if camera.led_region else None
        self._last: Frame | None = None

    def look(self, t_ns: int, received_ns: int, robot_ns: int | None, pixels: Frame) -> bool:
        """Register a frame; False if it is a repetition, by its stamp or its pixels.

        Two frames of a running camera differ in their noise, even of a robot at rest: identical pixels are an old frame
        that the camera or its driver sends again.
        """
        self.clock.stamped(t_ns, received_ns)
        repeated = self._last is not None and np.array_equal(self._last, pixels)
        self._last = pixels
        if not self.times.add(t_ns, repeated=repeated):
            self.frozen += repeated
            return False
        self.frozen = 0
        lit = self._led is not None and (self._led.update(pixels), self._led.on)[1]
        settings = self.clock.settings
        self.clock.frame(t_ns, received_ns, robot_ns, lit)
        if self.clock.settings > settings:
            # Stamped by the clock as it was: what is found out about it now does not apply to them.
            self.unplaced += len(self.held)
            self.held.clear()
        return True

    def begin_trial(self) -> None:
        """A trial begins: the camera must stay where it stands."""
        self.motion = CameraMotion(self._rate_hz)

    @property
    def figures(self) -> dict[str, object]:
        """Figures of its clock and its frames' stamps, for /diagnostics."""
        clock, times = self.clock, self.times
        known = clock.half_width_ns
        return {
            health.CLOCK: health.UNPLACED if not clock.placed else "as stamped" if known is None else health.BY_THE_LED,
            health.BEHIND_MS: f"{clock.behind_ns * 1e-6:.0f}",
            "clock_offset_ms": f"{clock.offset_ns * 1e-6:.3f}",
            "clock_offset_within_ms": "" if known is None else f"{known * 1e-6:.3f}",
            "jitter_ms": f"{times.jitter_s * 1e3:.3f}",
            health.PERIOD_MS: f"{times.period_s * 1e3:.3f}",
            health.CALIBRATED_MS: f"{times.calibrated_s * 1e3:.3f}",
            health.FRAMES: times.frames,
            "dropped": times.dropped,
            "doubled": times.doubled,
            "repeated": times.repeated,
            "out_of_order": times.late,
            "unplaced": self.unplaced,
            health.LED_EDGES: clock.edges,
            "led_missed": clock.missed,
            "led_unannounced": clock.unannounced,
            health.CLOCK_JUMPS: clock.jumps,
            health.MOVED_PX: f"{self.motion.moved_px:.1f}",
        }

    def hold(self, t_ns: int, seen: Marks | Axles) -> None:
        """Keep a frame's markers until the clock is known; the oldest are dropped beyond MAX_HELD."""
        self.held.append((t_ns, seen))
        if len(self.held) > MAX_HELD:
            self.held.popleft()
            self.unplaced += 1

    def led(self, edge_ns: int) -> None:
        """The sync LED went on at this robot time."""
        if self._led is not None:
            self.clock.led(edge_ns)

    def release(self) -> list[tuple[int, Marks | Axles]]:
        """The held markers, with robot times."""
        ready = [(t_ns + self.clock.offset_ns, seen) for t_ns, seen in self.held]
        self.held.clear()
        return ready


class LiveTracker:
    """Takes frames, leg angles and LED edges as they arrive; returns samples once both views are there, and the means
    of leg periods."""

    def __init__(self, cameras: Mapping[str, Camera], robot: Robot = SANDBOT, tolerance_s: float = 0.0) -> None:
        """``tolerance_s``: largest time [s] between two views of one instant; 0: half a dorsal frame period."""
        self.dimensions = robot
        self._cameras = {name: cameras[name] for name in topics.VIEWS if name in cameras}
        self.views = {name: LiveView(camera) for name, camera in self._cameras.items()}
        tolerance_s = tolerance_s or 0.5 / cameras["dorsal"].frame_rate_hz
        self.pairing: Pairing[Marks | Axles] = Pairing(tuple(self._cameras), round(tolerance_s * NANO))
        self.lost_frames = self.without_legs = 0
        """Views missing at an instant; samples whose leg angle never came."""
        self._legs: deque[tuple[int, Floats]] = deque()
        self._robot: tuple[int, int] | None = None
        self._begin(0)

    @property
    def figures(self) -> dict[str, object]:
        """Figures of the tracking and of each camera, for /diagnostics."""
        values: dict[str, object] = {
            health.LOST_FRAMES: self.lost_frames,
            "late_frames": self.pairing.late,
            "samples_without_legs": self.without_legs,
        }
        for camera, view in self.views.items():
            counts = self.tracker.counts[camera]
            markers = {what: getattr(counts, what) for what in ("missing", "lost", "reacquired", "ambiguous")}
            values |= {health.of_camera(camera, what): value for what, value in (view.figures | markers).items()}
        return values

    @property
    def moved(self) -> str:
        """The cameras that no longer stand where they stood when the trial began; empty if all do."""
        return "; ".join(
            f"{name}: the camera has moved by {view.motion.moved_px:.1f} px; calibrate it, then restart the tracker"
            for name, view in self.views.items()
            if view.motion.moved_px
        )

    def _begin(self, start_ns: int) -> None:
        """Start a trial: the robot has been carried back to the start, so its markers are searched for again."""
        self.tracker = OfflineTracker(self._cameras, self.dimensions, keep=False)
        self._start_ns = start_ns
        self._means = PeriodMeans()
        self._waiting: deque[tuple[int, Sample]] = deque(maxlen=MAX_HELD)
        for t_ns, angles in self._legs:
            if t_ns >= start_ns:
                self.tracker.legs(t_ns * 1e-9, angles)

    def track(self, robot: Robot) -> None:
        """The robot on the trackway from now on."""
        if robot != self.dimensions:
            if robot.leg_order != self.dimensions.leg_order:
                self._legs.clear()
            self.dimensions = robot
            self._begin(self._start_ns)

    def led(self, edge_ns: int) -> list[tuple[int, Sample]]:
        """The sync LED went on at this robot time and a trial starts; returns the samples that waited for it."""
        self._begin(edge_ns)
        for view in self.views.values():
            view.led(edge_ns)
            view.begin_trial()
        return self._placed()

    def legs(self, t_ns: int, angles: Floats, received_ns: int) -> None:
        """Leg angles (legs,) [rad] at a robot time, received at a time of the host's clock."""
        self._robot = t_ns, received_ns
        self._legs.append((t_ns, angles))
        while not 0 <= t_ns - self._legs[0][0] <= LEGS_KEPT_NS:
            self._legs.popleft()
        self.tracker.legs(t_ns * 1e-9, angles)

    def frame(self, camera: str, t_ns: int, pixels: Frame, received_ns: int) -> list[tuple[int, Sample]]:
        """Add one camera's frame (mono8), its stamp and reception time; returns the samples ready, on robot time."""
        view = self.views[camera]
        check_size(pixels, self._cameras[camera], camera)  # first: a camera set to another size gives no frames
        if not view.look(t_ns, received_ns, self._robot_now(received_ns), pixels):
            return []
        if self._walking:
            view.motion.see(pixels)
        tracker = self.tracker
        see = tracker.see_body if camera == "dorsal" else tracker.see_axles
        view.hold(t_ns, see(t_ns / NANO, pixels))
        return self._placed()

    def periods(self, received_ns: int) -> list[PeriodMean]:
        """The leg periods that have ended since the last call; ``received_ns``: the host's clock now."""
        done = []
        now_ns = self._robot_now(received_ns)
        while self._waiting:
            t_ns, sample = self._waiting[0]
            advance = self.tracker.clock.advance_rad(sample.t_s)
            if advance is None:
                if now_ns is None or now_ns - t_ns < LEG_PATIENCE_NS:
                    break
                # The robot no longer reports its legs: use the last angle.
                self.without_legs += 1
                advance = self.tracker.clock.last_rad
            self._waiting.popleft()
            if t_ns >= self._start_ns:
                z = float(sample.front_axle[2] + sample.rear_axle[2]) / 2
                done.append(self._means.update(sample.t_s, float(sample.com[0]), z, advance))
        return [mean for mean in done if mean is not None]

    def _robot_now(self, received_ns: int) -> int | None:
        """The robot's time now, extrapolated from its last message."""
        return None if self._robot is None else self._robot[0] + received_ns - self._robot[1]

    @property
    def _walking(self) -> bool:
        """Whether legs turn in a trial: before and after it, the bed is blown and people reach into the picture."""
        robot = self._robot
        return self._start_ns > 0 and robot is not None and self.tracker.clock.omega_rad_s(robot[0] / NANO) is not None

    def _placed(self) -> list[tuple[int, Sample]]:
        """Samples of all held frames, once the clocks of all running cameras are known."""
        if any(view.held and not view.clock.placed for view in self.views.values()):
            return []
        seen = ([(t_ns, name, marks) for t_ns, marks in view.release()] for name, view in self.views.items())
        # In order of time: otherwise the backlog of one camera would exceed the pairing's wait for the other.
        return [
            self._sample(instant)
            for t_ns, name, marks in merge(*seen, key=lambda item: item[0])
            for instant in self.pairing.add(t_ns, name, marks)
        ]

    def _sample(self, instant: Instant[Marks | Axles]) -> tuple[int, Sample]:
        body, axles = instant.first, None
        if instant.second is not None:
            before, after, weight = instant.second
            assert isinstance(before, Axles)
            assert isinstance(after, Axles)
            axles = before.towards(after, weight)
        assert body is None or isinstance(body, Marks)
        self.lost_frames += (body is None) + (axles is None and "lateral" in self.views)
        sample = self.tracker.sample(instant.t_ns * 1e-9, body, axles)
        self._waiting.append((instant.t_ns, sample))
        return instant.t_ns, sample
