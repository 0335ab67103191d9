"""atlas: the figures of Li et al. 2009 (1c-e, 2a-c, 3a-d, 4a-b) drawn from your trials, at journal widths."""

import argparse
import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from sandbot_common import cli
from sandbot_common.errors import InputError
from sandbot_common.files import check_output
from sandbot_common.terminal import WIDTH
from sandbot_model.tools import arguments

if TYPE_CHECKING:
    from sandbot_model.report.atlas.material import Material, Published

WIDTHS_MM = (85.0, 178.0)
FORMATS = ("pdf", "svg", "png")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    return cli.run(_atlas, argv)


def _atlas(argv: Sequence[str]) -> None:
    parser = cli.Parser(prog="atlas", description=__doc__)
    parser.add_argument("data", type=Path, nargs="+", metavar="DATA", help="a campaign folder, bags, or a trials CSV")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="where to draw (default: DATA/atlas, or ./atlas)")
    arguments.add_model(parser)
    parser.add_argument("--effects", default="", metavar="a,b", help="effects in the model that is drawn")
    arguments.add_catalogue(parser)
    arguments.add_setting(parser)
    parser.add_argument(
        "--beside", type=Path, metavar="FILE.csv", help="trials CSV of published points to draw as well"
    )
    parser.add_argument(
        "--width", type=float, choices=WIDTHS_MM, help="width of all figures [mm] (default: each figure's own)"
    )
    parser.add_argument(
        "--formats", type=_formats, default=FORMATS, help=f"which of {','.join(FORMATS)} (default: all)"
    )
    args = parser.parse_args(argv)
    data = args.data[0]
    folder = args.out or (data if data.is_dir() else Path()) / "atlas"
    _check_folder(folder)
    _draw(args, folder)


def _draw(args: argparse.Namespace, folder: Path) -> None:
    from tqdm import tqdm

    from sandbot_common.parallel import one_per_cpu
    from sandbot_model.report.atlas.plates import PLATES, write

    material = _material(args)
    folder.mkdir(parents=True, exist_ok=True)
    with one_per_cpu().map() as draw_all:
        drawing = write(folder, material, args.width, args.formats, draw_all)
        shown = tqdm(drawing, total=len(PLATES), desc="atlas", unit="plate", file=sys.stderr, disable=None)
        captions = {plate.number: caption for plate, caption in shown}
    for number, caption in captions.items():
        print(textwrap.fill(f"{number:4} {caption}", WIDTH, subsequent_indent=" " * 5))
    drawn = sum(not caption.startswith("not drawn: ") for caption in captions.values())
    print(f"\natlas: {drawn} of {len(PLATES)} figures in {folder} ({', '.join(args.formats)}), with captions.json")


def _material(args: argparse.Namespace) -> "Material":
    from sandbot_model.report.atlas.collect import collect
    from sandbot_model.report.provenance import bags_of

    trials, robot_line, steps = arguments.ladder(args)
    beside = None if args.beside is None else _published(args.beside)
    print(robot_line)
    return collect(trials, steps, bags_of(args.data), beside)


def _published(path: Path) -> "Published":
    from sandbot_model.report.atlas.material import Published
    from sandbot_record.trials.read import read

    points = read(path)
    points = points.select(points.usable)
    return Published(path.stem, points.phi, points.omega_rad_s, points.speed_m_s)


def _formats(text: str) -> tuple[str, ...]:
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    if not names or any(name not in FORMATS for name in names):
        raise argparse.ArgumentTypeError(f"{text!r} is not a list of {', '.join(FORMATS)}")
    return names


def _check_folder(folder: Path) -> None:
    """Check before minutes of work, not after. Raises InputError."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out {folder}: is a file, a folder is needed")
    check_output(folder / "figure")


if __name__ == "__main__":
    raise SystemExit(main())
