"""One frame to marker centres with covariance. Input: mono8 (height, width); output: pixels.

``detect`` looks at the whole frame and is for finding markers; ``locate`` looks at a small region around a
prediction and is for following them. Both end in the same estimator: a weighted centroid with a soft threshold
half-way between the grains and the disc. The weight is the pixel's coverage by the disc, cut off where noise rules:
below LOW grains weigh nothing, above HIGH the disc's own noise is gone. (On drawn discs of 6–8 px the pair 0.25, 0.9
halves the error of a hard threshold and of the plain centroid; benchmarks/tracking.py.)
"""

from dataclasses import dataclass

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from sandbot_common.parameters import parameter

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


LOW, HIGH = 0.25, 0.9
"""The soft threshold: parts of the contrast at which the weight leaves 0 and reaches 1."""

SAMPLING_PX3 = 9e-4
"""Variance times radius [px² px] of the centroid of a noise-free disc: its rim falls on a finite number of pixels."""

# What _measure returns, in order.
_X, _Y, _VAR_X, _VAR_Y, _RADIUS, _CONTRAST, _ELONGATION = range(7)


def detect(frame: Frame, looks: Appearance) -> Discs:
    """Every marker-like disc of a frame: threshold, connected components, then size, roundness and contrast."""
    grains = float(np.median(frame[::4, ::4]))
    level = min(grains + looks.contrast / 2, 254.0)
    binary = cv2.threshold(frame, level, 255, cv2.THRESH_BINARY)[1]
    _, _, stats, centres = cv2.connectedComponentsWithStatsWithAlgorithm(binary, 8, cv2.CV_32S, cv2.CCL_BBDT)
    least, most = np.pi * looks.radius_low_px**2 / 2, 2 * np.pi * looks.radius_high_px**2
    rows = [
        locate(frame, x, y, np.sqrt(area / np.pi), 0.0)
        for (x, y), area in zip(centres[1:], stats[1:, cv2.CC_STAT_AREA], strict=True)
        if least <= area <= most
    ]
    table = np.array([row for row in rows if is_marker(row, looks)]).reshape(-1, 7)
    table = table[np.argsort(-table[:, _CONTRAST])]
    return Discs(table[:, :2], table[:, 2:4], table[:, _RADIUS], table[:, _CONTRAST])


def is_marker(row: Floats, looks: Appearance) -> bool:
    """Whether what ``locate`` measured looks like a marker (NaN does not)."""
    return bool(
        looks.radius_low_px <= row[_RADIUS] <= looks.radius_high_px
        and row[_CONTRAST] >= looks.contrast
        and row[_ELONGATION] <= looks.elongation
    )


def locate(frame: Frame, x: float, y: float, radius: float, gate: float) -> Floats:
    """The disc of about ``radius`` within ``gate`` of (x, y): seven numbers, NaN where there is none.

    x, y [px] · their variances [px²] · radius [px] · contrast [grey levels] · elongation (ratio of axes).
    NaN also where the disc touches the frame's edge: a cut disc has no honest centre.

    The variance follows each pixel's noise through the centroid, dc/dI_i = w'(x_i − c)/W: on the rim, where w' is
    not 0, camera noise (seen inside the disc) and grain texture (seen around it) by the part of a rim pixel the disc
    leaves uncovered.
    """
    return np.asarray(_locate(frame, float(x), float(y), float(radius), float(gate)))


@numba.njit(cache=True)
def _locate(frame, x, y, radius, gate):  # type: ignore[no-untyped-def]
    height, width = frame.shape
    nothing = np.full(7, np.nan)
    if not (np.isfinite(x) and np.isfinite(y)):
        return nothing
    reach = int(np.ceil(radius + gate + 3.0))
    left, right = max(0, round(x) - reach), min(width, round(x) + reach + 1)
    top, bottom = max(0, round(y) - reach), min(height, round(y) + reach + 1)
    if right - left < 5 or bottom - top < 5:
        return nothing
    bright, dark = _levels(frame, left, right, top, bottom, radius)
    if bright - dark < 10.0:
        return nothing
    # Rough centre over the whole region, then the disc alone: nothing else in the gate weighs in.
    cx, cy, area = _centroid(frame, left, right, top, bottom, x, y, 1e9, dark, bright)
    for _ in range(2):
        if area <= 0.0:
            return nothing
        reach_px = radius + 2.5
        left, right = max(0, int(cx - reach_px)), min(width, int(cx + reach_px) + 2)
        top, bottom = max(0, int(cy - reach_px)), min(height, int(cy + reach_px) + 2)
        cx, cy, area = _centroid(frame, left, right, top, bottom, cx, cy, reach_px, dark, bright)
    if area <= 0.0:
        return nothing
    if cx - radius < 1.0 or cy - radius < 1.0 or cx + radius > width - 2.0 or cy + radius > height - 2.0:
        return nothing
    return _measure(frame, cx, cy, radius)


@numba.njit(cache=True)
def _levels(frame, left, right, top, bottom, radius):  # type: ignore[no-untyped-def]
    """Grey level of the disc and of the grains: mean of the region's brightest pixels, and its median."""
    counts = np.zeros(256, np.int64)
    for row in range(top, bottom):
        for column in range(left, right):
            counts[frame[row, column]] += 1
    total = (right - left) * (bottom - top)
    bright = _mean_of_top(counts, max(4, min(total // 2, int(0.8 * radius * radius))))
    dark = _median(counts, total // 2)
    return bright, dark


@numba.njit(cache=True)
def _mean_of_top(counts, wanted):  # type: ignore[no-untyped-def]
    taken, total = 0, 0.0
    for level in range(255, -1, -1):
        here = min(counts[level], wanted - taken)
        taken += here
        total += here * level
        if taken >= wanted:
            break
    return total / taken


@numba.njit(cache=True)
def _median(counts, rank):  # type: ignore[no-untyped-def]
    seen = 0
    for level in range(256):
        seen += counts[level]
        if seen > rank:
            return float(level)
    return 255.0


@numba.njit(cache=True)
def _centroid(frame, left, right, top, bottom, x0, y0, reach, dark, bright):  # type: ignore[no-untyped-def]
    """Weighted centroid of pixels within ``reach`` of (x0, y0) and the sum of weights."""
    base, scale = dark + LOW * (bright - dark), 1.0 / ((HIGH - LOW) * (bright - dark))
    total = sum_x = sum_y = 0.0
    for row in range(top, bottom):
        for column in range(left, right):
            weight = min((frame[row, column] - base) * scale, 1.0)
            if weight > 0.0 and (column - x0) ** 2 + (row - y0) ** 2 < reach * reach:
                total += weight
                sum_x += weight * column
                sum_y += weight * row
    if total <= 0.0:
        return x0, y0, 0.0
    return sum_x / total, sum_y / total, total


@numba.njit(cache=True)
def _measure(frame, cx, cy, radius):  # type: ignore[no-untyped-def]
    """Levels and noise from inside and around the disc, then the final centroid with its variance."""
    height, width = frame.shape
    reach = radius + 4.0
    left, right = max(0, int(cx - reach)), min(width, int(cx + reach) + 2)
    top, bottom = max(0, int(cy - reach)), min(height, int(cy + reach) + 2)
    n_in = sum_in = square_in = n_out = sum_out = square_out = 0.0
    for row in range(top, bottom):
        for column in range(left, right):
            distance = np.sqrt((column - cx) ** 2 + (row - cy) ** 2)
            value = float(frame[row, column])
            if distance < radius - 1.5:
                n_in, sum_in, square_in = n_in + 1.0, sum_in + value, square_in + value * value
            elif radius + 2.0 < distance < reach:
                n_out, sum_out, square_out = n_out + 1.0, sum_out + value, square_out + value * value
    answer = np.full(7, np.nan)
    if n_in < 4 or n_out < 8:
        return answer
    bright, dark = sum_in / n_in, sum_out / n_out
    contrast = bright - dark
    if contrast < 10.0:
        return answer
    noise = max(square_in / n_in - bright * bright, 0.1)
    grain = max(square_out / n_out - dark * dark - noise, 0.0)

    x, y, total = _centroid(frame, left, right, top, bottom, cx, cy, radius + 2.5, dark, bright)
    slope = 1.0 / (HIGH - LOW) / contrast
    area = var_x = var_y = m_xx = m_yy = m_xy = 0.0
    for row in range(top, bottom):
        for column in range(left, right):
            dx, dy = column - x, row - y
            if dx * dx + dy * dy >= (radius + 2.5) ** 2:
                continue
            cover = min(max((frame[row, column] - dark) / contrast, 0.0), 1.0)
            if cover > 0.15:
                area += cover
                m_xx += cover * dx * dx
                m_yy += cover * dy * dy
                m_xy += cover * dx * dy
            if LOW < cover < HIGH:
                pixel = (noise + (1.0 - cover) ** 2 * grain) * slope * slope
                var_x += pixel * dx * dx
                var_y += pixel * dy * dy
    spread = np.sqrt((m_xx - m_yy) ** 2 + 4.0 * m_xy * m_xy)
    long, short = m_xx + m_yy + spread, m_xx + m_yy - spread
    answer[0], answer[1] = x, y
    sampling = SAMPLING_PX3 / radius
    answer[2], answer[3] = var_x / (total * total) + sampling, var_y / (total * total) + sampling
    answer[4], answer[5] = np.sqrt(area / np.pi), contrast
    answer[6] = np.sqrt(long / short) if short > 0.0 else 1e3
    return answer
