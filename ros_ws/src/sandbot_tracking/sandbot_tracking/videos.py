"""Landmarks, forward speed and the trial's observables from marker videos, in one call."""

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
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
from sandbot_tracking.camera_motion import CameraMotion
from sandbot_tracking.film_rate import FrameNumbers, film_rate
from sandbot_tracking.led import LedEdge
from sandbot_tracking.offline import Landmarks, OfflineTracker
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
    """The source of the frame rate, if calibration and films do not agree, and how many frames are missing."""
    moved: str = ""
    """Which camera has moved since its first frame, so that positions are wrong."""

    def __repr__(self) -> str:
        missing = int(np.isnan(self.com_m[:, 0]).sum())
        first = f"Track of {self.t_s.size} frames, {missing} without the centre of mass, start at {self.start_s:.3f} s"
        first = "; ".join(filter(None, (first, self.timing, self.moved)))
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
    films = _Films(cameras, str(video), None if lateral is None else str(lateral))
    led_s = films.follow(tracker)
    marks = replace(tracker.landmarks(), t_s=films.t_s)
    try:
        speed = smooth(marks.t_s, marks.com[:, 0])
    except InputError as error:
        raise InputError(f"{video}: centre-of-mass marker: {error}") from None
    start = start_s if start_s is not None else led_s if led_s is not None else 0.0
    summary = None if omega_rad_s is None else observables(marks, omega_rad_s, start, walker)
    if summary is not None and films.moved:
        summary = TrialSummary.of_nothing(summary.frames, summary.gaps, "a camera has moved")
    seen = marks.t_s, marks.com, marks.front_axle, marks.rear_axle
    return Track(*seen, speed.v, np.sqrt(speed.var), start, summary, films.timing, films.moved)


def _cameras(calibration: str | Path | Mapping[str, Camera], wanted: tuple[str, ...]) -> dict[str, Camera]:
    given = isinstance(calibration, Mapping)
    cameras = calibration if isinstance(calibration, Mapping) else read_cameras(calibration)
    for name in wanted:
        if name not in cameras:
            raise InputError(f"{'calibration' if given else calibration}: no {name!r} camera in it")
    return {name: cameras[name] for name in wanted}


class _Films:
    """The videos of one trial, of cameras in step."""

    def __init__(self, cameras: Mapping[str, Camera], dorsal: str, lateral: str | None) -> None:
        self._cameras, self._dorsal, self._lateral = cameras, dorsal, lateral
        self.t_s: Floats = np.empty(0)
        """Time of each frame since the first, (n,); set by ``follow``, like the others."""
        self.timing = self.moved = ""

    def follow(self, tracker: OfflineTracker) -> float | None:
        """Track the videos to their ends; returns when the dorsal camera's LED goes on [s], None if it is not seen."""
        region = self._cameras["dorsal"].led_region
        led, edge = LedEdge(region) if region else None, None
        with Source(self._dorsal) as top, Source(self._lateral) if self._lateral else nullcontext() as side:
            films = [film for film in (top, side) if film is not None]
            rate_hz, _ = film_rate(self._cameras, {film.name: film.rate_hz for film in films})
            motions, numbers = [CameraMotion(rate_hz) for _ in films], [FrameNumbers(film.rate_hz) for film in films]
            for n, pair in enumerate(zip_longest(*films)):
                shown = [each for each in zip(films, pair, motions, numbers, strict=True) if each[1] is not None]
                number = max(of.add(film.stamp_s) for film, _, _, of in shown)
                for _, frame, motion, _ in shown:
                    motion.see(frame)
                above, beside = (*pair, None)[:2]
                tracker.update(number / rate_hz, above, beside)
                if led is not None and above is not None and led.update(above) and edge is None:
                    edge = n
        self._set_times(films, numbers)
        self.moved = "; ".join(
            f"{film.name}: the camera has moved by {motion.moved_px:.1f} px during the film: positions are wrong"
            for film, motion in zip(films, motions, strict=True)
            if motion.moved_px
        )
        return None if edge is None else float(self.t_s[edge])

    def _set_times(self, films: Sequence[Source], numbers: Sequence[FrameNumbers]) -> None:
        """Times by the films' own stamps where frames are missing. Raises InputError if not the same are in both."""
        for n, (above, beside) in enumerate(zip(numbers[0].numbers, numbers[-1].numbers, strict=False)):
            if above != beside:
                raise InputError(
                    f"{films[0].name}, {films[-1].name}: not in step from frame {n} on, by their own time stamps: "
                    "frames are missing in one of them"
                )
        longest = max(numbers, key=lambda of: len(of.numbers))
        # With frames missing, the rate in a container is a mean over the gaps.
        own = [of.rate_hz if longest.missing else film.rate_hz for film, of in zip(films, numbers, strict=True)]
        rate_hz, timing = film_rate(self._cameras, {film.name: hz for film, hz in zip(films, own, strict=True)})
        lost = f"{longest.missing} frames are missing in the film" if longest.missing else ""
        self.t_s = np.array(longest.numbers) / rate_hz
        self.timing = "; ".join(filter(None, (timing, lost)))


def observables(marks: Landmarks, omega_rad_s: float, start_s: float, robot: Robot = SANDBOT) -> TrialSummary:
    """The trial's observables for legs that turn uniformly at ω from the start on."""
    leg_t = np.arange(start_s, marks.t_s[-1] + 1e-9, min(0.005, 0.5 / omega_rad_s))
    turn = omega_rad_s * (leg_t - start_s)
    angles = turn[:, None] - np.array([np.pi / 2] * 3 + [3 * np.pi / 2] * 3)
    landmarks = marks.com[:, 0], marks.front_axle[:, 2], marks.rear_axle[:, 2]
    return summarise(marks.t_s, *landmarks, leg_t, angles, start_s=start_s, robot=robot)
