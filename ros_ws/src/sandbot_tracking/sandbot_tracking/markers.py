"""One frame to marker centres with covariance. Input: mono8 (height, width); output: pixels.

``detect`` looks at the whole frame (search.py) and is for finding markers; ``follow`` looks at small regions around
predictions. Both end in the same estimator (disc.py), which reaches the camera-noise bound: benchmarks/tracking.md.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandbot_common.parameters import parameter
from sandbot_tracking import disc, search
from sandbot_tracking.bed import Picture
from sandbot_tracking.rim import rim_table

Floats = NDArray[np.float64]
Frame = NDArray[np.uint8]


@dataclass(frozen=True)
class Appearance:
    """What a marker looks like."""

    radius_low_px: float = parameter(3.0, unit="px", doc="smallest disc radius", low=1.0, high=100.0)
    radius_high_px: float = parameter(12.0, unit="px", doc="largest disc radius", low=1.0, high=200.0)
    contrast: float = parameter(90.0, unit="grey levels", doc="least contrast with the grains", low=5.0, high=255.0)
    elongation: float = parameter(1.6, doc="largest ratio of its axes, motion blur included", low=1.0, high=10.0)


@dataclass(frozen=True)
class Discs:
    """Discs found in a frame, brightest first."""

    xy_px: Floats
    """Centres, (n, 2)."""
    var_px2: Floats
    """Variances of the centres, (n, 2)."""
    radius_px: Floats
    """Radii from the area, (n,)."""
    contrast: Floats
    """Grey levels above the grains, (n,)."""


NO_BED: Picture = np.empty((0, 0), np.float32)

TILE_PX = 64
"""A tile of the frame has its own level of grains; the largest marker covers a twentieth of it."""


def detect(frame: Frame, looks: Appearance, bed: Picture = NO_BED) -> Discs:
    """Every marker-like disc of a frame: patches of the right size, then size, roundness and contrast of each."""
    tile = max(TILE_PX, round(8 * looks.radius_high_px))
    least, most = np.pi * looks.radius_low_px**2 / 2, 2 * np.pi * looks.radius_high_px**2
    found = search.patches(frame, looks.contrast / 2, tile, max(1, int(looks.radius_low_px)), least, most)
    rows = follow(frame, found[:, :2], np.sqrt(found[:, 2] / np.pi), np.zeros(len(found)), bed)
    table = rows[[is_marker(row, looks) for row in rows]].reshape(-1, 7)
    table = table[np.argsort(-table[:, disc.GREY_STEP])]
    return Discs(table[:, :2], table[:, 2:4], table[:, disc.RADIUS], table[:, disc.GREY_STEP])


def is_marker(row: Floats, looks: Appearance) -> bool:
    """Whether what ``locate`` measured looks like a marker (NaN does not)."""
    return bool(
        looks.radius_low_px <= row[disc.RADIUS] <= looks.radius_high_px
        and row[disc.GREY_STEP] >= looks.contrast
        and row[disc.ELONGATION] <= looks.elongation
    )


def locate(frame: Frame, x: float, y: float, radius: float, gate: float) -> Floats:
    """The disc of about ``radius`` within ``gate`` of (x, y): seven numbers, NaN where there is none.

    x, y [px] · their variances [px²] · radius [px] · contrast [grey levels] · elongation (ratio of axes).
    NaN also where the disc touches the frame's edge: a cut disc has no honest centre.
    """
    row: Floats = follow(frame, np.array([[x, y]]), np.array([radius]), np.array([gate]))[0]
    return row


def follow(frame: Frame, places: Floats, radii: Floats, gates: Floats, bed: Picture = NO_BED) -> Floats:
    """``locate`` at each of ``places`` (n, 2): (n, 7). ``bed``: the grains without the markers, NaN where not known."""
    rows: Floats = disc.follow(frame, bed, rim_table(), places, radii, gates)
    return rows
