"""Track marker videos: CSV of landmarks and speed, one row a frame, and a line with the trial's observables."""

import csv
import os
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sandbot_common import cli
from sandbot_common.errors import InputError
from sandbot_common.files import check_output, whole_file, writing
from sandbot_common.robot import SANDBOT, Robot, read_robot
from sandbot_tracking.calibration import Camera, read_cameras
from sandbot_tracking.led import LedEdge
from sandbot_tracking.offline import OfflineTracker
from sandbot_tracking.smooth import Velocity, smooth
from sandbot_tracking.source import Source
from sandbot_tracking.trial import TrialSummary, summarise

COLUMNS = ("t_s", "com_x_m", "com_y_m", "front_x_m", "front_z_m", "rear_x_m", "rear_z_m", "v_x_m_s", "v_x_sd_m_s")


def command(argv: Sequence[str]) -> int:
    """The command line."""
    parser = cli.Parser("track_video", description=__doc__)
    parser.add_argument("dorsal", help="video of the dorsal camera")
    parser.add_argument("lateral", nargs="?", help="video of the lateral camera, frame by frame in step")
    parser.add_argument("--cameras", type=Path, required=True, help="YAML file of the calibrated cameras")
    parser.add_argument("--robot", type=Path, help="YAML file of the robot (default: SandBot)")
    parser.add_argument("--omega", type=float, help="leg frequency [rad/s]: gives the observables")
    parser.add_argument("--start", type=float, help="time the legs start [s]; default: the sync LED, else 0")
    parser.add_argument("--out", type=cli.output, help="CSV to write (default: DORSAL.csv)")
    given = parser.parse_args(argv)
    if given.omega is not None and not 0.1 <= given.omega <= 200:
        raise InputError(f"--omega {given.omega}: 0.1 to 200 rad/s")
    if given.start is not None and not np.isfinite(given.start):
        raise InputError(f"--start {given.start} is not a time in s")
    out = given.out or check_output(Path(given.dorsal).with_suffix(".csv"))
    cameras = read_cameras(given.cameras)
    wanted = ("dorsal", "lateral") if given.lateral else ("dorsal",)
    for name in wanted:
        if name not in cameras:
            raise InputError(f"{given.cameras}: no {name!r} camera in it")
    robot = read_robot(given.robot) if given.robot else SANDBOT
    seen = {name: cameras[name] for name in wanted}
    tracker, led_s = track(seen, given.dorsal, given.lateral, given.omega, robot)
    start_s = given.start if given.start is not None else led_s if led_s is not None else 0.0
    marks = tracker.landmarks()
    try:
        speed = smooth(marks.t_s, marks.com[:, 0])
    except InputError as error:
        raise InputError(f"{given.dorsal}: centre-of-mass marker: {error}") from None
    with writing(out):
        write(out, tracker, speed)
    gone = int(np.isnan(marks.com[:, 0]).sum())
    print(f"{out}: {marks.t_s.size} frames, {gone} without the centre of mass, start at {start_s:.3f} s")
    if given.omega is not None:
        print(line(observables(tracker, given.omega, start_s, robot)))
    return 0


def track(
    cameras: dict[str, Camera],
    dorsal: str,
    lateral: str | None,
    omega_rad_s: float | None,
    robot: Robot = SANDBOT,
) -> tuple[OfflineTracker, float | None]:
    """Track the videos to their ends; also the time of the LED's edge in the dorsal one [s], None if not seen."""
    tracker = OfflineTracker(cameras, robot, omega_rad_s=omega_rad_s)
    region = cameras["dorsal"].led_region
    led, edge_s = LedEdge(region) if region else None, None
    with Source(dorsal) as top:
        side = Source(lateral) if lateral else None
        try:
            for n, (above, beside) in enumerate(zip_longest(top, side or ())):
                t_s = n / cameras["dorsal"].frame_rate_hz
                tracker.update(t_s, above, beside)
                if led is not None and above is not None and led.update(above) and edge_s is None:
                    edge_s = t_s
        finally:
            if side is not None:
                side.close()
    return tracker, edge_s


def observables(tracker: OfflineTracker, omega_rad_s: float, start_s: float, robot: Robot = SANDBOT) -> TrialSummary:
    """The trial's observables with legs that turn evenly at ω from the start on."""
    marks = tracker.landmarks()
    leg_t = np.arange(start_s, marks.t_s[-1] + 1e-9, min(0.005, 0.5 / omega_rad_s))
    turn = omega_rad_s * (leg_t - start_s)
    angles = turn[:, None] - np.array([np.pi / 2] * 3 + [3 * np.pi / 2] * 3)
    landmarks = marks.com[:, 0], marks.front_axle[:, 2], marks.rear_axle[:, 2]
    return summarise(marks.t_s, *landmarks, leg_t, angles, start_s=start_s, robot=robot)


def write(path: Path, tracker: OfflineTracker, speed: Velocity) -> None:
    """The CSV, whole or not at all; empty cells where a marker is missing."""
    marks = tracker.landmarks()
    sd = np.sqrt(speed.var)
    table: NDArray[np.float64] = np.column_stack(
        (marks.t_s, marks.com[:, :2], marks.front_axle[:, ::2], marks.rear_axle[:, ::2], speed.v, sd)
    )
    with whole_file(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(COLUMNS)
        rows.writerows([["" if np.isnan(value) else f"{value:.6f}" for value in row] for row in table])


def line(summary: TrialSummary) -> str:
    """The observables in one line."""
    numbers = (
        f"speed {summary.speed_m_s * 100:.2f} ± {summary.speed_sd_m_s * 100:.2f} cm/s, "
        f"peak {summary.peak_speed_m_s * 100:.2f} cm/s, lift {summary.lift_m * 1000:.2f} mm, "
        f"first step {summary.first_step_m * 1000:.2f} mm, {summary.cycles} steady periods, {summary.gaps} gaps"
    )
    return f"{numbers}; {summary.reason}" if summary.reason else numbers


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    # FFmpeg writes its own line about a bad file; read once, when the first video is opened.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    return cli.run(command, argv)
