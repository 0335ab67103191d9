"""A trial as an MP4: the film with its marks, the model's legs, and v_x(t) up to the moment shown."""

from collections.abc import Iterator
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from sandbot_model.explore.scene import Scene
from sandbot_model.physics.observables import CM
from sandbot_record.trials.film import Film

Pixels = NDArray[np.uint8]
RATE_HZ, PACE = 25, 0.25
"""Frame rate, and seconds of the trial per second of the clip."""
MAX_PICTURES = 1500
WIDTH, LEG_WIDTH, HEIGHT = 960, 320, 300
INK, SOFT, GRID, NEW, PAPER, BED = (
    (36, 31, 27),
    (134, 125, 118),
    (235, 232, 230),
    (0, 90, 194),
    (255, 255, 255),
    (220, 231, 236),
)
"""Colours as (blue, green, red), as in OpenCV."""
BODY = 1.8
"""Half the length of the body as drawn, in leg radii."""


def write_clip(path: Path, scene: Scene, film: Film | None) -> None:
    """Write the clip as H.264, which browsers and slide programs play; OpenCV's wheel has no encoder for it."""
    with av.open(str(path), "w", format="mp4", options={"movflags": "faststart"}) as clip:
        stream = clip.add_stream("libx264", rate=RATE_HZ, options={"preset": "veryfast", "crf": "20"})
        stream.width, stream.pix_fmt = WIDTH, "yuv420p"
        stream.height = HEIGHT + (0 if film is None else _film_height(film))
        for picture in pictures(scene, film):
            clip.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="bgr24")))
        clip.mux(stream.encode())


def pictures(scene: Scene, film: Film | None) -> Iterator[Pixels]:
    """The frames of the clip: the film above, legs and v_x(t) below."""
    graph = _Graph(scene)
    for t in np.arange(min(0.0, float(scene.waveform.time_s[0])), scene.end_s, PACE / RATE_HZ)[:MAX_PICTURES]:
        below = np.hstack([legs_at(scene, float(t)), graph.at(float(t))])
        yield below if film is None else np.vstack([_film_at(film, float(t)), below])


def _film_height(film: Film) -> int:
    height, width = film.picture(0).shape[:2]
    return 2 * round(float(height) * WIDTH / float(width) / 2)


def _film_at(film: Film, t: float) -> Pixels:
    picture = film.picture(int(np.argmin(np.abs(film.time_s - t))))
    return np.asarray(cv2.resize(picture, (WIDTH, _film_height(film)), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def legs_at(scene: Scene, t: float) -> Pixels:
    """The body and one leg of each tripod by the model; a leg is coloured while it holds."""
    i = int(np.argmin(np.abs(scene.waveform.leg_time_s - t)))
    half, above, below = scene.frame
    radius = int(min(LEG_WIDTH / (2 * half), HEIGHT / (above + below)))
    px_per_m, surface = radius / scene.radius_m, round(HEIGHT / 2 + radius * (above - below) / 2)
    picture: Pixels = np.full((HEIGHT, LEG_WIDTH, 3), PAPER, dtype=np.uint8)
    picture[surface:] = BED
    hip = LEG_WIDTH // 2, round(surface - px_per_m * float(scene.axle_m[i]))
    belly, side = round(px_per_m * scene.axle_height_m), round(BODY * radius)
    cv2.rectangle(picture, (hip[0] - side, hip[1] - belly // 4), (hip[0] + side, hip[1] + belly), SOFT, 2, cv2.LINE_AA)
    arc_deg = float(np.degrees(scene.arc_rad))
    for turned, holds in zip(scene.turned[i], scene.holds[i], strict=True):
        centre = round(hip[0] - radius * np.sin(turned)), round(hip[1] + radius * np.cos(turned))
        begin = float(np.degrees(turned)) - 90.0
        colour = NEW if holds else INK
        cv2.ellipse(picture, centre, (radius, radius), begin, 0, arc_deg, colour, 6 if holds else 3, cv2.LINE_AA)
    cv2.circle(picture, hip, 6, INK, -1, cv2.LINE_AA)
    cv2.line(picture, (0, surface), (LEG_WIDTH, surface), INK, 2, cv2.LINE_AA)
    return picture


class _Graph:
    """v_x(t), drawn once; each frame adds the cursor."""

    LEFT, TOP, RIGHT, BOTTOM = 56, 24, 16, 40

    def __init__(self, scene: Scene) -> None:
        self._width = WIDTH - LEG_WIDTH
        shown = scene.waveform
        self._start, self._end = min(0.0, float(shown.time_s[0])), scene.end_s
        self._low = min(0.0, CM * float(np.nanmin(shown.speed_m_s)))
        self._top = 1.1 * CM * float(np.nanmax(np.append(shown.speed_m_s, scene.model_m_s))) or 1.0
        self._picture: Pixels = np.full((HEIGHT, self._width, 3), PAPER, dtype=np.uint8)
        for value in np.linspace(0, self._top, 5)[:-1]:
            y = self._y(value)
            cv2.line(self._picture, (self.LEFT, y), (self._width - self.RIGHT, y), GRID, 1)
            self._write(f"{value:.0f}", 8, y + 5)
        self._write("v_x (cm/s), model in grey", self.LEFT, 16)
        self._write(f"{self._end:.1f} s", self._width - 60, HEIGHT - 12)
        self._draw(shown.leg_time_s, CM * scene.model_m_s, SOFT, 4)
        self._draw(shown.time_s, CM * shown.speed_m_s, NEW, 2)

    def at(self, t: float) -> Pixels:
        """The graph with the cursor at t."""
        picture = self._picture.copy()
        cv2.line(picture, (self._x(t), self.TOP), (self._x(t), HEIGHT - self.BOTTOM), INK, 2)
        cv2.putText(
            picture, f"t = {t:.2f} s", (self.LEFT, HEIGHT - 12), cv2.FONT_HERSHEY_SIMPLEX, 0.5, INK, 1, cv2.LINE_AA
        )
        return picture

    def _x(self, t: float) -> int:
        return round(self.LEFT + (self._width - self.LEFT - self.RIGHT) * (t - self._start) / (self._end - self._start))

    def _y(self, value: float) -> int:
        share = (value - self._low) / (self._top - self._low)
        return round(HEIGHT - self.BOTTOM - (HEIGHT - self.BOTTOM - self.TOP) * share)

    def _draw(
        self, times: NDArray[np.float64], values: NDArray[np.float64], colour: tuple[int, int, int], width: int
    ) -> None:
        seen = np.isfinite(values) & (times >= self._start) & (times <= self._end)
        points = np.array(
            [(self._x(t), self._y(v)) for t, v in zip(times[seen], values[seen], strict=True)], dtype=np.int32
        )
        cv2.polylines(self._picture, [points], False, colour, width, cv2.LINE_AA)

    def _write(self, words: str, x: int, y: int) -> None:
        cv2.putText(self._picture, words, (x, y), cv2.FONT_HERSHEY_SIMPLEX, 0.45, INK, 1, cv2.LINE_AA)
