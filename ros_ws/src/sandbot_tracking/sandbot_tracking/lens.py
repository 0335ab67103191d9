"""A camera from what it sees: its lens from a chessboard or from points in space, and from points where it stands."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sandbot_common.errors import InputError
from sandbot_tracking.calibration import Camera
from sandbot_tracking.source import Source

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Lens:
    """Intrinsics: K (3, 3) and the five distortion coefficients."""

    matrix: Floats
    distortion: Floats


def lens_from_chessboard(video: str, pattern: tuple[int, int], square_m: float) -> Lens:
    """Intrinsics from frames that show a chessboard with ``pattern`` inner corners. Raises InputError."""
    board = np.zeros((pattern[0] * pattern[1], 3), np.float32)
    board[:, :2] = np.mgrid[: pattern[0], : pattern[1]].T.reshape(-1, 2) * square_m
    corners: list[Any] = []
    with Source(video) as source:
        for frame in source:
            found, points = cv2.findChessboardCornersSB(frame, pattern)
            if found:
                corners.append(points)
        size = (source.width, source.height)
    if len(corners) < 3:
        raise InputError(
            f"{video}: a {pattern[0]}x{pattern[1]} chessboard is seen in {len(corners)} frames, 3 are needed"
        )
    _, matrix, distortion, *_ = cv2.calibrateCamera([board] * len(corners), corners, size, None, None)
    return Lens(matrix, distortion.ravel()[:5])


def place(pixels: Floats, points_m: Floats, lens: Lens) -> tuple[Floats, Floats]:
    """Camera centre (3,) [m] and rotation (3, 3) from points seen through a known lens. Raises InputError."""
    ok, turn, shift = cv2.solvePnP(points_m, pixels, lens.matrix, lens.distortion, flags=cv2.SOLVEPNP_SQPNP)
    if not ok:
        raise InputError("the points do not determine where the camera stands: spread them over the view")
    turn, shift = cv2.solvePnPRefineLM(points_m, pixels, lens.matrix, lens.distortion, turn, shift)
    rotation = cv2.Rodrigues(turn)[0]
    return -rotation.T @ shift.ravel(), rotation


def lens_from_points(pixels: Floats, points_m: Floats, size: tuple[int, int]) -> Lens:
    """Focal lengths from points in space, the principal point held at the middle and the lens taken as straight."""
    if np.linalg.matrix_rank(points_m - points_m.mean(axis=0), tol=1e-3) < 3:
        raise InputError(
            "all points lie in one plane: give --intrinsics or a chessboard video, or points off the plane"
        )
    focal = 1.5 * max(size)
    start = np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]], float)
    flags = (
        cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_ZERO_TANGENT_DIST
        | cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
    )  # fmt: skip
    _, matrix, *_ = cv2.calibrateCamera(
        [points_m.astype(np.float32)], [pixels.astype(np.float32)], size, start, np.zeros(5), flags=flags
    )
    return Lens(matrix, np.zeros(5))


def entry(
    lens: Lens, position_m: Floats, rotation: Floats, size: tuple[int, int], plane: dict[str, Any]
) -> dict[str, Any]:
    """A cameras.yaml entry as plain numbers."""
    return {
        "width": size[0],
        "height": size[1],
        "fx": float(lens.matrix[0, 0]),
        "fy": float(lens.matrix[1, 1]),
        "cx": float(lens.matrix[0, 2]),
        "cy": float(lens.matrix[1, 2]),
        "distortion": [float(value) for value in lens.distortion],
        "position_m": [float(value) for value in position_m],
        "rotation": [[float(value) for value in row] for row in rotation],
        "plane": plane,
    }


def reprojection_px(camera: Camera, pixels: Floats, points_m: Floats) -> float:
    """Root mean square distance between pixels and projected points [px]."""
    residual = camera.to_pixels(points_m) - pixels
    return float(np.sqrt((residual**2).sum(axis=1).mean()))
