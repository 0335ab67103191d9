"""The kinds of array that numbers, counts, masks and grey pictures are kept in."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Frame = NDArray[np.uint8]
