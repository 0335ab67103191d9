"""Finds patches of a marker's size in a whole frame that are brighter than the grains."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"

import numpy as np

from sandbot_common.compiled import compiled

SAMPLED = 4
"""Every how many rows and columns a pixel is sampled to estimate the level of the grains."""


@compiled
def patches(frame, step, tile, stride, min_area, max_area):
    """Patches (n, 3) of ``min_area`` to ``max_area`` px at least ``step`` above the grains: middle x, y and area [px].

    The grains' level is the median of a tile of ``tile`` px, as illumination may be uneven. Only every ``stride``-th
    pixel is tested, so a patch must be at least so wide; each bright one starts a flood fill.
    """
    height, width = frame.shape
    levels = _levels(frame, step, tile)
    # One bit per pixel: with a byte each, the system would have to supply new memory for every frame.
    seen = np.zeros((height, width // 8 + 1), np.uint8)
    stack = np.empty((height * width if max_area > height * width else int(max_area) + 8, 2), np.int32)
    found = [(0.0, 0.0, 0.0) for _ in range(0)]
    for row in range(stride // 2, height, stride):
        across = levels[row // tile]
        for column in range(stride // 2, width, stride):
            if frame[row, column] >= across[column // tile] and not _bit(seen, row, column):
                patch = _fill(frame, seen, stack, row, column, across[column // tile])
                if min_area <= patch[2] <= max_area:
                    found.append(patch)
    answer = np.empty((len(found), 3))
    for i, patch in enumerate(found):
        answer[i, 0], answer[i, 1], answer[i, 2] = patch
    return answer


@compiled
def _levels(frame, step, tile):
    """The threshold of each tile."""
    height, width = frame.shape
    levels = np.empty(((height + tile - 1) // tile, (width + tile - 1) // tile), np.uint8)
    for i in range(levels.shape[0]):
        for j in range(levels.shape[1]):
            counts, total = np.zeros(256, np.int64), 0
            for row in range(i * tile, min((i + 1) * tile, height), SAMPLED):
                for column in range(j * tile, min((j + 1) * tile, width), SAMPLED):
                    counts[frame[row, column]] += 1
                    total += 1
            below = median = 0
            while below + counts[median] <= total // 2:
                below += counts[median]
                median += 1
            levels[i, j] = min(median + step, 254.0) + 1
    return levels


@compiled
def _fill(frame, seen, stack, row, column, level):
    """Middle and area of the bright pixels connected to (row, column); the area is infinite if the stack overflows."""
    height, width = frame.shape
    area, sum_x, sum_y, n = 0.0, 0.0, 0.0, 1
    stack[0, 0], stack[0, 1] = row, column
    _set(seen, row, column)
    while n > 0:
        n -= 1
        r, c = stack[n]
        area, sum_x, sum_y = area + 1.0, sum_x + c, sum_y + r
        for rr in range(max(r - 1, 0), min(r + 2, height)):
            for cc in range(max(c - 1, 0), min(c + 2, width)):
                if frame[rr, cc] >= level and not _bit(seen, rr, cc):
                    if n == stack.shape[0]:
                        return 0.0, 0.0, np.inf
                    _set(seen, rr, cc)
                    stack[n, 0], stack[n, 1] = rr, cc
                    n += 1
    return sum_x / area, sum_y / area, area


@compiled
def _bit(seen, row, column):
    return seen[row, column >> 3] & (1 << (column & 7)) != 0


@compiled
def _set(seen, row, column):
    seen[row, column >> 3] |= 1 << (column & 7)
