"""Calibrate a camera of the trackway: from a table of pixels and metres, and pictures of a board, to a cameras.yaml
entry.

A table (CSV with the columns u_px, v_px, x_m, y_m, z_m) gives where the camera stands; with points that do not lie
in one plane, or with --intrinsics, that is well determined. Pictures of a chessboard or a ChArUco board, a video or a
folder of images, give lens and focal length; the table then adds the place.
"""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml
from numpy.typing import NDArray

from sandbot_common import cli, topics
from sandbot_common.errors import InputError
from sandbot_common.files import read_csv, read_yaml, write_text, writing
from sandbot_tracking.calibration import HIGH_HZ, LOW_HZ, Camera, camera_from_mapping, read_cameras

if TYPE_CHECKING:
    from sandbot_tracking.lens import Lens

Floats = NDArray[np.float64]

DICTIONARIES = ("4X4_50", "4X4_250", "5X5_100", "6X6_250", "APRILTAG_36h11")
USUAL_SIZE = (640, 480)
BOARD_DEFAULTS = {"pattern": (9, 6), "square": 0.02}
CHARUCO_DEFAULTS = {"dictionary": "4X4_50", "marker": 0.75}
COLUMNS = ("u_px", "v_px", "x_m", "y_m", "z_m")


def read_table(path: Path) -> tuple[Floats, Floats]:
    """Pixels (n, 2) and points (n, 3) [m] of a CSV. Raises InputError."""
    header, numbered = read_csv(path)
    rows = list(numbered)
    if missing := [name for name in COLUMNS if not rows or name not in header]:
        raise InputError(
            f"{path}: column {missing[0]!r} is missing or the table is empty; needed: {', '.join(COLUMNS)}"
        )
    table = np.empty((len(rows), 5))
    for n, (number, row) in enumerate(rows):
        for column, name in enumerate(COLUMNS):
            try:
                table[n, column] = float(row[name])
            except ValueError:
                table[n, column] = np.nan
            if not np.isfinite(table[n, column]):
                raise InputError(f"{path}: row {number}: {name}: {row[name]!r} is not a number")
    if len(table) < 6:
        raise InputError(f"{path}: {len(table)} points, at least 6 are needed")
    return np.ascontiguousarray(table[:, :2]), np.ascontiguousarray(table[:, 2:])


def command(argv: Sequence[str]) -> int:
    """The command line."""
    parser = cli.Parser("calibrate", description=__doc__)
    parser.add_argument("table", type=Path, help=f"CSV of {', '.join(COLUMNS)}")
    parser.add_argument("--name", required=True, choices=tuple(topics.VIEWS), help="which camera this is")
    parser.add_argument(
        "--size", type=int, nargs=2, metavar=("WIDTH", "HEIGHT"),
        help="of its frames [px] (default: that of the source of the lens, else 640 480)",
    )  # fmt: skip
    parser.add_argument("--rate", type=float, help="its frames per second (default: none, a film's own rate is used)")
    parser.add_argument("--plane", type=float, required=True, help="z (dorsal) or y (lateral) of its markers [m]")
    parser.add_argument("--chessboard", metavar="PATH", help="video or folder of images of a chessboard, for the lens")
    parser.add_argument("--charuco", metavar="PATH", help="the same for a ChArUco board, which may be partly in view")
    parser.add_argument("--pattern", type=int, nargs=2, help="inner corners of the board (default: 9 6)")
    parser.add_argument("--square", type=float, help="side of its squares [m] (default: 0.02)")
    parser.add_argument("--dictionary", choices=DICTIONARIES, help="markers of the ChArUco board (default: 4X4_50)")
    parser.add_argument("--marker", type=float, help="their side as a fraction of the squares' (default: 0.75)")
    parser.add_argument("--intrinsics", type=Path, help="cameras.yaml with the lens of that camera, which is kept")
    parser.add_argument("--out", type=_changed, required=True, help="cameras.yaml to write or to change")
    given = parser.parse_args(argv)
    ways = [f"--{name}" for name in ("chessboard", "charuco", "intrinsics") if getattr(given, name)]
    if len(ways) > 1:
        raise InputError(f"{' and '.join(ways)} both give the lens: choose one")
    _set_defaults(given, BOARD_DEFAULTS, ("chessboard", "charuco"))
    _set_defaults(given, CHARUCO_DEFAULTS, ("charuco",))
    _check(given)
    # Imported only after parsing, so that --help and errors in the options are printed at once.
    from sandbot_tracking.lens import entry, place, reprojection_px

    content = _entries(given.out)
    pixels, points = read_table(given.table)
    size = _size(given)
    lens = _lens(given, pixels, points, size)
    position, rotation = place(pixels, points, lens)
    plane = {"normal": "z" if given.name == "dorsal" else "y", "offset_m": given.plane}
    found = entry(lens, position, rotation, size, plane)
    found |= {"frame_rate_hz": given.rate} if given.rate is not None else {}
    camera = camera_from_mapping(found, str(given.table))
    kept = {key: value for key, value in content.get(given.name, {}).items() if key not in found}
    with writing(given.out):
        write_text(given.out, yaml.safe_dump({**content, given.name: {**found, **kept}}, sort_keys=False))
    print(f"{given.out}: {given.name}, reprojection error {reprojection_px(camera, pixels, points):.3f} px rms")
    return 0


def _changed(text: str) -> Path:
    """An output that is also read, and so, unlike a plain ``cli.output``, may be the file of --intrinsics."""
    return cli.output(text)


def _set_defaults(given: Any, defaults: dict[str, Any], boards: tuple[str, ...]) -> None:
    """Fill in options that were not given. Raises InputError if one was given without any of the ``boards``."""
    for name, value in defaults.items():
        if getattr(given, name) is None:
            setattr(given, name, value)
        elif not any(getattr(given, board) for board in boards):
            ways = " or ".join(f"--{board}" for board in boards)
            raise InputError(f"--{name}: only the board of {ways} has one; give that too")


def _check(given: Any) -> None:
    if given.size is not None and min(given.size) < 1:
        raise InputError(f"--size {given.size[0]} {given.size[1]}: width and height are 1 or more pixels")
    if given.rate is not None and not LOW_HZ <= given.rate <= HIGH_HZ:
        raise InputError(f"--rate {given.rate}: {LOW_HZ:g} to {HIGH_HZ:g} frames/s")
    if min(given.pattern) < 3:
        raise InputError(f"--pattern {given.pattern[0]} {given.pattern[1]}: 3 or more inner corners each way")
    if not 0 < given.square < 10:
        raise InputError(f"--square {given.square}: the side of a square in m, above 0")
    if not 0 < given.marker < 1:
        raise InputError(f"--marker {given.marker}: between 0 and 1, in parts of a square's side")


def _entries(path: Path) -> dict[str, Any]:
    """The cameras already in the output file."""
    content = dict(read_yaml(path)) if path.exists() else {}
    for name, values in content.items():
        if not isinstance(values, dict):
            raise InputError(f"{path}: {name}: expected the entry of a camera, got {values!r}")
    return content


def _size(given: Any) -> tuple[int, int]:
    """Width and height of the frames [px], which must be those of the source of the lens, as it depends on them."""
    source, seen = _seen_size(given)
    size = tuple(given.size or seen or USUAL_SIZE)
    if seen not in (None, size):
        raise InputError(
            f"{source}: {seen[0]}x{seen[1]} px, but --size says {size[0]}x{size[1]}: leave --size out if the camera "
            "films like that, else take the lens at the size it films"
        )
    return size


def _seen_size(given: Any) -> tuple[str, tuple[int, int] | None]:
    """The source of the lens and its frame size [px]; None for the table alone or a folder without pictures."""
    from sandbot_tracking.lens import picture_size

    if given.intrinsics is not None:
        known = _known_camera(given)
        return f"{given.intrinsics}: {given.name}", (known.width, known.height)
    pictures = given.chessboard or given.charuco
    return pictures, picture_size(pictures) if pictures else None


def _known_camera(given: Any) -> Camera:
    """The camera of --intrinsics."""
    cameras = read_cameras(given.intrinsics)
    if given.name not in cameras:
        raise InputError(f"{given.intrinsics}: no {given.name!r} camera in it")
    return cameras[given.name]


def _lens(given: Any, pixels: Floats, points: Floats, size: tuple[int, int]) -> "Lens":
    from sandbot_tracking.lens import Board, Lens, lens_from_board, lens_from_points

    if given.chessboard:
        return lens_from_board(given.chessboard, Board(tuple(given.pattern), given.square))
    if given.charuco:
        return lens_from_board(given.charuco, Board(tuple(given.pattern), given.square, given.dictionary, given.marker))
    if given.intrinsics is None:
        return lens_from_points(pixels, points, size)
    known = _known_camera(given)
    return Lens(known.matrix, np.array(known.distortion))


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    # Suppresses FFmpeg's own message about a bad file; read once, when the first video is opened.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    return cli.run(command, argv)
