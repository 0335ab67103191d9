"""Camera pictures with the tracked marks drawn in: pure. A picture waits for the landmarks of its own instant."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sandbot_tracking.calibration import Camera

Pixels = NDArray[np.uint8]
SEEN_BY = {"dorsal": ("com",), "lateral": ("front_axle", "rear_axle")}
"""The marks each camera sees."""
COLOURS = {"com": (0, 159, 230), "front_axle": (233, 180, 86), "rear_axle": (167, 121, 204)}
"""Blue, green, red; distinguishable for colour-blind people."""
SAME_NS = 8_000_000
"""A landmark within this time of a picture belongs to it: less than a frame at 100 Hz."""
PATIENCE_NS = 1_000_000_000
"""How long a picture waits for a slow tracker; without a tracker pictures are shown unmarked."""
_KEPT = 64
_RADIUS_PX = 12
_QUALITY = [cv2.IMWRITE_JPEG_QUALITY, 80]


@dataclass(frozen=True)
class Drawn:
    """A picture to show; ``seen``: the marks drawn into it."""

    jpeg: bytes
    seen: tuple[str, ...]


@dataclass
class MarkedView:
    """One camera's pending picture and recent landmarks. Each event may give a picture to show."""

    camera: Camera
    names: tuple[str, ...]
    _landmarks: dict[str, deque[tuple[int, Any]]] = field(default_factory=dict)
    _waiting: tuple[int, Pixels] | None = None

    def __post_init__(self) -> None:
        self._landmarks = {name: deque(maxlen=_KEPT) for name in self.names}

    def picture(self, t_ns: int, pixels: Pixels) -> Drawn | None:
        """A newer picture, returned at once if its landmarks have arrived. A pending one takes precedence over it until
        ``PATIENCE_NS`` has passed, and is then shown unmarked.
        """
        if self._waiting is not None and 0 <= t_ns - self._waiting[0] < PATIENCE_NS:
            return None
        before, self._waiting = self._waiting, (t_ns, pixels)
        if (drawn := self._complete()) is not None:
            return drawn
        return self._draw(*before) if before is not None else None

    def landmark(self, name: str, t_ns: int, xyz_m: Any) -> Drawn | None:
        """A landmark [m; trackway frame]; NaN where the mark was not seen."""
        self._landmarks[name].append((t_ns, xyz_m))
        return self._complete()

    def _complete(self) -> Drawn | None:
        if self._waiting is None or any(self._at(name, self._waiting[0]) is None for name in self.names):
            return None
        (t_ns, pixels), self._waiting = self._waiting, None
        return self._draw(t_ns, pixels)

    def _at(self, name: str, t_ns: int) -> Any:
        near = [(abs(t - t_ns), xyz) for t, xyz in self._landmarks[name] if abs(t - t_ns) <= SAME_NS]
        return min(near, key=lambda pair: pair[0])[1] if near else None

    def _draw(self, t_ns: int, pixels: Pixels) -> Drawn:
        marks = {name: self._pixel(self._at(name, t_ns)) for name in self.names}
        seen = {name: at for name, at in marks.items() if np.isfinite(at).all()}
        return Drawn(_jpeg(pixels, seen), tuple(seen))

    def _pixel(self, xyz_m: Any) -> NDArray[np.float64]:
        return self.camera.to_pixels([xyz_m])[0] if xyz_m is not None else np.full(2, np.nan)


def _jpeg(pixels: Pixels, marks: Mapping[str, NDArray[np.float64]]) -> bytes:
    image = cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR)
    for name, at in marks.items():
        # In quarters of a pixel, so that a slow mark does not visibly jump.
        centre = tuple(round(4 * float(value)) for value in at)
        for colour, width in (((0, 0, 0), 4), (COLOURS[name], 2)):
            cv2.circle(image, centre, 4 * _RADIUS_PX, colour, width, cv2.LINE_AA, 2)
    return bytes(cv2.imencode(".jpg", image, _QUALITY)[1])
