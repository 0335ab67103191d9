"""Real film, drawn with known truth: anti-aliased twelvefold, through a lens, in light, with grains and noise.

Apart from the lab's cameras on purpose: it shares no line with what draws those or with what measures discs.
"""

from dataclasses import dataclass

import cv2
import numpy as np

FINE = 12


@dataclass(frozen=True)
class Film:
    """How frames come about; lengths in px, grey levels."""

    lens: float = 0.6
    """Width of the lens's Gaussian blur; a defocused lens has more."""
    grain: float = 10.0
    grain_px: float = 1.0
    noise: float = 6.0
    grey: float = 60.0
    contrast: float = 170.0
    travel: tuple[float, float] = (0.0, 0.0)
    """How far a disc moves during the exposure."""
    shape: tuple[int, int] = (48, 48)

    def bed(self, rng):
        """Grains as they lie (height, width)."""
        rows, columns = self.shape
        texture = cv2.GaussianBlur(rng.standard_normal((rows + 20, columns + 20)), (0, 0), self.grain_px)
        texture *= self.grain_px * np.sqrt(4 * np.pi)
        return self.grey + self.grain * texture[10:-10, 10:-10]

    def add(self, image, x, y, radius, grey=None):
        """Blend a disc into an image."""
        reach = int(radius + 4 * self.lens + max(map(abs, self.travel)) + 3)
        left, top = round(x) - reach, round(y) - reach
        at = (np.arange((2 * reach + 1) * FINE) + 0.5) / FINE - 0.5
        inside = np.zeros((at.size, at.size), np.float32)
        steps = 1 if self.travel == (0.0, 0.0) else 9
        for part in (np.arange(steps) + 0.5) / steps - 0.5:
            u, v = x - left + part * self.travel[0], y - top + part * self.travel[1]
            inside += ((at[None, :] - u) ** 2 + (at[:, None] - v) ** 2 <= radius**2) / np.float32(steps)
        if self.lens:
            inside = cv2.GaussianBlur(inside, (0, 0), self.lens * FINE)
        cover = inside.reshape(2 * reach + 1, FINE, 2 * reach + 1, FINE).mean(axis=(1, 3))
        rows = slice(max(top, 0), min(top + 2 * reach + 1, image.shape[0]))
        columns = slice(max(left, 0), min(left + 2 * reach + 1, image.shape[1]))
        seen = cover[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
        image[rows, columns] += seen * ((self.grey + self.contrast if grey is None else grey) - image[rows, columns])

    def expose(self, rng, image):
        """Camera noise and eight bits."""
        return np.clip(np.rint(image + self.noise * rng.standard_normal(image.shape)), 0, 255).astype(np.uint8)
