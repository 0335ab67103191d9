"""Marker centres: ours and its peers on the same drawn frames (px, ms a frame, one run)."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
import trackpy
from numpy.typing import NDArray
from skimage.measure import label, regionprops

from _ratios import Ratio
from sandbot_common.arrays import Floats, Frame
from sandbot_tracking.bed import Picture, background
from sandbot_tracking.marker_tracker import MarkerTracker
from sandbot_tracking.markers import NO_BED, Appearance, detect, follow

Method = Callable[[Frame, Floats], Floats]

RADIUS, GREY, CONTRAST, GRAIN, NOISE = 8.0, 60.0, 170.0, 10.0, 6.0
LENS_PX, GRAIN_PX = 0.6, 1.0
"""The lens's blur and the grains' size, as the widths of Gaussians."""
SCENES, QUICK, REPEATS, EMPTY = 100, 40, 3, 25
FINE, PATCH = 16, 33
REFERENCE = "cv2.SimpleBlobDetector, tuned"
SIZES, GATES = np.full(3, RADIUS), np.full(3, 8.0)
NOTES = """Aims: locked ≥ 40 × and whole frame, also the first, ≥ 3 × SimpleBlobDetector (SBD); ≤ 1.10 × CRBn with the
bed, ≤ 1.3 × CRBt without; error² / variance 1.0 ± 0.1; fractions of a pixel spread evenly (χ² per degree of freedom
near 1; SPIFF makes it 0 by force). Locking: RMS of the mean errors in ten classes of the true fraction of a pixel,
chance subtracted."""


def cover(x: float, y: float) -> Floats:
    """How much of each pixel of a patch (PATCH, PATCH) a disc at x, y covers, seen through the lens."""
    at = (np.arange(PATCH * FINE) + 0.5) / FINE - 0.5
    inside = ((at[None, :] - x) ** 2 + (at[:, None] - y) ** 2 <= RADIUS**2).astype(np.float32)
    seen = cv2.GaussianBlur(inside, (0, 0), LENS_PX * FINE)
    return np.asarray(seen.reshape(PATCH, FINE, PATCH, FINE).mean(axis=(1, 3)), dtype=float)


def bounds() -> tuple[float, float]:
    """Cramér–Rao bounds of a position [px] in these scenes: of the camera's noise, and with unknown grains behind.

    With the picture's derivative J and its covariance C = σ² I + (1 - c) G (1 - c), 1 / √(Jᵀ C⁻¹ J); G is the grains'.
    """
    place = np.stack(np.mgrid[:PATCH, :PATCH], axis=-1).reshape(-1, 2)
    apart = np.sum((place[:, None] - place[None]) ** 2, axis=-1)
    grains = GRAIN**2 * np.exp(-apart / (4 * GRAIN_PX**2))
    noise, step = NOISE**2 + 1 / 12, 2 / FINE
    camera, texture = [], []
    for x, y in np.random.default_rng(0).uniform(15.5, 16.5, (3, 2)):
        slope = CONTRAST * (cover(x + step, y) - cover(x - step, y)).ravel() / (2 * step)
        bare = 1 - cover(x, y).ravel()
        camera.append(slope @ slope / noise)
        covariance = noise * np.eye(bare.size) + bare[:, None] * grains * bare
        texture.append(slope @ np.linalg.solve(covariance, slope))
    return float(np.mean(camera) ** -0.5), float(np.mean(texture) ** -0.5)


@dataclass(frozen=True)
class Scene:
    """A frame, its discs' centres (3, 2), guesses within 3 px of them, and frames of the bed without discs."""

    frame: Frame
    centres: Floats
    guesses: Floats
    bed: NDArray[np.float32]


def draw(rng: np.random.Generator) -> Scene:
    """A 640×480 frame with three discs and three dim glints, and what was learnt from EMPTY frames before."""
    texture = cv2.GaussianBlur(rng.standard_normal((480, 640)), (0, 0), GRAIN_PX) * np.sqrt(4 * np.pi) * GRAIN_PX
    bed = GREY + GRAIN * texture
    centres = np.column_stack((rng.uniform(60, 160, 3) + np.array([0, 200, 400]), rng.uniform(60, 420, 3)))
    glints = np.column_stack((rng.uniform(180, 220, 3) + np.array([0, 200, 380]), rng.uniform(60, 420, 3)))
    for spot in glints:
        _add(bed, spot, 50.0)
    image = bed.copy()
    for spot in centres:
        _add(image, spot, CONTRAST)
    empty = background(_expose(rng, bed) for _ in range(EMPTY))
    return Scene(_expose(rng, image), centres, centres + rng.uniform(-3, 3, centres.shape), empty)


def _add(image: Floats, spot: Floats, contrast: float) -> None:
    left, top = (int(value) - PATCH // 2 for value in spot)
    patch = image[top : top + PATCH, left : left + PATCH]
    patch += cover(spot[0] - left, spot[1] - top)[:, : patch.shape[1]] * (GREY + contrast - patch)


def _expose(rng: np.random.Generator, image: Floats) -> Frame:
    return np.clip(np.rint(image + NOISE * rng.standard_normal(image.shape)), 0, 255).astype(np.uint8)


def blob_detector() -> Method:
    """OpenCV's, with thresholds that find these discs; its defaults find none."""
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


def _locked(frame: Frame, near: Floats, bed: Picture = NO_BED) -> Floats:
    return follow(frame, near, SIZES, GATES, bed)


def _first(frame: Frame, _: Floats) -> Floats:
    """A tracker that has seen nothing yet."""
    return MarkerTracker(("left", "middle", "right")).update(frame).xy_px


@dataclass(frozen=True)
class Row:
    """What a method reached: centres found and true (n, 2) [px], time of a frame [ms] (its lower fifth), and how many
    times its stated variance its squared errors are (NaN where it states none)."""

    found: Floats
    truth: Floats
    ms: float
    normalised: float

    @property
    def rms_px(self) -> float:
        """Root mean square error an axis."""
        return float(np.sqrt(np.mean((self.found - self.truth) ** 2)))

    @property
    def locking_px(self) -> float:
        """RMS of the mean errors in ten classes of the true fraction of a pixel, without what chance makes of it."""
        off, bins = (self.found - self.truth).ravel(), (np.mod(self.truth, 1.0).ravel() * 10).astype(int)
        means = np.array([(off[bins == i].mean(), off[bins == i].var() / (bins == i).sum()) for i in range(10)])
        return float(np.sqrt(max(np.mean(means[:, 0] ** 2 - means[:, 1]), 0.0)))

    @property
    def unevenness(self) -> float:
        """χ² per degree of freedom of ten bins of the found fractions of a pixel; 1 if they are evenly spread."""
        counts = np.histogram(np.mod(self.found, 1.0), np.linspace(0, 1, 11))[0]
        return float(np.sum((counts - counts.mean()) ** 2) / counts.mean() / 9)


def main() -> str:
    """The markdown section."""
    rng = np.random.default_rng(1)
    scenes = [draw(rng) for _ in range(SCENES)]
    methods = {
        REFERENCE: blob_detector(),
        "trackpy, numba": _trackpy,
        "skimage regionprops, weighted": _skimage,
        "ours, a tracker's first frame": _first,
        "ours, whole frame": _detect,
        "ours, locked": _locked,
        f"ours, locked, bed learnt from {EMPTY} empty frames": None,
    }
    rows = _measure(methods, scenes)
    rows["trackpy, numba, SPIFF"] = _spiff(rows["trackpy, numba"])
    camera, texture = bounds()
    lines = [
        f"## Tracking: 640×480, 3 discs of radius {RADIUS:.0f} px",
        "",
        f"Contrast {CONTRAST:.0f}, grains of sd {GRAIN:.0f} and {GRAIN_PX} px, camera noise {NOISE:.0f}, a lens of "
        f"{LENS_PX} px. Bounds of these very scenes, computed: CRBn {camera:.4f} px (camera noise), CRBt {texture:.4f} "
        "px (grains behind the disc unknown, too).",
        "",
        "| method | RMS px | × CRBt | × CRBn | locking px | χ² of fractions | error² / variance | ms a frame | × SBD |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name, row in rows.items():
        stated = "–" if np.isnan(row.normalised) else f"{row.normalised:.2f}"
        error = f"{row.rms_px:.4f} | {row.rms_px / texture:.2f} | {row.rms_px / camera:.2f}"
        pace = f"{row.ms:.4f} | {rows[REFERENCE].ms / row.ms:.1f}"
        lines.append(f"| {name} | {error} | {row.locking_px:.4f} | {row.unevenness:.1f} | {stated} | {pace} |")
    return "\n".join([*lines, "", NOTES])


def quick() -> list[Ratio]:
    """Speed beside SimpleBlobDetector, and how near the bounds are."""
    rng = np.random.default_rng(2)
    scenes = [draw(rng) for _ in range(QUICK)]
    camera, texture = bounds()
    methods = {"slow": blob_detector(), "first": _first, "whole": _detect, "locked": _locked, "bed": None}
    slow, first, whole, locked, bed = _measure(methods, scenes).values()
    return [
        Ratio("a tracker's first frame", "SimpleBlobDetector", slow.ms / first.ms, 3.0),
        Ratio("a whole frame searched", "SimpleBlobDetector", slow.ms / whole.ms, 3.0),
        Ratio("markers followed", "SimpleBlobDetector", slow.ms / locked.ms, 40.0),
        Ratio("centres, bed known", "bound of the camera's noise", camera / bed.rms_px, 1 / 1.1),
        Ratio("centres, bed not known", "bound with grains", texture / locked.rms_px, 1 / 1.3),
    ]


def _measure(methods: Mapping[str, Method | None], scenes: list[Scene]) -> dict[str, Row]:
    """All methods over all scenes, in turn: what else runs slows all alike. None: the locked one with a scene's bed."""
    found: dict[str, list[Floats]] = {name: [] for name in methods}
    times: dict[str, list[float]] = {name: [] for name in methods}
    for scene in scenes:
        for name, method in methods.items():
            call = method or partial(_locked, bed=scene.bed)
            call(scene.frame, scene.guesses)
            for _ in range(REPEATS):
                start = time.perf_counter()
                rows = call(scene.frame, scene.guesses)
                times[name].append((time.perf_counter() - start) * 1e3)
            nearest = np.argmin(np.hypot(*(rows[:, None, :2] - scene.centres[None]).transpose(2, 0, 1)), axis=0)
            found[name].append(rows[nearest])
    truth = np.concatenate([scene.centres for scene in scenes])
    return {name: _row(np.concatenate(found[name]), truth, times[name]) for name in methods}


def _row(rows: Floats, truth: Floats, times_ms: list[float]) -> Row:
    stated = float(np.mean((rows[:, :2] - truth) ** 2 / rows[:, 2:4])) if rows.shape[1] > 2 else np.nan
    # Whatever else runs only adds, and the more the longer a call takes: the fastest fifth is what a call needs.
    return Row(rows[:, :2], truth, float(np.percentile(times_ms, 20)), stated)


def _spiff(plain: Row) -> Row:
    """A row with its fractions of a pixel spread evenly by their ranks (Burov et al. 2017); trackpy leaves it to us."""
    ranks = np.argsort(np.argsort(np.mod(plain.found, 1.0), axis=0), axis=0)
    even = np.floor(plain.found) + (ranks + 0.5) / len(ranks)
    return Row(even, plain.truth, plain.ms, np.nan)


if __name__ == "__main__":
    print(main())
