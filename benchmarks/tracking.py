"""Marker centres: ours and its peers on the same drawn frames (px, ms a frame, one run)."""

import time
from collections.abc import Callable

import cv2
import numpy as np
import trackpy
from numpy.typing import NDArray
from skimage.measure import label, regionprops

from sandbot_tracking.markers import Appearance, detect, locate

Floats = NDArray[np.float64]
Frame = NDArray[np.uint8]

RADIUS, GREY, CONTRAST, GRAIN, NOISE = 8.0, 60.0, 170.0, 10.0, 6.0
FRAMES, REPEATS = 15, 5
CRB_NOISE_PX, CRB_TEXTURE_PX = 0.0108, 0.0182
"""Cramér–Rao bounds of a position for these discs: camera noise alone, and with unknown grains behind the disc."""


def draw(rng: np.random.Generator) -> tuple[Frame, Floats]:
    """A 640×480 frame with three anti-aliased discs (8× oversampled) and three dim glints; centres (3, 2)."""
    image = GREY + GRAIN * rng.standard_normal((480, 640))
    centres = np.column_stack((rng.uniform(60, 160, 3) + np.array([0, 200, 400]), rng.uniform(60, 420, 3)))
    glints = np.column_stack((rng.uniform(180, 220, 3) + np.array([0, 200, 400]), rng.uniform(60, 420, 3)))
    sub = (np.arange(8) + 0.5) / 8 - 0.5
    for (x, y), contrast in [*((c, CONTRAST) for c in centres), *((g, 50.0) for g in glints)]:
        left, top = int(x) - 12, int(y) - 12
        if left + 25 > 640:
            continue
        fine = (np.arange(25)[:, None] + sub).ravel()
        inside = (fine[None, :] + left - x) ** 2 + (fine[:, None] + top - y) ** 2 <= RADIUS**2
        cover = inside.reshape(25, 8, 25, 8).mean(axis=(1, 3))
        patch = image[top : top + 25, left : left + 25]
        patch += cover * (GREY + contrast - patch)
    noisy = image + NOISE * rng.standard_normal(image.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8), centres


def _blob_detector() -> Callable[[Frame, Floats], Floats]:
    options = cv2.SimpleBlobDetector_Params()
    options.minThreshold, options.maxThreshold, options.thresholdStep = 90, 200, 10
    options.filterByColor, options.blobColor = True, 255
    options.filterByArea, options.minArea, options.maxArea = True, 50, 800
    options.filterByConvexity = options.filterByInertia = options.filterByCircularity = False
    detector = cv2.SimpleBlobDetector_create(options)
    return lambda frame, _: np.array([point.pt for point in detector.detect(frame)])


def _trackpy(frame: Frame, _: Floats) -> Floats:
    found = trackpy.locate(frame, 21, minmass=5000, engine="numba")
    return np.asarray(found[["x", "y"]].to_numpy(), dtype=float)


def _skimage(frame: Frame, _: Floats) -> Floats:
    level = GREY + CONTRAST / 2
    weight = np.maximum(frame.astype(float) - level, 0)
    regions = regionprops(label(frame > level), intensity_image=weight)
    return np.array([region.centroid_weighted[::-1] for region in regions if region.area > 50])


def _detect(frame: Frame, _: Floats) -> Floats:
    return detect(frame, Appearance()).xy_px


def _locate(frame: Frame, near: Floats) -> Floats:
    return np.array([locate(frame, x, y, RADIUS, 8.0)[:2] for x, y in near])


def main() -> str:
    """The markdown section."""
    rng = np.random.default_rng(1)
    scenes = [draw(rng) for _ in range(FRAMES)]
    guesses = [centres + rng.uniform(-3, 3, centres.shape) for _, centres in scenes]
    methods: dict[str, Callable[[Frame, Floats], Floats]] = {
        "cv2.SimpleBlobDetector, tuned": _blob_detector(),
        "trackpy, numba": _trackpy,
        "skimage regionprops, weighted": _skimage,
        "ours, whole frame (acquisition)": _detect,
        "ours, gated (locked)": _locate,
    }
    rows = {name: _measure(method, scenes, guesses) for name, method in methods.items()}
    reference = rows["cv2.SimpleBlobDetector, tuned"][1]
    lines = [
        "## Tracking: 640×480, 3 discs of radius 8 px",
        "",
        "| method | RMS px | × CRBt | × CRBn | ms a frame | times SimpleBlobDetector's speed |",
        "|---|---|---|---|---|---|",
    ]
    for name, (rms, ms) in rows.items():
        ratios = f"{rms / CRB_TEXTURE_PX:.2f} | {rms / CRB_NOISE_PX:.2f}"
        lines.append(f"| {name} | {rms:.4f} | {ratios} | {ms:.3f} | {reference / ms:.1f} |")
    return "\n".join(lines)


def _measure(
    method: Callable[[Frame, Floats], Floats], scenes: list[tuple[Frame, Floats]], guesses: list[Floats]
) -> tuple[float, float]:
    """RMS error per axis [px] of the found disc next to each true one, and the median time of a frame [ms]."""
    off, times = [], []
    method(scenes[0][0], guesses[0])
    for (frame, centres), guess in zip(scenes, guesses, strict=True):
        for _ in range(REPEATS):
            start = time.perf_counter()
            found = method(frame, guess)
            times.append((time.perf_counter() - start) * 1e3)
        nearest = found[np.argmin(np.hypot(*(found[:, None] - centres[None]).transpose(2, 0, 1)), axis=0)]
        off.append(nearest - centres)
    return float(np.sqrt(np.mean(np.square(off)))), float(np.median(times))


if __name__ == "__main__":
    print(main())
