"""penetrometer: press a leg into the virtual lab's ground and read the force.

With the belly at rest on a bed prepared to φ, one leg is turned slowly down until its lowest point is at each depth.
"""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from sandbot_common import cli
from sandbot_common.errors import InputError
from sandbot_common.files import write_text, writing


def main(argv: Sequence[str] | None = None) -> int:
    """Console script; exit code as in sandbot_common.cli."""
    return cli.run(_command, argv)


def _command(argv: Sequence[str]) -> None:
    parser = cli.Parser(prog="penetrometer", description=__doc__)
    parser.add_argument("--world", type=Path, help="the virtual lab's world.yaml (default: nothing is hidden)")
    parser.add_argument("--phi", type=float, nargs="+", required=True, help="volume fractions to prepare")
    parser.add_argument(
        "--depth-m", type=float, nargs="+", metavar="M", help="depths to read at (default: 0.015 0.025 0.035 0.044)"
    )
    parser.add_argument("--seed", type=int, default=0, help="random seed of the readings (default: 0)")
    parser.add_argument("--out", type=cli.output, required=True, metavar="FILE.csv", help="the readings")
    args = parser.parse_args(argv)
    if args.seed < 0:
        raise InputError(f"--seed: {args.seed} is not a seed; 0 or more")
    # Imported only once the options are parsed, so that --help and errors are quick.
    from sandbot_lab.penetrometer import COLUMNS, DEPTHS_M, press
    from sandbot_lab.world import World, read_world

    world = World() if args.world is None else read_world(args.world)
    rows = press(world, args.phi, args.depth_m or DEPTHS_M, args.seed)
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    with writing(args.out):
        write_text(args.out, text.getvalue())
    print(f"{args.out}: {len(rows)} readings")
