"""A film strip from a bag: a few of its lateral frames with the tracked markers drawn on them."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbot_common import topics
from sandbot_record.bags import metadata
from sandbot_record.bags.reader import Bag
from sandbot_record.trials.film import KEPT, film_of
from sandbot_record.trials.from_bags import bags_in

Strip = list[tuple[bytes, str]]
"""(JPEG bytes, caption) of each frame."""
FRAMES = 4
"""Number of frames of a strip."""


def film_strip(data: Path) -> Strip:
    """``of_bag`` for the first bag of ``data`` with a film; empty if there is none."""
    strips = (of_bag(path) for path in (bags_in(data) if data.is_dir() else []))
    return next(filter(None, strips), [])


def of_bag(path: Path) -> Strip:
    """``FRAMES`` of one steady step; empty if the bag has no film. Raises InputError."""
    # metadata.yaml tells whether there are frames, without reading the bag.
    info = metadata.read(path) if path.is_dir() else None
    kept = info is not None and any(topic.name in KEPT and topic.count for topic in info.topics)
    film = film_of(Bag.open(path)) if kept else None
    if film is None:
        return []
    moments = _moments(film.marks[topics.FRONT_AXLE], film.zero_ns)
    wanted = [int(np.argmin(np.abs(film.stamp_ns - t))) for t in moments]
    return [(film.jpeg(i), f"t = {film.time_s[i]:.2f} s ({path.name}, lateral camera)") for i in wanted]


def _moments(axle: Any, zero_ns: int) -> NDArray[np.float64]:
    """Times [ns] over one rise and fall of the axle, around its highest point after the first 0.4 s."""
    stamps, height = axle.stamp_ns, np.nan_to_num(axle["point.z"])
    steady = stamps > zero_ns + 400_000_000
    if not steady.any():
        steady = stamps > zero_ns
    top = int(stamps[steady][np.argmax(height[steady])])
    return np.asarray(top + 1e9 * np.linspace(-0.06, 0.06, FRAMES))
