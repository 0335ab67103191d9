"""Brightness of a pixel crossed by a disc's rim: the covered fraction of the pixel, blurred by the lens.

The rim is straight within a pixel. With a Gaussian blur of ``blur`` px, the covered fraction of a unit square is

    c(d) = [G(d + (a+b)/2) - G(d + (a-b)/2) - G(d - (a-b)/2) + G(d - (a+b)/2)] / (a b)

where G'' is the Gaussian, a >= b are the components of the rim's normal along the sides, and d is the pixel's distance
inside the rim. It is tabulated over blur, 2 a b and d; a plain Gaussian edge instead would bias centres towards pixels.
"""

from functools import lru_cache
from math import erf, exp, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from sandbot_common.compiled import compiled

BLUR_STEP_PX, BLURS = 0.1, 26
DIRECTIONS = 9
REACH_PX, STEPS_A_PX = 8, 32
"""Range of d, -REACH_PX to REACH_PX, which is more than three widths of the most blurred rim, and steps per pixel."""


@lru_cache(maxsize=1)
def rim_table() -> NDArray[np.float32]:
    """c(d): (BLURS, DIRECTIONS, 2 REACH_PX STEPS_A_PX + 1)."""
    return np.asarray(_table(), dtype=np.float32)


@compiled
def _table():  # type: ignore[no-untyped-def]
    table = np.empty((BLURS, DIRECTIONS, 2 * REACH_PX * STEPS_A_PX + 1))
    for i in range(BLURS):
        # Avoids a division by zero.
        blur = max(i * BLUR_STEP_PX, 1e-3)
        for j in range(DIRECTIONS):
            angle = 0.5 * np.arcsin(max(j / (DIRECTIONS - 1), 1e-3))
            a, b = np.cos(angle), np.sin(angle)
            for k in range(table.shape[2]):
                d = k / STEPS_A_PX - REACH_PX
                far = _ramp(d + 0.5 * (a + b), blur) + _ramp(d - 0.5 * (a + b), blur)
                near = _ramp(d + 0.5 * (a - b), blur) + _ramp(d - 0.5 * (a - b), blur)
                table[i, j, k] = (far - near) / (a * b)
    return table


@compiled
def _ramp(t, blur):  # type: ignore[no-untyped-def]
    """G: the Gaussian integrated twice."""
    below = 0.5 * (1.0 + erf(t / (blur * sqrt(2.0))))
    return 0.5 * (t * t + blur * blur) * below + 0.5 * t * blur * exp(-0.5 * (t / blur) ** 2) / sqrt(2.0 * pi)
