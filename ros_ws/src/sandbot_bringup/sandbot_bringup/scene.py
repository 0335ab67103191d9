"""Bed, robot and marks as shapes for RViz and Foxglove: pure, in metres of the trackway frame.

The robot stands where its marks were tracked, its legs as they were reported; what was not seen is not drawn.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from sandbot_common.arrays import Floats
from sandbot_common.robot import Robot
from sandbot_tracking.calibration import Camera

Colour = tuple[float, float, float, float]
"""Red, green, blue, opacity."""

CUBE, SPHERE, LINE, TEXT = 1, 2, 4, 9
"""Marker.CUBE, SPHERE, LINE_STRIP and TEXT_VIEW_FACING of visualization_msgs."""
SAND: Colour = (0.80, 0.70, 0.50, 1.0)
BLOWN: Colour = (0.45, 0.65, 0.85, 0.6)
BODY: Colour = (0.25, 0.25, 0.28, 0.8)
LEG: Colour = (0.10, 0.10, 0.10, 1.0)
WORDS: Colour = (1.0, 1.0, 1.0, 1.0)
MARKS: Mapping[str, Colour] = {
    "com": (0.90, 0.62, 0.0, 1.0),
    "front_axle": (0.34, 0.71, 0.91, 1.0),
    "rear_axle": (0.80, 0.47, 0.65, 1.0),
}
"""As on the console's pictures: distinguishable for colour-blind people."""
MARK_M, TEXT_M, WIDTH_SHARE = 0.015, 0.04, 0.75
"""Diameter of a mark; height of letters; width of the body as a fraction of the axle distance, as a robot file has no
width of its own."""
BED_FROM_M, BED_TO_M, BED_WIDTH_M = -0.1, 1.3, 0.5
_ARC = np.linspace(0.0, 1.0, 25)


@dataclass(frozen=True)
class Pose:
    """A frame's position, and its rotation as a quaternion (x, y, z, w)."""

    at_m: Floats
    turn: Floats


@dataclass(frozen=True)
class Shape:
    """One marker: ``kind`` as in visualization_msgs/Marker, ``points_m`` (n, 3) of a line."""

    group: str
    kind: int
    colour: Colour
    pose: Pose
    size_m: tuple[float, float, float]
    points_m: Floats = field(default_factory=lambda: np.empty((0, 3)))
    text: str = ""


def quaternion(rotation: ArrayLike) -> Floats:
    """(x, y, z, w) of a rotation matrix (3, 3)."""
    turn: Floats = Rotation.from_matrix(np.asarray(rotation, dtype=float)).as_quat(canonical=True)
    return turn


HERE = Pose(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))
"""The trackway frame itself."""


def camera_pose(camera: Camera) -> Pose:
    """A camera's optical frame (x right, y down, z forward) in the trackway frame."""
    return Pose(np.array(camera.position_m), quaternion(np.transpose(camera.rotation)))


def body_pose(marks_m: Mapping[str, Floats]) -> Pose | None:
    """Midway between the axles, on the track's centre line, nose up by the pitch; None if an axle was not seen."""
    front, rear = (marks_m.get(name, np.full(3, np.nan)) for name in ("front_axle", "rear_axle"))
    if not np.isfinite([front, rear]).all():
        return None
    middle, along = (front + rear) / 2, front - rear
    pitch = np.arctan2(along[2], along[0])
    # The y axis points left, so nose up is a negative turn about it.
    return Pose(np.array([middle[0], 0.0, middle[2]]), np.array([0.0, -np.sin(pitch / 2), 0.0, np.cos(pitch / 2)]))


def marks(marks_m: Mapping[str, Floats]) -> list[Shape]:
    """A ball on each mark that was seen."""
    seen = {name: at for name, at in marks_m.items() if np.isfinite(at).all()}
    return [
        Shape(name, SPHERE, MARKS[name], Pose(at, HERE.turn), (MARK_M, MARK_M, MARK_M)) for name, at in seen.items()
    ]


def bed(robot: Robot, phi: float, *, blows: bool) -> list[Shape]:
    """The ground, whose surface is at z = 0, and its volume fraction as text."""
    centre = np.array([(BED_FROM_M + BED_TO_M) / 2, 0.0, -robot.bed_depth_m / 2])
    size = (BED_TO_M - BED_FROM_M, BED_WIDTH_M, robot.bed_depth_m)
    words = f"φ {phi:.4f}" if np.isfinite(phi) else "φ not known"
    behind = Pose(np.array([centre[0], BED_WIDTH_M / 2 + TEXT_M, TEXT_M]), HERE.turn)
    return [
        Shape("bed", CUBE, BLOWN if blows else SAND, Pose(centre, HERE.turn), size),
        Shape("phi", TEXT, WORDS, behind, (0.0, 0.0, TEXT_M), text=words + ", air on" * blows),
    ]


def robot(dimensions: Robot, pose: Pose, angles_rad: Mapping[str, float]) -> list[Shape]:
    """The body as a box and each reported leg as its arc, in ``pose``."""
    width = WIDTH_SHARE * dimensions.axle_distance_m
    size = (dimensions.axle_distance_m + 2 * dimensions.leg_radius_m, width, 2 * dimensions.axle_height_m)
    thick = (dimensions.leg_width_m / 2, 0.0, 0.0)
    return [
        Shape("body", CUBE, BODY, pose, size),
        *(
            Shape(name, LINE, LEG, pose, thick, leg(dimensions, name, angles_rad[name], width))
            for name in dimensions.leg_order
            if np.isfinite(angles_rad.get(name, np.nan))
        ),
    ]


def leg(dimensions: Robot, name: str, angle_rad: float, width_m: float) -> Floats:
    """A c-leg's arc (n, 3) [m; the body's frame], starting at its hip; at angle 0 its centre is straight below the hip.

    Its place on the body follows from its name: front, middle or rear, left or right.
    """
    ahead_m = 0.5 * dimensions.axle_distance_m * (("front" in name) - ("rear" in name))
    side_m = (0.5 * width_m + dimensions.leg_width_m) * (-1.0 if "right" in name else 1.0)
    centre = angle_rad + dimensions.leg_mount_rad
    turn = centre + np.pi + _ARC * (np.pi + dimensions.arc_excess_rad)
    x = ahead_m - dimensions.leg_radius_m * (np.sin(centre) + np.sin(turn))
    z = -dimensions.leg_radius_m * (np.cos(centre) + np.cos(turn))
    return np.column_stack((x, np.full_like(x, side_m), z))


def scene(
    dimensions: Robot, marks_m: Mapping[str, Floats], angles_rad: Mapping[str, float], phi: float, *, blows: bool
) -> Sequence[Shape]:
    """All shapes visible now. ``marks_m``: com, front_axle, rear_axle, NaN if not seen."""
    pose = body_pose(marks_m)
    walking = robot(dimensions, pose, angles_rad) if pose is not None else []
    return [*bed(dimensions, phi, blows=blows), *walking, *marks(marks_m)]
