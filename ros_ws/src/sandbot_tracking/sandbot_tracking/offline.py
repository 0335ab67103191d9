"""Landmarks and speed from the frames of both cameras: the common core of the live node, the batch campaign and
track_video."""

from bisect import bisect_left, bisect_right
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sandbot_common.arrays import Floats, Frame
from sandbot_common.errors import InputError
from sandbot_common.robot import SANDBOT, Robot
from sandbot_tracking.calibration import Camera
from sandbot_tracking.marker_tracker import Counts, MarkerTracker, Marks
from sandbot_tracking.speed import HarmonicSpeed

REMEMBERED = 4000
"""Smallest number of leg angles kept: several turns of the slowest gait at 1 kHz."""
UNKNOWN_LIFT_M = 0.01
"""Standard deviation of the lift if no lateral camera measures it."""


@dataclass(frozen=True)
class Sample:
    """One instant. Positions (3,) [m; trackway frame], NaN where a marker is missing; speeds NaN likewise."""

    t_s: float
    com: Floats
    front_axle: Floats
    rear_axle: Floats
    v_x: float
    var_x: float
    v_z: float
    var_z: float


@dataclass(frozen=True)
class Axles:
    """The axles in one lateral frame: front and rear (3,) [m], their mean height [m] and its variance [m²]."""

    front: Floats
    rear: Floats
    z: float
    var_z: float

    def towards(self, later: "Axles", weight: float) -> "Axles":
        """Linear interpolation to a later view with ``weight``; above 1 it extrapolates."""
        if weight == 0.0:
            return self
        here = 1.0 - weight
        return Axles(
            here * self.front + weight * later.front,
            here * self.rear + weight * later.rear,
            here * self.z + weight * later.z,
            here**2 * self.var_z + weight**2 * later.var_z,
        )


_UNSEEN = Axles(np.full(3, np.nan), np.full(3, np.nan), np.nan, np.nan)


@dataclass(frozen=True)
class Landmarks:
    """All instants so far: t_s (n,), positions (n, 3) [m]; NaN in gaps."""

    t_s: Floats
    com: Floats
    front_axle: Floats
    rear_axle: Floats


@dataclass(frozen=True)
class Speed:
    """/speed so far: times, velocities [m/s] and variances [m²/s²], (n,) each; NaN in gaps."""

    t_s: Floats
    v_x: Floats
    var_x: Floats
    v_z: Floats
    var_z: Floats


class LegClock:
    """Leg frequency from leg angles: their mean advance over the last turn, or since the start if that is less."""

    def __init__(self) -> None:
        self._t: list[float] = []
        self._advance: list[float] = []
        self._last: Floats | None = None

    def update(self, t_s: float, angle_rad: Floats) -> None:
        """Angles (legs,) [rad] at ``t_s``; wrapped or not."""
        angle = np.asarray(angle_rad, dtype=float)
        if not np.isfinite(angle).all() or (self._t and t_s <= self._t[-1]):
            return
        step = 0.0 if self._last is None else float(np.mean((angle - self._last + np.pi) % (2 * np.pi) - np.pi))
        self._last = angle
        self._t.append(t_s)
        self._advance.append((self._advance[-1] if self._advance else 0.0) + step)
        if len(self._t) > 2 * REMEMBERED:
            # A node runs all day, and only the last turn is needed.
            del self._t[:REMEMBERED], self._advance[:REMEMBERED]

    def advance_rad(self, t_s: float) -> float | None:
        """How far the legs have turned at ``t_s`` since the first angle; None until a later angle arrives."""
        after = bisect_left(self._t, t_s)
        if after == len(self._t):
            return None
        if after == 0 or self._t[after] == t_s:
            return self._advance[after]
        weight = (t_s - self._t[after - 1]) / (self._t[after] - self._t[after - 1])
        return (1 - weight) * self._advance[after - 1] + weight * self._advance[after]

    @property
    def last_rad(self) -> float:
        """How far the legs had turned when the last angle was received."""
        return self._advance[-1] if self._advance else 0.0

    def omega_rad_s(self, t_s: float) -> float | None:
        """Mean rate over the last whole turn up to ``t_s``, or over all angles before it; None while the legs stand."""
        end = bisect_left(self._t, t_s + 1e-9)
        if end < 2:
            return None
        now, then = self._advance[end - 1], max(self._advance[end - 1] - 2 * np.pi, self._advance[0])
        first = bisect_right(self._advance, then, 0, end) - 1
        turned, took = now - self._advance[first], self._t[end - 1] - self._t[first]
        stood = self._advance[end - 1] - self._advance[max(0, end - 11)] < 1e-3
        return None if stood or turned < 0.3 else turned / took


class OfflineTracker:
    """Tracks ``com`` in dorsal frames, ``front_axle`` and ``rear_axle`` in lateral ones.

    The centre-of-mass marker is on the body: its plane is raised by the lift that the lateral camera sees at the same
    instant. If the lateral camera loses the axles, x would be biased, so ``com`` is NaN; without a lateral camera the
    variance includes an unknown lift of UNKNOWN_LIFT_M.
    """

    def __init__(
        self, cameras: Mapping[str, Camera], robot: Robot = SANDBOT, omega_rad_s: float | None = None, keep: bool = True
    ) -> None:
        if "dorsal" not in cameras:
            raise InputError(f"cameras {', '.join(cameras) or 'none'}: a dorsal one is needed")
        self.clock = LegClock()
        self._omega = omega_rad_s
        self._robot = robot
        self._dorsal, self._lateral = cameras["dorsal"], cameras.get("lateral")
        self._body = MarkerTracker(("com",), ignore_px=_led(self._dorsal))
        self._axles: MarkerTracker | None = None
        self._front, self._sideways = 0, False
        self._frame_s: dict[str, float] = {}
        if self._lateral is not None:
            places = self._axle_px(self._lateral)
            # A camera on its side sees the axles one above the other: its frames are tracked transposed.
            self._sideways = bool(np.diff(np.abs(places[1] - places[0])) > 0)
            x = places[:, int(self._sideways)]
            # Names go by increasing image x; the front axle has the larger x on the track.
            self._front = int(x[1] > x[0])
            names = ("rear_axle", "front_axle") if self._front else ("front_axle", "rear_axle")
            ignored = [(y, x, h, w) if self._sideways else (x, y, w, h) for x, y, w, h in _led(self._lateral)]
            self._axles = MarkerTracker(names, abs(float(x[1] - x[0])), ignored)
        self._v_x, self._v_z = HarmonicSpeed(), HarmonicSpeed()
        self._keep = keep
        self._samples: list[Sample] = []

    def _axle_px(self, camera: Camera) -> Floats:
        """Pixels (2, 2) of two points at the distance of the axles, in the middle of the view."""
        middle = camera.to_plane([[camera.width / 2, camera.height / 2]])[0]
        reach = np.array([self._robot.axle_distance_m / 2, 0.0, 0.0])
        return camera.to_pixels([middle - reach, middle + reach])

    @property
    def counts(self) -> dict[str, Counts]:
        """Missing, lost, re-acquired and ambiguous markers, by camera."""
        return {"dorsal": self._body.counts} | ({"lateral": self._axles.counts} if self._axles else {})

    def legs(self, t_s: float, angle_rad: Floats) -> None:
        """Leg angles (legs,) [rad], which give the leg frequency for the speed filter."""
        self.clock.update(t_s, angle_rad)

    def update(self, t_s: float, dorsal_frame: Frame | None, lateral_frame: Frame | None) -> Sample:
        """Add both frames (mono8) of one instant, None for a lost one; returns the new sample."""
        body = None if dorsal_frame is None else self.see_body(t_s, dorsal_frame)
        return self.sample(t_s, body, None if lateral_frame is None else self.see_axles(t_s, lateral_frame))

    def _passed(self, name: str, camera: Camera, t_s: float) -> int:
        """Number of a camera's frame periods since its last frame, at least 1."""
        last_s, self._frame_s[name] = self._frame_s.get(name, t_s), t_s
        return max(round((t_s - last_s) * camera.frame_rate_hz), 1)

    def see_body(self, t_s: float, frame: Frame) -> Marks:
        """The centre-of-mass marker in a dorsal frame; its time may be that of the camera's own clock."""
        check_size(frame, self._dorsal, "dorsal")
        return self._body.update(frame, self._passed("dorsal", self._dorsal, t_s))

    def see_axles(self, t_s: float, frame: Frame) -> Axles:
        """The axles in a lateral frame, with its time likewise; NaN if there is no such camera."""
        if self._axles is None or self._lateral is None:
            return _UNSEEN
        check_size(frame, self._lateral, "lateral")
        passed = self._passed("lateral", self._lateral, t_s)
        marks = self._axles.update(np.ascontiguousarray(frame.T) if self._sideways else frame, passed)
        xy_px, var_px2 = (xy[:, ::-1] if self._sideways else xy for xy in (marks.xy_px, marks.var_px2))
        xyz = self._lateral.to_plane(xy_px)
        front, rear = xyz[self._front], xyz[1 - self._front]
        if not np.isfinite(xyz[:, 2]).all():
            return Axles(front, rear, np.nan, np.nan)
        variance = self._lateral.covariance_m2(xy_px, var_px2)[:, 2, 2]
        return Axles(front, rear, float(xyz[:, 2].mean()), float(variance.sum() / 4))

    def sample(self, t_s: float, body: Marks | None, axles: Axles | None) -> Sample:
        """Add the views of one instant, None for a lost one; returns the new sample."""
        axles = axles or _UNSEEN
        z, var_z = axles.z, axles.var_z
        com, var_x = self._centre(body, z, var_z)
        omega = self._omega if self._omega is not None else self.clock.omega_rad_s(t_s)
        v_x, v_var_x = self._v_x.update(t_s, com[0], var_x, omega)
        v_z, v_var_z = self._v_z.update(t_s, z, var_z, omega)
        sample = Sample(t_s, com, axles.front, axles.rear, v_x, v_var_x, v_z, v_var_z)
        if self._keep:
            self._samples.append(sample)
        return sample

    def _centre(self, marks: Marks | None, z: float, var_z: float) -> tuple[Floats, float]:
        if marks is None:
            return np.full(3, np.nan), np.nan
        if self._lateral is None:
            z, var_z = self._robot.axle_height_m, UNKNOWN_LIFT_M**2
        if not (marks.found[0] and np.isfinite(z)):
            return np.full(3, np.nan), np.nan
        plane = self._dorsal.plane.offset_m + z - self._robot.axle_height_m
        com = self._dorsal.to_plane(marks.xy_px, plane)[0]
        variance = self._dorsal.covariance_m2(marks.xy_px, marks.var_px2, plane)[0, 0, 0]
        parallax = self._dorsal.parallax(marks.xy_px)[0, 0]
        return com, float(variance + parallax**2 * var_z)

    def landmarks(self) -> Landmarks:
        """All landmarks so far."""
        samples = self._samples
        points = [
            np.array([getattr(s, name) for s in samples]).reshape(-1, 3) for name in ("com", "front_axle", "rear_axle")
        ]
        return Landmarks(np.array([s.t_s for s in samples]), *points)

    def speed(self) -> Speed:
        """All speeds so far, as they were published live."""
        return Speed(
            *(np.array([getattr(s, k) for s in self._samples]) for k in ("t_s", "v_x", "var_x", "v_z", "var_z"))
        )


def check_size(frame: Frame, camera: Camera, name: str) -> None:
    """Raise InputError for a frame of another size than calibrated, which would give wrong positions."""
    if frame.shape[:2] != (camera.height, camera.width):
        rows, columns = frame.shape[:2]
        raise InputError(
            f"{name} camera: frames of {columns}x{rows} px, but it is calibrated for {camera.width}x{camera.height}"
        )


def _led(camera: Camera) -> tuple[tuple[int, int, int, int], ...]:
    region = camera.led_region
    return () if region is None else ((region[0], region[1], region[2], region[3]),)
