"""Compiled drawing on grey images: anti-aliased discs and boxes with motion blur over the exposure."""

from math import ceil, floor, hypot
from typing import Any

import numpy as np

from sandbot_lab.jit import jit


@jit
def _clipped(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


@jit
def draw_disc(image: Any, u: Any, v: Any, radius: float, grey: float) -> None:
    """Draw a disc of a grey level, averaged over its positions u, v (n,) [px] during the exposure."""
    rows, columns = image.shape
    reach = radius + 1.0
    top, bottom = max(floor(v.min() - reach), 0), min(ceil(v.max() + reach), rows - 1)
    left, right = max(floor(u.min() - reach), 0), min(ceil(u.max() + reach), columns - 1)
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            covered = 0.0
            for i in range(u.size):
                # Coverage falls from 1 to 0 across the rim over one pixel.
                covered += _clipped(radius + 0.5 - hypot(column - u[i], row - v[i]), 0.0, 1.0)
            covered /= u.size
            level = image[row, column]
            image[row, column] = int(_clipped(level + covered * (grey - level) + 0.5, 0.0, 255.0))


@jit
def _cover(low: Any, high: Any, first: int, count: int) -> Any:
    """Fraction of each of ``count`` pixels from ``first`` between low and high, averaged over the exposure.

    For a box wholly outside the picture ``count`` is not above 0.
    """
    covered = np.zeros(max(count, 0))
    for pixel in range(covered.size):
        for i in range(low.size):
            ends = min(first + pixel + 0.5, high[i]) - max(first + pixel - 0.5, low[i])
            covered[pixel] += _clipped(ends, 0.0, 1.0) / low.size
    return covered


@jit
def draw_box(image: Any, left: Any, right: Any, top: Any, bottom: Any, grey: float) -> None:
    """Draw an upright box of a grey level, edges (n,) [px] during the exposure."""
    rows, columns = image.shape
    first_column, last_column = max(floor(left.min()), 0), min(ceil(right.max()), columns - 1)
    first_row, last_row = max(floor(top.min()), 0), min(ceil(bottom.max()), rows - 1)
    if last_column < first_column or last_row < first_row:
        return  # outside the picture
    across = _cover(left, right, first_column, last_column + 1 - first_column)
    down = _cover(top, bottom, first_row, last_row + 1 - first_row)
    for row in range(down.size):
        for column in range(across.size):
            # Rows and columns are blurred separately: exact if the box moves along only one of them.
            covered = down[row] * across[column]
            level = image[first_row + row, first_column + column]
            image[first_row + row, first_column + column] = int(level + covered * (grey - level) + 0.5)


@jit
def draw_stroke(image: Any, u: Any, v: Any, radius: float, grey: float) -> None:
    """Draw a line of a grey level through the points u, v (n,) [px], as thick as a disc of that radius."""
    rows, columns = image.shape
    reach = radius + 1.0
    for i in range(u.size):
        for row in range(max(floor(v[i] - reach), 0), min(ceil(v[i] + reach), rows - 1) + 1):
            for column in range(max(floor(u[i] - reach), 0), min(ceil(u[i] + reach), columns - 1) + 1):
                covered = _clipped(radius + 0.5 - hypot(column - u[i], row - v[i]), 0.0, 1.0)
                level = image[row, column]
                image[row, column] = int(_clipped(level + covered * (grey - level) + 0.5, 0.0, 255.0))
