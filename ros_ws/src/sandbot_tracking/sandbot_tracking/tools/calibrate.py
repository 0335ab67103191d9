"""Calibrate a camera of the trackway: from a table of pixels and metres, and pictures of a board, to a cameras.yaml
entry.

A table (CSV with the columns u_px, v_px, x_m, y_m, z_m) gives the camera's pose, which is well determined if the points
do not lie in one plane, or with --intrinsics. Pictures of a chessboard or a ChArUco board, a video or a folder of
images, give lens and focal length; the table is then needed for the pose only.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from sandbot_common import cli, topics
from sandbot_common.arrays import Floats
from sandbot_common.delimited_text import number_in, read_csv
from sandbot_common.errors import InputError
from sandbot_common.files import write_text, writing
from sandbot_common.yaml_text import read_yaml
from sandbot_tracking.calibration import HIGH_HZ, LOW_HZ, Camera, camera_from_mapping, read_cameras

if TYPE_CHECKING:
    from sandbot_tracking.lens import Lens


DICTIONARIES = ("4X4_50", "4X4_250", "5X5_100", "6X6_250", "APRILTAG_36h11")
USUAL_SIZE = (640, 480)
BOARD_DEFAULTS = {"pattern": (9, 6), "square": 0.02}
CHARUCO_DEFAULTS = {"dictionary": "4X4_50", "marker": 0.75}
COLUMNS = ("u_px", "v_px", "x_m", "y_m", "z_m")
LEAST_POINTS, FARTHEST_M = 6, 10.0
LARGEST_RMS = 0.003
"""Largest reprojection error, as a fraction of the width of the picture (2 of 640 pixels): points are read off to about
a pixel, while a row with another's pixels, or columns in the wrong order, are off by more."""
TO_BLAME = 3.0
"""Factor by which the error falls without the one row that is to blame for it."""


@dataclass(frozen=True)
class Table:
    """Points in space and where the camera sees them."""

    path: Path
    rows: tuple[int, ...]
    """Line numbers in the file."""
    pixels: Floats
    """(n, 2)."""
    points_m: Floats
    """(n, 3)."""

    def without(self, at: int) -> "Table":
        """All points but one."""
        rows = self.rows[:at] + self.rows[at + 1 :]
        return Table(self.path, rows, np.delete(self.pixels, at, axis=0), np.delete(self.points_m, at, axis=0))


@dataclass(frozen=True)
class _Fit:
    lens: "Lens"
    position_m: Floats
    rotation: Floats
    rms_px: float


def read_table(path: Path) -> Table:
    """The points of a CSV. Raises InputError."""
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
                table[n, column] = number_in(row[name])
            except ValueError:
                table[n, column] = np.nan
            if not np.isfinite(table[n, column]):
                raise InputError(f"{path}: row {number}: {name}: {row[name]!r} is not a number")
            if name.endswith("_m") and abs(table[n, column]) > FARTHEST_M:
                raise InputError(
                    f"{path}: row {number}: {name}: {row[name]} is outside [-{FARTHEST_M:g}, {FARTHEST_M:g}] m; "
                    "divide mm by 1000"
                )
    if len(table) < LEAST_POINTS:
        raise InputError(f"{path}: {len(table)} points, at least {LEAST_POINTS} are needed")
    numbers = tuple(number for number, _ in rows)
    return Table(path, numbers, np.ascontiguousarray(table[:, :2]), np.ascontiguousarray(table[:, 2:]))


def _parser() -> cli.Parser:
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
    parser.add_argument("--marker", type=float, help="side of these markers over that of the squares (default: 0.75)")
    parser.add_argument("--intrinsics", type=Path, help="cameras.yaml with the lens of that camera, which is kept")
    parser.add_argument("--out", type=_changed, required=True, help="cameras.yaml to write or to change")
    return parser


def command(argv: Sequence[str]) -> int:
    """The command line."""
    given = _parser().parse_args(argv)
    ways = [f"--{name}" for name in ("chessboard", "charuco", "intrinsics") if getattr(given, name)]
    if len(ways) > 1:
        raise InputError(f"{' and '.join(ways)} both give the lens: choose one")
    _set_defaults(given, BOARD_DEFAULTS, ("chessboard", "charuco"))
    _set_defaults(given, CHARUCO_DEFAULTS, ("charuco",))
    _check(given)
    content = _entries(given.out)
    table = read_table(given.table)
    size = _size(given)
    fit = _checked_fit(table, _lens(given), size)
    camera = _camera(given, fit, size)
    _check_view(camera, table)
    kept = {key: value for key, value in content.get(given.name, {}).items() if key not in camera}
    with writing(given.out):
        write_text(given.out, yaml.safe_dump({**content, given.name: {**camera, **kept}}, sort_keys=False))
    print(f"{given.out}: {given.name}, reprojection error {fit.rms_px:.3f} px rms")
    return 0


def _camera(given: Any, fit: _Fit, size: tuple[int, int]) -> dict[str, Any]:
    """The entry of cameras.yaml."""
    from sandbot_tracking.lens import entry

    plane = {"normal": "z" if given.name == "dorsal" else "y", "offset_m": given.plane}
    found = entry(fit.lens, fit.position_m, fit.rotation, size, plane)
    return found | ({"frame_rate_hz": given.rate} if given.rate is not None else {})


def _fit(table: Table, lens: "Lens | None", size: tuple[int, int]) -> _Fit:
    """The camera that sees the points best; without a lens, they give it too. Raises InputError."""
    # Imported only after parsing, so that --help and errors in the options are printed at once.
    from sandbot_tracking.lens import lens_from_points, misfits_px, place

    try:
        lens = lens or lens_from_points(table.pixels, table.points_m, size)
        stands = place(table.pixels, table.points_m, lens)
    except InputError as error:
        raise InputError(f"{table.path}: {error}") from None
    misfits = misfits_px(table.pixels, table.points_m, lens, *stands)
    return _Fit(lens, *stands, float(np.sqrt(np.mean(misfits**2))))


def _checked_fit(table: Table, lens: "Lens | None", size: tuple[int, int]) -> _Fit:
    """``_fit``; raises InputError if no camera sees these points, naming the row that alone is to blame, if one is."""
    fit, most_px = _fit(table, lens, size), LARGEST_RMS * size[0]
    if fit.rms_px <= most_px:
        return fit
    others = [table.without(at) for at in range(len(table.rows))] if len(table.rows) > LEAST_POINTS else []
    errors = [_rms_px(other, lens, size) for other in others]
    said = f"{table.path}: no camera sees these points there: {fit.rms_px:.1f} px rms, {most_px:.1f} at most"
    if min(errors, default=np.inf) > fit.rms_px / TO_BLAME:
        raise InputError(f"{said}; are columns exchanged, rows mixed up, or v_px counted upwards?")
    raise InputError(f"{said}, but {min(errors):.1f} without row {table.rows[int(np.argmin(errors))]}: correct it")


def _rms_px(table: Table, lens: "Lens | None", size: tuple[int, int]) -> float:
    try:
        return _fit(table, lens, size).rms_px
    except InputError:
        return np.inf


def _check_view(entry: dict[str, Any], table: Table) -> None:
    """Raise InputError if the camera does not look at its plane."""
    camera = camera_from_mapping(entry, str(table.path))
    if not np.isfinite(camera.to_pixels(camera.to_plane(table.pixels))).all():
        plane = f"{camera.plane.normal} = {camera.plane.offset_m:g} m"
        raise InputError(f"{table.path}: the camera found does not look at the plane {plane}: are the axes exchanged?")


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


def _lens(given: Any) -> "Lens | None":
    """The lens that a board or --intrinsics gives."""
    from sandbot_tracking.lens import Board, Lens, lens_from_board

    if given.chessboard:
        return lens_from_board(given.chessboard, Board(tuple(given.pattern), given.square))
    if given.charuco:
        return lens_from_board(given.charuco, Board(tuple(given.pattern), given.square, given.dictionary, given.marker))
    if given.intrinsics is None:
        return None
    known = _known_camera(given)
    return Lens(known.matrix, np.array(known.distortion))


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    # Suppresses FFmpeg's own message about a bad file; read once, when the first video is opened.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    return cli.run(command, argv)
