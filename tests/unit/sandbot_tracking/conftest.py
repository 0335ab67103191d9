"""Frames drawn with known truth: discs at sub-pixel places over grain texture, glints, blur and camera noise."""

from types import SimpleNamespace

import numpy as np
import pytest

GREY, CONTRAST, GRAIN, NOISE = 60.0, 170.0, 10.0, 6.0


def grains(rng, shape=(480, 640)):
    """A bed of grains, one grey level per pixel."""
    return GREY + GRAIN * rng.standard_normal(shape)


def add_disc(image, x, y, radius, contrast=CONTRAST, blur=(0.0, 0.0), fine=8):
    """Blend an anti-aliased disc into ``image``; ``blur``: its travel during the exposure [px]."""
    reach = int(radius + 3 + max(map(abs, blur)))
    rows = np.arange(max(0, int(y) - reach), min(image.shape[0], int(y) + reach + 2))
    columns = np.arange(max(0, int(x) - reach), min(image.shape[1], int(x) + reach + 2))
    if not (rows.size and columns.size):
        return
    sub = (np.arange(fine) + 0.5) / fine - 0.5
    yy = (rows[:, None] + sub).reshape(-1, 1)
    xx = (columns[:, None] + sub).reshape(1, -1)
    steps = 1 if blur == (0.0, 0.0) else 9
    cover = np.zeros((rows.size, columns.size))
    for part in (np.arange(steps) + 0.5) / steps - 0.5:
        inside = (xx - x - part * blur[0]) ** 2 + (yy - y - part * blur[1]) ** 2 <= radius**2
        cover += inside.reshape(rows.size, fine, columns.size, fine).mean(axis=(1, 3)) / steps
    patch = image[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    patch += cover * (GREY + contrast - patch)


def expose(rng, image, noise=NOISE):
    """Camera noise and eight bits."""
    return np.clip(np.rint(image + noise * rng.standard_normal(image.shape)), 0, 255).astype(np.uint8)


def frame(rng, discs, radius=7.0, bed=None, glints=(), blur=(0.0, 0.0)):
    """A mono8 frame with bright ``discs`` and dim ``glints`` (a third of the contrast) at (x, y) each."""
    image = (grains(rng) if bed is None else bed).copy()
    for x, y in glints:
        add_disc(image, x, y, radius, contrast=CONTRAST / 3)
    for x, y in discs:
        add_disc(image, x, y, radius, blur=blur)
    return expose(rng, image)


@pytest.fixture(scope="session")
def scene():
    return SimpleNamespace(grains=grains, add_disc=add_disc, expose=expose, frame=frame)


@pytest.fixture
def rng():
    return np.random.default_rng(20090511)
