"""export: write one trial, with the model beside it, as a Rerun recording (.rrd) or a clip (.mp4)."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from sandbot_common import cli
from sandbot_common.errors import InputError
from sandbot_model.tools import arguments

KINDS = (".rrd", ".mp4")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    return cli.run(_export, argv)


def _export(argv: Sequence[str]) -> None:
    parser = cli.Parser(prog="export", description=__doc__)
    parser.add_argument("data", type=Path, nargs="+", metavar="DATA", help="a campaign folder, or bags")
    parser.add_argument("--trial", required=True, metavar="NAME", help="name of the trial in the trials table")
    parser.add_argument(
        "--out", type=cli.output, required=True, metavar="FILE", help=f"file to write; its name ends in {_either()}"
    )
    arguments.add_model(parser)
    parser.add_argument("--effects", default="", metavar="a,b", help="effects in the model that is shown")
    arguments.add_catalogue(parser)
    arguments.add_setting(parser)
    args = parser.parse_args(argv)
    if args.out.suffix not in KINDS:
        raise InputError(f"--out {args.out}: a name that ends in {_either()} is needed")
    if args.out.suffix == ".rrd":
        from sandbot_model.explore.rrd import rerun

        rerun()
    _write(args)


def _write(args: argparse.Namespace) -> None:
    from sandbot_common.files import whole_file, writing
    from sandbot_model.explore.clip import write_clip
    from sandbot_model.explore.rrd import write_rrd
    from sandbot_model.explore.scene import scene_of
    from sandbot_model.report.provenance import bags_of
    from sandbot_record.bags.reader import Bag
    from sandbot_record.trials.film import film_of

    trials, robot_line, steps = arguments.ladder(args)
    bags = bags_of(args.data)
    scene = scene_of(trials, bags, steps[-1], args.trial)
    bag = Bag.open(bags[args.trial])
    film = film_of(bag)
    print(robot_line)
    with writing(args.out):
        if args.out.suffix == ".rrd":
            write_rrd(args.out, scene, bag, film)
        else:
            with whole_file(args.out) as part:
                write_clip(part, scene, film)
    print(f"export: {args.out}" + ("" if film else " (its bag kept no frames: without film)"))


def _either() -> str:
    return " or ".join(KINDS)


if __name__ == "__main__":
    raise SystemExit(main())
