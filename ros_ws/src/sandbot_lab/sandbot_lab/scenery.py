"""What makes the picture recognisable to people, but is not needed by the tracker: legs, surface, footprints, a scale.

All of it is as dim as the grains' glints or darker than the body, and none of it touches a marker's rim; it draws no
random numbers, so that the noise of a frame is the same without it.
"""

import cv2
import numpy as np

from sandbot_common.arrays import Floats, Frame
from sandbot_common.robot import Robot
from sandbot_lab.calibration import Calibration
from sandbot_lab.drawing import draw_stroke

LEG_GREY, PRINT_GREY, SURFACE_GREY, SCALE_GREY = 98.0, 24.0, 100.0, 108.0
STROKE_PX = 2.0
HUB_PX = 11.0
"""This near its axle a leg is hidden behind the marker's holder, so that the body surrounds the marker."""
_ARC = np.linspace(0.0, 1.0, 28)
"""Points of a leg's arc, as fractions of its length."""
SCALE_M = 0.10
FOOT_ACROSS_M, FOOT_DEPTH_M = 0.020, 0.008
STANCE_M = 0.02
"""How far outside the body's flank the legs turn."""


class Scenery:
    """Draws what surrounds the markers of one camera, ``dorsal`` or ``lateral``."""

    def __init__(self, name: str, camera: Calibration, robot: Robot, body_width_m: float, pedestal: float) -> None:
        """``pedestal``: the grey level that the noise adds."""
        self._dorsal, self._camera, self._robot, self._pedestal = name == "dorsal", camera, robot, pedestal
        # Each leg's place along the body and its flank, from its name (middle by default).
        ahead = [("front" in leg) - 1.0 * ("rear" in leg) for leg in robot.leg_order]
        self._axles_m = 0.5 * robot.axle_distance_m * np.array(ahead)
        flank_m = 0.5 * body_width_m + STANCE_M
        self._sides_m = np.array([-flank_m if "right" in leg else flank_m for leg in robot.leg_order])
        # The lateral camera looks at the right flank.
        self._shown = np.flatnonzero((self._sides_m < 0.0) | self._dorsal)
        self._hub_m = HUB_PX * self._metres_per_pixel()
        self._before: Floats | None = None

    def prepare(self, ground: Frame) -> None:
        """Draw the surface of the grains and a scale bar of 10 cm on the empty picture."""
        rows, columns = ground.shape
        if not self._dorsal:
            edge = self._camera.pixels(np.array([[0.0, self._camera.plane_offset_m, 0.0]]))[0, 1]
            self._stroke(ground, np.arange(0.0, columns), np.full(columns, edge), 0.8, SURFACE_GREY)
        end = columns - 24.0
        u = np.linspace(end - SCALE_M / self._metres_per_pixel(), end, 120)
        v = np.full(u.size, rows - 24.0)
        self._stroke(ground, u, v, 1.0, SCALE_GREY)
        for tick in (u[0], u[-1]):
            self._stroke(ground, np.full(9, tick), np.linspace(v[0] - 4, v[0] + 4, 9), 0.8, SCALE_GREY)
        words = (int(u.mean()) - 18, int(v[0]) - 8)
        cv2.putText(ground, "10 cm", words, cv2.FONT_HERSHEY_SIMPLEX, 0.4, SCALE_GREY - self._pedestal, 1, cv2.LINE_AA)

    def step(self, ground: Frame, x_m: float, z_m: float, legs_rad: Floats) -> None:
        """Draw a footprint where a loaded leg has passed straight below its axle since the last frame."""
        angles = np.mod(legs_rad + self._robot.leg_mount_rad + np.pi, 2 * np.pi) - np.pi
        before, self._before = self._before, angles
        if before is None or z_m <= self._robot.axle_height_m:
            return
        passed = (before < 0.0) & (angles >= 0.0) & (angles - before < np.pi)
        for leg in self._shown[passed[self._shown]]:
            self._print(ground, x_m + float(self._axles_m[leg]), float(self._sides_m[leg]))

    def legs(self, image: Frame, x_m: float, z_m: float, legs_rad: Floats) -> None:
        """Draw the c-legs: in the lateral view those of the near flank, in the dorsal view all of them."""
        angle = (legs_rad[self._shown] + self._robot.leg_mount_rad)[:, None]
        radius = self._robot.leg_radius_m
        # The arc begins at the axle, opposite to the direction of its centre.
        turn = angle + _ARC * (np.pi + self._robot.arc_excess_rad) + np.pi
        x = x_m + self._axles_m[self._shown, None] - radius * (np.sin(angle) + np.sin(turn))
        z = z_m - radius * (np.cos(angle) + np.cos(turn))
        # Grains hide what is below their surface; near its axle a leg is behind the marker's holder.
        seen = (z > 0.0) & (_ARC > 0.0)
        if self._dorsal:
            side = np.broadcast_to(self._sides_m[self._shown, None], x.shape)
        else:
            side = np.full_like(x, self._camera.plane_offset_m)
            seen &= 2 * radius * np.abs(np.sin((turn - angle - np.pi) / 2)) > self._hub_m
        points = self._camera.pixels(np.stack((x, side, z), axis=-1)[seen])
        self._stroke(image, points[:, 0], points[:, 1], STROKE_PX, LEG_GREY)

    def _print(self, ground: Frame, x_m: float, side: float) -> None:
        across = x_m + 0.5 * FOOT_ACROSS_M * np.linspace(-1.0, 1.0, 9)
        if self._dorsal:
            points = self._camera.pixels(self._on_ground(across, side))
        else:
            sunk = -FOOT_DEPTH_M * np.cos(np.linspace(-1.0, 1.0, 9) * np.pi / 2)
            offset = np.full_like(across, self._camera.plane_offset_m)
            points = self._camera.pixels(np.stack((across, offset, sunk), axis=-1))
        self._stroke(ground, points[:, 0], points[:, 1], STROKE_PX, PRINT_GREY)

    def _metres_per_pixel(self) -> float:
        ends = self._camera.pixels(self._on_ground(np.array([0.0, SCALE_M]), self._camera.plane_offset_m))
        return SCALE_M / float(np.hypot(*(ends[1] - ends[0])))

    def _on_ground(self, x_m: Floats, y_m: float) -> Floats:
        return np.stack((x_m, np.full_like(x_m, y_m), np.zeros_like(x_m)), axis=-1)

    def _stroke(self, image: Frame, u: Floats, v: Floats, radius_px: float, grey: float) -> None:
        draw_stroke(image, np.ascontiguousarray(u), np.ascontiguousarray(v), radius_px, grey - self._pedestal)
