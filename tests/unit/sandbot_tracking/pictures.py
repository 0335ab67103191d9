"""Real film, drawn with known truth: anti-aliased twelvefold, through a lens, in light, with grains and noise.

Apart from the lab's cameras on purpose: it shares no line with what draws those or with what measures discs.
"""

from dataclasses import dataclass
from functools import lru_cache

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


@dataclass(frozen=True)
class Lens:
    """A pinhole with Brown–Conrady distortion k1, k2, p1, p2, as it is undone here: by iteration, without OpenCV."""

    focal_px: float = 800.0
    centre_px: tuple[float, float] = (321.0, 237.5)
    k1: float = -0.22
    k2: float = 0.05
    p1: float = 0.001
    p2: float = -0.0015

    def bent(self, x, y):
        """Where a straight ray of slopes x, y ends up, in focal lengths."""
        r2 = x * x + y * y
        radial = 1 + r2 * (self.k1 + r2 * self.k2)
        return (
            x * radial + 2 * self.p1 * x * y + self.p2 * (r2 + 2 * x * x),
            y * radial + self.p1 * (r2 + 2 * y * y) + 2 * self.p2 * x * y,
        )

    def rays(self, u, v):
        """Slopes of the rays that pixels see."""
        a, b = (u - self.centre_px[0]) / self.focal_px, (v - self.centre_px[1]) / self.focal_px
        x, y = a.copy(), b.copy()
        for _ in range(20):
            off = self.bent(x, y)
            x, y = x + a - off[0], y + b - off[1]
        return x, y


def traced(texture, metre_px, lens, rotation, shift_m, rng, shape=(480, 640), fine=2, noise=2.0):
    """A flat picture (rows, columns) somewhere in space, ray by ray, ``fine`` squared rays a pixel; grey beside it.

    ``rotation`` (3, 3) and ``shift_m`` (3,) take its points [m], x to the right and y down, to the camera's axes.
    """
    rows, columns = shape
    rays = _rays(lens, shape, fine)
    normal = rotation[:, 2]
    points = (rays * ((normal @ shift_m) / (rays @ normal))[..., None] - shift_m) @ rotation
    x, y = (np.rint(points[..., axis] * metre_px - 0.5).astype(int) for axis in (0, 1))
    inside = (x >= 0) & (y >= 0) & (x < texture.shape[1]) & (y < texture.shape[0])
    seen = np.where(inside, texture[np.where(inside, y, 0), np.where(inside, x, 0)], 128.0)
    image = seen.reshape(rows, fine, columns, fine).mean(axis=(1, 3))
    return np.clip(np.rint(image + noise * rng.standard_normal(shape)), 0, 255).astype(np.uint8)


@lru_cache(maxsize=1)
def _rays(lens, shape, fine):
    rows, columns = (((np.arange(count)[:, None] + (np.arange(fine) + 0.5) / fine - 0.5).ravel()) for count in shape)
    v, u = np.meshgrid(rows, columns, indexing="ij")
    return np.stack((*lens.rays(u, v), np.ones_like(u)), axis=-1)
