"""Landmarks, forward speed and the trial's observables from marker videos, in one call."""

from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sandbot_common import topics
from sandbot_common.arrays import Floats
from sandbot_common.data_frame import data_frame
from sandbot_common.errors import InputError
from sandbot_common.robot import SANDBOT, Robot, read_robot
from sandbot_common.typed import check_types
from sandbot_tracking.calibration import Camera, read_cameras
from sandbot_tracking.film_rate import film_rate
from sandbot_tracking.led import LedEdge
from sandbot_tracking.offline import OfflineTracker
from sandbot_tracking.smooth import smooth
from sandbot_tracking.source import Source
from sandbot_tracking.trial import TrialSummary, summarise

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, repr=False, eq=False)
class Track:
    """The result of ``track``, frame by frame: NaN where a marker is missing; positions in the trackway frame."""

    t_s: Floats
    """(n,) since the first frame."""
    com_m: Floats
    """(n, 3) the centre-of-mass marker."""
    front_axle_m: Floats
    """(n, 3); all NaN without a lateral camera."""
    rear_axle_m: Floats
    """(n, 3); likewise."""
    v_x_m_s: Floats
    """(n,) forward speed, smoothed over the whole video."""
    v_x_sd_m_s: Floats
    """(n,) its standard deviation."""
    start_s: float
    """When the legs started."""
    summary: TrialSummary | None
    """The trial's observables; None if ``omega_rad_s`` was not given."""
    timing: str = ""
    """The source of the frame rate, if calibration and films do not agree."""

    def __repr__(self) -> str:
        missing = int(np.isnan(self.com_m[:, 0]).sum())
        first = f"Track of {self.t_s.size} frames, {missing} without the centre of mass, start at {self.start_s:.3f} s"
        first += f"; {self.timing}" if self.timing else ""
        return first if self.summary is None else f"{first}\n{self.summary}"

    def columns(self) -> dict[str, Floats]:
        """The columns (n,) of the CSV that track_video writes."""
        return {
            "t_s": self.t_s,
            "com_x_m": self.com_m[:, 0],
            "com_y_m": self.com_m[:, 1],
            "front_x_m": self.front_axle_m[:, 0],
            "front_z_m": self.front_axle_m[:, 2],
            "rear_x_m": self.rear_axle_m[:, 0],
            "rear_z_m": self.rear_axle_m[:, 2],
            "v_x_m_s": self.v_x_m_s,
            "v_x_sd_m_s": self.v_x_sd_m_s,
        }

    def to_frame(self) -> "DataFrame":
        """``columns`` as a pandas DataFrame. Raises InputError if pandas is not installed."""
        return data_frame(self.columns(), "columns()")


def track(
    video: str | Path,
    calibration: str | Path | Mapping[str, Camera],
    *,
    lateral: str | Path | None = None,
    omega_rad_s: float | None = None,
    start_s: float | None = None,
    robot: str | Path | Robot = SANDBOT,
) -> Track:
    """Track the markers of a dorsal ``video`` and, if given, of a ``lateral`` one that is synchronous frame by frame.

    ``calibration``: a cameras.yaml, or its cameras by name (``dorsal``, ``lateral``); if it gives no frame rate, the
    film's own is used. With ``omega_rad_s``, the rate at which the legs turn from ``start_s`` on (default: when the
    sync LED goes on, else 0), the result includes the trial's observables. ``robot``: a robot.yaml or a ``Robot``.
    Raises InputError, naming the argument or file.

    >>> import sandbot_tracking
    >>> found = sandbot_tracking.track("dorsal.avi", "cameras.yaml", lateral="lateral.avi", omega_rad_s=12.0)
    >>> found.com_m.shape == (found.t_s.size, 3)
    True
    >>> print(f"{found.summary.speed_m_s:.2f} m/s")
    0.17 m/s
    """
    check_types(track, locals())
    if omega_rad_s is not None and not 0.1 <= omega_rad_s <= 200:
        raise InputError(f"omega_rad_s: {omega_rad_s} is not a leg frequency of 0.1 to 200 rad/s")
    if start_s is not None and not np.isfinite(start_s):
        raise InputError(f"start_s: {start_s} is not a time in s")
    cameras = _cameras(calibration, ("dorsal",) if lateral is None else tuple(topics.VIEWS))
    walker = robot if isinstance(robot, Robot) else read_robot(robot)
    tracker = OfflineTracker(cameras, walker, omega_rad_s=omega_rad_s)
    led_s, timing = _follow(tracker, cameras, str(video), None if lateral is None else str(lateral))
    marks = tracker.landmarks()
    try:
        speed = smooth(marks.t_s, marks.com[:, 0])
    except InputError as error:
        raise InputError(f"{video}: centre-of-mass marker: {error}") from None
    start = start_s if start_s is not None else led_s if led_s is not None else 0.0
    summary = None if omega_rad_s is None else observables(tracker, omega_rad_s, start, walker)
    seen = marks.t_s, marks.com, marks.front_axle, marks.rear_axle
    return Track(*seen, speed.v, np.sqrt(speed.var), start, summary, timing)


def _cameras(calibration: str | Path | Mapping[str, Camera], wanted: tuple[str, ...]) -> dict[str, Camera]:
    given = isinstance(calibration, Mapping)
    cameras = calibration if isinstance(calibration, Mapping) else read_cameras(calibration)
    for name in wanted:
        if name not in cameras:
            raise InputError(f"{'calibration' if given else calibration}: no {name!r} camera in it")
    return {name: cameras[name] for name in wanted}


def _follow(
    tracker: OfflineTracker, cameras: Mapping[str, Camera], dorsal: str, lateral: str | None
) -> tuple[float | None, str]:
    """Track the videos to their ends; returns when the dorsal camera's LED goes on [s], None if that is not seen, and
    the note of ``film_rate``."""
    region = cameras["dorsal"].led_region
    led, edge_s = LedEdge(region) if region else None, None
    with Source(dorsal) as top, Source(lateral) if lateral else nullcontext() as side:
        rate_hz, timing = film_rate(cameras, {film.name: film.rate_hz for film in (top, side) if film is not None})
        for n, (above, beside) in enumerate(zip_longest(top, side or ())):
            t_s = n / rate_hz
            tracker.update(t_s, above, beside)
            if led is not None and above is not None and led.update(above) and edge_s is None:
                edge_s = t_s
    return edge_s, timing


def observables(tracker: OfflineTracker, omega_rad_s: float, start_s: float, robot: Robot = SANDBOT) -> TrialSummary:
    """The trial's observables for legs that turn uniformly at ω from the start on."""
    marks = tracker.landmarks()
    leg_t = np.arange(start_s, marks.t_s[-1] + 1e-9, min(0.005, 0.5 / omega_rad_s))
    turn = omega_rad_s * (leg_t - start_s)
    angles = turn[:, None] - np.array([np.pi / 2] * 3 + [3 * np.pi / 2] * 3)
    landmarks = marks.com[:, 0], marks.front_axle[:, 2], marks.rear_axle[:, 2]
    return summarise(marks.t_s, *landmarks, leg_t, angles, start_s=start_s, robot=robot)
