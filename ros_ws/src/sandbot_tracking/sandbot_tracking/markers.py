"""Marker centres with variances [px] from one frame, mono8 (height, width).

``detect`` searches the whole frame (search.py), ``follow`` small regions around predictions. Both use the estimator of
disc.py, which reaches the camera-noise bound: benchmarks/tracking.md.
"""

from dataclasses import dataclass

import numpy as np

from sandbot_common.arrays import Floats, Frame
from sandbot_common.parameters import parameter
from sandbot_tracking import disc, search
from sandbot_tracking.bed import Picture
from sandbot_tracking.rim import rim_table


@dataclass(frozen=True)
class Appearance:
    """Limits of a marker's size, contrast and shape."""

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
"""Smallest size of the tiles whose background level is measured; the largest marker covers a twentieth of a tile."""


def detect(frame: Frame, appearance: Appearance, bed: Picture = NO_BED) -> Discs:
    """Every marker-like disc of a frame: bright patches with the size, roundness and contrast of a marker."""
    low, high = appearance.radius_low_px, appearance.radius_high_px
    tile = max(TILE_PX, round(8 * high))
    found = search.patches(
        frame, appearance.contrast / 2, tile, max(1, int(low)), np.pi * low**2 / 2, 2 * np.pi * high**2
    )
    rows = follow(frame, found[:, :2], np.sqrt(found[:, 2] / np.pi), np.zeros(len(found)), bed)
    table = rows[[is_marker(row, appearance) for row in rows]].reshape(-1, 7)
    table = table[np.argsort(-table[:, disc.GREY_STEP])]
    return Discs(table[:, :2], table[:, 2:4], table[:, disc.RADIUS], table[:, disc.GREY_STEP])


def is_marker(row: Floats, appearance: Appearance) -> bool:
    """Whether a row of ``locate`` looks like a marker (NaN does not)."""
    return bool(
        appearance.radius_low_px <= row[disc.RADIUS] <= appearance.radius_high_px
        and row[disc.GREY_STEP] >= appearance.contrast
        and row[disc.ELONGATION] <= appearance.elongation
    )


def locate(frame: Frame, x: float, y: float, radius: float, gate: float) -> Floats:
    """The disc of about ``radius`` within ``gate`` of (x, y): seven numbers, NaN if there is none.

    x, y [px] · their variances [px²] · radius [px] · contrast [grey levels] · elongation (ratio of axes).
    NaN also if the disc touches the frame's edge: the centre of a cut disc would be biased.
    """
    row: Floats = follow(frame, np.array([[x, y]]), np.array([radius]), np.array([gate]))[0]
    return row


def follow(frame: Frame, places: Floats, radii: Floats, gates: Floats, bed: Picture = NO_BED) -> Floats:
    """``locate`` at each of ``places`` (n, 2): (n, 7). ``bed``: the background without markers, NaN where unknown."""
    rows: Floats = disc.follow(frame, bed, rim_table(), places, radii, gates)
    return rows
