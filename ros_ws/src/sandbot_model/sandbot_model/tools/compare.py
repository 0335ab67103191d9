"""compare: fit a model, with effects added one by one, and show each step's error beside the noise floor."""

import sys
from collections.abc import Sequence

import numpy as np
from tqdm import tqdm

from sandbot_common import cli
from sandbot_model.bootstrap import bootstrap
from sandbot_model.catalogue import catalogue
from sandbot_model.cells import cells_of
from sandbot_model.compare import compare, geometry_lock, to_json
from sandbot_model.fit import fit
from sandbot_model.model import model_of
from sandbot_model.report import write_comparison
from sandbot_model.tools import arguments, tables
from sandbot_record import trials as trials_table
from sandbot_record.film_strip import film_strip


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    return cli.run(_compare, argv)


def _compare(argv: Sequence[str]) -> None:
    parser = cli.Parser(prog="compare", description=__doc__)
    arguments.add_data(parser)
    parser.add_argument("--effects", default="", metavar="a,b", help="effects to add, in this order")
    arguments.add_catalogue(parser)
    parser.add_argument("--bootstrap", type=int, metavar="N", help="standard errors from N draws of the trials, too")
    args = parser.parse_args(argv)
    effects = catalogue(args.effects_from, args.effect)
    names = [name.strip() for name in args.effects.split(",") if name.strip()]
    trials = trials_table.read(args.data)
    cells = cells_of(trials)
    steps = compare(cells, effects, names, base=args.model)
    print(tables.data_line(steps[0]), "\n")
    print(tables.ladder(steps), "\n")
    print(tables.parameters(steps[-1]), "\n")
    print(tables.fails(steps[-1]), "\n")
    print(tables.lock_line(geometry_lock(cells)))
    content = to_json(steps)
    if args.bootstrap is not None:
        model = model_of(args.model, names, effects)
        drawn = bootstrap(
            trials,
            lambda resampled: fit(model, resampled, steps[-1].known),
            args.bootstrap,
            np.random.default_rng(0),
            lambda counting: tqdm(counting, desc="bootstrap", unit="draw", file=sys.stderr, disable=None),
        )
        print("\n" + tables.bootstrap(steps[-1], drawn, args.bootstrap))
        content["bootstrap"] = {"draws": args.bootstrap, "stderr": drawn}
    if args.json is not None:
        arguments.write_json(args.json, content)
    if args.html is not None:
        frames = film_strip(args.data[0])
        with arguments.writing(args.html):
            write_comparison(args.html, steps, trials, title=args.title or args.data[0].stem, frames=frames)


if __name__ == "__main__":
    raise SystemExit(main())
