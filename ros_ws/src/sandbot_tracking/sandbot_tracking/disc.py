"""Measures one disc at the limit of the camera's noise: levels, then shape, then its rim.

Image model: the disc's grey level A over the background g, I = g + (A - g) c, with c of rim.py. The background is
either uniform on the ring around the disc, or the learnt one (bed.py) scaled to the ring. The residual variance of the
ring beyond the noise inside the disc is called grain: rim pixels are weighted by 1 / (noise + (1 - c)² grain), so a bed
that has changed since it was learnt increases the reported variance.

Starting from the centroid of the bright pixels, Gauss-Newton steps on the rim give the centre; by the disc's symmetry,
errors of A, radius and blur do not shift it. If the rim is not that of a disc (smeared, half hidden), a weighted
centroid with a soft threshold is used instead.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"

import numpy as np

from sandbot_common.compiled import compiled
from sandbot_tracking.rim import BLUR_STEP_PX, BLURS, DIRECTIONS, REACH_PX, STEPS_A_PX

LOW, HIGH = 0.25, 0.9
"""The centroid's soft threshold: fractions of the contrast at which a pixel's weight leaves 0 and reaches 1."""

SAMPLING_PX3 = 9e-4
"""Variance times radius [px² px] of the centroid of a noise-free disc: its rim falls on a finite number of pixels."""

STEPS, SETTLED_PX = 3, 0.05
"""Largest number of Gauss-Newton steps, and the step length [px] at which they stop: the error after a step is about
the square of its length over the rim's width."""
RING_PX = 4.0
"""Width of the ring beyond the rim on which the background is measured."""
MIN_CONTRAST = 10.0
MIN_NOISE = 1.0 / 12.0
"""Variance of rounding to grey levels."""
MIN_GAIN = 9.0
"""Gain in χ² from which the background has a second parameter."""
MAX_SHIFT_PX = 0.5
"""Largest distance of the rim's centre from the centroid."""
MAX_MISFIT = 4.0
"""Mean squared residual of the rim, in units of its expected variance, from which the centroid is used."""

# Columns of a row.
X, Y, VAR_X, VAR_Y, RADIUS, GREY_STEP, ELONGATION = range(7)
# Indices into the result of `_ground`.
LEVEL, CONTRAST = 0, 6


@compiled
def follow(frame, bed, table, places, radii, gates):
    """A row for each of places (n, 2) [px] with its radius and gate (n,) [px]. ``bed``: (0, 0) if unknown."""
    rows = np.empty((places.shape[0], 7))
    for i in range(places.shape[0]):
        _measure(frame, bed, table, places[i, 0], places[i, 1], radii[i], gates[i], rows[i])
    return rows


@compiled
def _measure(frame, bed, table, x, y, radius, gate, row):
    height, width = frame.shape
    row[:] = np.nan
    if not (np.isfinite(x) and np.isfinite(y)):
        return
    reach = int(np.ceil(radius + gate + 3.0))
    left, right = max(0, round(x) - reach), min(width, round(x) + reach + 1)
    top, bottom = max(0, round(y) - reach), min(height, round(y) + reach + 1)
    if right - left < 5 or bottom - top < 5:
        return
    # A rough estimate needs only some of the pixels.
    stride = max(1, min(4, int(0.4 * radius)))
    bright, dark = _levels(frame, left, right, top, bottom, stride, radius)
    if bright - dark < MIN_CONTRAST:
        return
    # First the rough centroid of everything in the gate, then of the disc alone.
    cx, cy, area = _centroid(frame, left, right, top, bottom, stride, x, y, 1e9, dark, bright)
    for _ in range(2):
        if area <= 0.0:
            return
        left, right, top, bottom = _box(frame.shape, cx, cy, radius + 2.5)
        cx, cy, area = _centroid(frame, left, right, top, bottom, stride, cx, cy, radius + 2.5, dark, bright)
    if area <= 0.0:
        return
    if cx - radius < 1.0 or cy - radius < 1.0 or cx + radius > width - 2.0 or cy + radius > height - 2.0:
        return
    _refine(frame, bed, table, cx, cy, radius, row)


@compiled
def _levels(frame, left, right, top, bottom, stride, radius):
    """Grey level of the disc and of the background: mean of the region's brightest pixels, and its median."""
    counts = np.zeros(256, np.int32)
    total = 0
    for r in range(top, bottom, stride):
        for c in range(left, right, stride):
            counts[frame[r, c]] += 1
            total += 1
    bright = _mean_of_top(counts, max(4, min(total // 2, int(0.8 * radius * radius / (stride * stride)))))
    return bright, _median(counts, total // 2)


@compiled
def _mean_of_top(counts, wanted):
    taken, total = 0, 0.0
    for level in range(255, -1, -1):
        here = min(counts[level], wanted - taken)
        taken += here
        total += here * level
        if taken >= wanted:
            break
    return total / taken


@compiled
def _median(counts, rank):
    seen = 0
    for level in range(256):
        seen += counts[level]
        if seen > rank:
            return float(level)
    return 255.0


@compiled
def _centroid(frame, left, right, top, bottom, stride, x0, y0, within, dark, bright):
    """Weighted centroid of pixels within ``within`` of (x0, y0) and the sum of weights."""
    base, scale = dark + LOW * (bright - dark), 1.0 / ((HIGH - LOW) * (bright - dark))
    total = sum_x = sum_y = 0.0
    for r in range(top, bottom, stride):
        for c in range(left, right, stride):
            weight = min((frame[r, c] - base) * scale, 1.0)
            if weight > 0.0 and (c - x0) ** 2 + (r - y0) ** 2 < within * within:
                total += weight
                sum_x += weight * c
                sum_y += weight * r
    if total <= 0.0:
        return x0, y0, 0.0
    return sum_x / total, sum_y / total, total


@compiled
def _refine(frame, bed, table, cx, cy, radius, row):
    """The row of a disc whose centre is known to a fraction of a pixel."""
    brightest = _brightest(bed, cx, cy, radius + RING_PX)
    if np.isnan(brightest):
        bed = bed[:0]
    ground = _ground(frame, bed, cx, cy, radius)
    if brightest > ground[LEVEL] - 0.5 * ground[CONTRAST]:
        # Brighter than any grains: an unnoticed marker was learnt as background.
        bed = bed[:0]
        ground = _ground(frame, bed, cx, cy, radius)
    if ground[CONTRAST] < MIN_CONTRAST:
        return
    x, y, seen, blur, elongation = _shape(frame, bed, ground, cx, cy, radius)
    if seen <= 0.0:
        return
    row[X], row[Y], row[RADIUS], row[GREY_STEP], row[ELONGATION] = x, y, seen, ground[CONTRAST], elongation
    if blur > BLUR_STEP_PX * (BLURS - 1) or not _rim(frame, bed, table, ground, blur, row):
        _soft_centroid(frame, bed, ground, row)


@compiled
def _box(shape, cx, cy, reach):
    left, right = max(0, int(cx - reach)), min(shape[1], int(cx + reach) + 2)
    return left, right, max(0, int(cy - reach)), min(shape[0], int(cy + reach) + 2)


@compiled
def _brightest(bed, cx, cy, reach):
    """The bed's highest level under a disc and its ring; NaN if part of it is unknown."""
    left, right, top, bottom = _box(bed.shape, cx, cy, reach)
    total, brightest = 0.0, np.nan
    for r in range(top, bottom):
        for c in range(left, right):
            total += bed[r, c]
            brightest = bed[r, c] if np.isnan(brightest) else max(brightest, bed[r, c])
    return brightest if np.isfinite(total) else np.nan


@compiled
def _chord(width, x, square):
    """Columns [first, last) within the root of ``square`` of x."""
    half = np.sqrt(max(square, 0.0))
    return max(0, int(x - half) + 1), min(width, int(x + half) + 1)


@compiled(fastmath=True)
def _ground(frame, bed, cx, cy, radius):
    """Disc's grey level, noise variance, α, β, grain variance and its correlation between neighbours, contrast (or 0).

    The background is α + β bed. Noise is the variance inside the disc; grain is the additional variance of the ring.
    """
    _, _, top, bottom = _box(frame.shape, cx, cy, radius + RING_PX)
    width, known = frame.shape[1], bed.shape[0] > 0
    inner, outer, core = (radius + 2.0) ** 2, (radius + RING_PX) ** 2, max(radius - 1.5, 1.0) ** 2
    n_in = sum_in = square_in = n = v = vv = b = bb = vb = pairs = v2 = vv2 = b2 = vb2 = bb2 = 0.0
    for r in range(top, bottom):
        dy2 = (r - cy) ** 2
        if dy2 < core:
            first, last = _chord(width, cx, core - dy2)
            for c in range(first, last):
                value = float(frame[r, c])
                n_in, sum_in, square_in = n_in + 1.0, sum_in + value, square_in + value * value
        if dy2 >= outer:
            continue
        first, last = _chord(width, cx, outer - dy2)
        hole, end = _chord(width, cx, inner - dy2) if dy2 < inner else (last, last)
        for side in range(2):
            low, high = (first, hole) if side == 0 else (end, last)
            for c in range(low, high):
                value = float(frame[r, c])
                n, v, vv = n + 1.0, v + value, vv + value * value
                if known:
                    below = bed[r, c]
                    b, bb, vb = b + below, bb + below * below, vb + value * below
            for c in range(low, high - 1):
                value, beside = float(frame[r, c]), float(frame[r, c + 1])
                pairs, v2, vv2 = pairs + 1.0, v2 + value + beside, vv2 + value * beside
                if known:
                    here, there = bed[r, c], bed[r, c + 1]
                    b2, bb2, vb2 = b2 + here + there, bb2 + here * there, vb2 + value * there + beside * here
    if n_in < 4 or n < 8:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    level = sum_in / n_in
    noise = max(square_in / n_in - level * level, MIN_NOISE)
    alpha, beta, rest = _fitted(n, v, vv, b, bb, vb)
    grain = max(rest / (n - 2.0) - noise, 0.0)
    # The sum of (v - α - β b)(v' - α - β b') over neighbours, from its parts.
    product = vv2 - alpha * v2 + pairs * alpha * alpha - beta * (vb2 - alpha * b2) + beta * beta * bb2
    rho = product / max(pairs, 1.0) / grain if grain > 0.05 * noise else 0.0
    return level, noise, alpha, beta, grain, rho, level - v / n


@compiled
def _fitted(n, v, vv, b, bb, vb):
    """α, β and the residual sum of squares, from a ring's sums over its pixels v and the bed b.

    The ring is uniform (α) or the bed under another illumination (β); both only if χ² gains MIN_GAIN.
    """
    alpha, beta, rest = v / n, 0.0, vv - v * v / n
    if bb <= 0.0:
        return alpha, beta, rest
    light = vb / bb
    if vv - light * vb < rest:
        alpha, beta, rest = 0.0, light, vv - light * vb
    texture, shared = bb - b * b / n, vb - v * b / n
    if texture > n * MIN_NOISE and shared > 0.0:
        slope = shared / texture
        left = vv - v * v / n - slope * shared
        if rest - left > MIN_GAIN * left / n:
            alpha, beta, rest = (v - slope * b) / n, slope, left
    return alpha, beta, rest


@compiled
def _correlation_factor(rho, blur):
    """Factor by which correlation ρ between neighbours increases the effective variance of grain on a rim.

    The sum over neighbours of a Gaussian texture's ρ^(lag²), weighted by the similarity of the rim's slope there: 1
    along the rim, and across it that of a Gaussian edge's slope.
    """
    rho, spread = min(max(rho, 0.0), 0.95), 4.0 * (blur * blur + 1.0 / 6.0)
    along = across = 1.0
    for lag in range(1, 8):
        share = rho ** (lag * lag)
        along += 2.0 * share
        across += 2.0 * share * np.exp(-lag * lag / spread)
    return along * across


@compiled(fastmath=True)
def _shape(frame, bed, ground, cx, cy, radius):
    """Centre, radius from the area (0: no disc), blur [px] from Σ c (1 - c) = 2 √π radius √(blur² + 1/12), and ratio of
    axes."""
    level, noise, alpha, beta, grain, _, _ = ground
    within, known = (radius + 2.5) ** 2, bed.shape[0] > 0
    _, _, top, bottom = _box(frame.shape, cx, cy, radius + 2.5)
    area = edge = mass = m_x = m_y = m_xx = m_yy = m_xy = 0.0
    for r in range(top, bottom):
        dy = r - cy
        if dy * dy >= within:
            continue
        first, last = _chord(frame.shape[1], cx, within - dy * dy)
        for c in range(first, last):
            dx = c - cx
            below = alpha + (beta * bed[r, c] if known else 0.0)
            inverse = 1.0 / (level - below)
            seen = (frame[r, c] - below) * inverse
            cover = min(max(seen, 0.0), 1.0)
            area += seen
            # Noise reduces E[c (1 - c)] by its variance.
            edge += seen * (1.0 - seen) + (noise + (1.0 - cover) ** 2 * grain) * inverse * inverse
            solid = cover if cover > 0.15 else 0.0
            mass += solid
            m_x += solid * dx
            m_y += solid * dy
            m_xx += solid * dx * dx
            m_yy += solid * dy * dy
            m_xy += solid * dx * dy
    if mass <= 0.0 or area <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    m_x, m_y = m_x / mass, m_y / mass
    m_xx, m_yy, m_xy = m_xx / mass - m_x * m_x, m_yy / mass - m_y * m_y, m_xy / mass - m_x * m_y
    spread = np.sqrt((m_xx - m_yy) ** 2 + 4.0 * m_xy * m_xy)
    short, seen = m_xx + m_yy - spread, np.sqrt(area / np.pi)
    elongation = np.sqrt((m_xx + m_yy + spread) / short) if short > 0.0 else 1e3
    thickness = max(edge, 0.0) / (2.0 * np.sqrt(np.pi) * seen)
    return cx + m_x, cy + m_y, seen, np.sqrt(max(thickness * thickness - 1.0 / 12.0, 0.0)), elongation


@compiled
def _soft_centroid(frame, bed, ground, row):
    """Write the soft centroid into the row, for patches without a disc's rim.

    Its variance propagates each pixel's noise, dx/dI_i = w'(x_i - x)/W: on the rim, where w' is not 0, camera noise,
    and grain in proportion to the part of the pixel that the disc does not cover.
    """
    level, noise, alpha, beta, grain, rho, _ = ground
    correlated, slope, known = grain * _correlation_factor(rho, 0.5), 1.0 / (HIGH - LOW), bed.shape[0] > 0
    x, y, radius = row[X], row[Y], row[RADIUS]
    left, right, top, bottom = _box(frame.shape, x, y, radius + 2.5)
    total = sum_x = sum_y = var_x = var_y = 0.0
    for r in range(top, bottom):
        for c in range(left, right):
            dx, dy = c - x, r - y
            if dx * dx + dy * dy >= (radius + 2.5) ** 2:
                continue
            below = alpha + (beta * bed[r, c] if known else 0.0)
            cover = min(max((frame[r, c] - below) / (level - below), 0.0), 1.0)
            weight = min(max((cover - LOW) * slope, 0.0), 1.0)
            total, sum_x, sum_y = total + weight, sum_x + weight * dx, sum_y + weight * dy
            if LOW < cover < HIGH:
                variance = (noise + (1.0 - cover) ** 2 * correlated) * (slope / (level - below)) ** 2
                var_x += variance * dx * dx
                var_y += variance * dy * dy
    row[X], row[Y] = x + sum_x / total, y + sum_y / total
    sampling = SAMPLING_PX3 / radius
    row[VAR_X], row[VAR_Y] = var_x / (total * total) + sampling, var_y / (total * total) + sampling


@compiled(fastmath=True)
def _rim(frame, bed, table, ground, blur, row):
    """Gauss-Newton on the rim from the row's centre and radius; True, with the row updated, if the rim is a disc's.

    Centre and radius are solved for separately, as their normal equations decouple for a complete rim.
    """
    level, noise, alpha, beta, grain, rho, _ = ground
    correlated = grain * _correlation_factor(rho, blur)
    known, profiles = bed.shape[0] > 0, table[int(blur / BLUR_STEP_PX + 0.5)]
    band = min(0.7 + 2.0 * blur, REACH_PX - 1.0)
    x, y, radius = row[X], row[Y], row[RADIUS]
    for step_number in range(STEPS):
        h_xx = h_yy = h_xy = h_rr = g_x = g_y = g_r = misfit = expected = 0.0
        outer, inner = (radius + band) ** 2, max(radius - band, 0.5) ** 2
        top, bottom = max(0, int(y - radius - band) + 1), min(frame.shape[0], int(y + radius + band) + 1)
        for r in range(top, bottom):
            dy = r - y
            far, near = np.sqrt(outer - dy * dy), np.sqrt(max(inner - dy * dy, 0.0))
            for side in range(2):
                first, last = (x - far, x - near) if side == 0 else (x + near, x + far)
                for c in range(max(0, int(first) + 1), min(frame.shape[1], int(last) + 1)):
                    dx = c - x
                    distance = np.sqrt(dx * dx + dy * dy)
                    nx, ny = dx / distance, dy / distance
                    place = (radius - distance + REACH_PX) * STEPS_A_PX
                    k, direction = int(place), int(abs(nx * ny) * 2 * (DIRECTIONS - 1) + 0.5)
                    low = profiles[direction, k]
                    rise = profiles[direction, k + 1] - low
                    cover = low + (place - k) * rise
                    step = level - alpha - (beta * bed[r, c] if known else 0.0)
                    residual = frame[r, c] - level + step * (1.0 - cover)
                    open_part = (1.0 - cover) ** 2
                    weight = 1.0 / (noise + open_part * correlated)
                    slope = step * rise * STEPS_A_PX
                    info, gradient = weight * slope * slope, weight * slope * residual
                    h_xx += info * nx * nx
                    h_yy += info * ny * ny
                    h_xy += info * nx * ny
                    h_rr += info
                    g_x += gradient * nx
                    g_y += gradient * ny
                    g_r += gradient
                    misfit += weight * residual * residual
                    expected += weight * (noise + open_part * grain)
        size = h_xx * h_yy - h_xy * h_xy
        if size <= 0.0:
            return False
        move_x, move_y = (h_yy * g_x - h_xy * g_y) / size, (h_xx * g_y - h_xy * g_x) / size
        misfit -= g_x * move_x + g_y * move_y + g_r * g_r / h_rr
        x, y, radius = x + move_x, y + move_y, radius + g_r / h_rr
        if not (misfit < MAX_MISFIT * expected and (x - row[X]) ** 2 + (y - row[Y]) ** 2 < MAX_SHIFT_PX**2):
            return False
        if step_number == STEPS - 1 or move_x * move_x + move_y * move_y < SETTLED_PX**2:
            # The noise is estimated from few pixels, so the variance is rescaled by the rim's own misfit.
            scale = misfit / expected / size
            row[X], row[Y], row[VAR_X], row[VAR_Y], row[RADIUS] = x, y, h_yy * scale, h_xx * scale, radius
            return True
    return False
