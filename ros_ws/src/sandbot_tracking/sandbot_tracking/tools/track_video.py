"""Track marker videos: CSV of landmarks and speed, one row per frame, and a line with the trial's observables."""

import csv
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from sandbot_common import cli
from sandbot_common.errors import InputError
from sandbot_common.files import check_output, whole_file, writing
from sandbot_common.robot import SANDBOT

if TYPE_CHECKING:
    from sandbot_tracking.videos import Track


def command(argv: Sequence[str]) -> int:
    """The command line."""
    parser = cli.Parser("track_video", description=__doc__)
    parser.add_argument("dorsal", type=Path, help="video of the dorsal camera")
    parser.add_argument("lateral", type=Path, nargs="?", help="video of the lateral camera, with the same frames")
    parser.add_argument("--cameras", type=Path, required=True, help="YAML file of the calibrated cameras")
    parser.add_argument("--robot", type=Path, help="YAML file of the robot (default: SandBot)")
    parser.add_argument("--omega", type=float, help="leg frequency [rad/s], needed for the observables")
    parser.add_argument("--start", type=float, help="time at which the legs start [s] (default: the sync LED, else 0)")
    parser.add_argument("--out", type=cli.output, help="CSV to write (default: DORSAL.csv)")
    given = parser.parse_args(argv)
    if given.omega is not None and not 0.1 <= given.omega <= 200:
        raise InputError(f"--omega {given.omega}: 0.1 to 200 rad/s")
    if given.start is not None and not math.isfinite(given.start):
        raise InputError(f"--start {given.start} is not a time in s")
    out = given.out or check_output(given.dorsal.with_suffix(".csv"))
    # Imported only after parsing, so that --help and errors in the options are printed at once.
    from sandbot_tracking.videos import track

    found = track(
        given.dorsal,
        given.cameras,
        lateral=given.lateral,
        omega_rad_s=given.omega,
        start_s=given.start,
        robot=given.robot or SANDBOT,
    )
    with writing(out):
        write(out, found)
    print(f"{out}: {str(found).removeprefix('Track of ')}")
    return 0


def write(path: Path, found: "Track") -> None:
    """Write the CSV atomically; cells are empty where a marker is missing."""
    columns = found.columns()
    with whole_file(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            rows.writerow(["" if math.isnan(value) else f"{value:.6f}" for value in row])


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    # Suppresses FFmpeg's own message about a bad file; read once, when the first video is opened.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    return cli.run(command, argv)
