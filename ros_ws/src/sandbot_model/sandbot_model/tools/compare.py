"""compare: fit a model, with effects added one by one, and show each step's error beside the noise floor."""

import argparse
import shlex
import sys
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from sandbot_common import cli
from sandbot_common.errors import InputError
from sandbot_common.files import write_json, writing
from sandbot_common.terminal import filled
from sandbot_common.worker_options import refuse_worker_options
from sandbot_model.discovery.selection import Selection, held_by_text, name_of, read_selection
from sandbot_model.tools import arguments

if TYPE_CHECKING:
    from sandbot_model.data.penetrometer import Readings
    from sandbot_model.discovery.compare import Comparison
    from sandbot_model.fitting.fit import Fit
    from sandbot_model.fitting.parallel import Map
    from sandbot_model.physics.effect import Effect
    from sandbot_model.physics.model import Model
    from sandbot_record.trials.table import Trials

FEW = 5
"""Cell means missed that are listed."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    return cli.run(_compare, argv)


def _compare(argv: Sequence[str]) -> None:
    parser = cli.Parser(prog="compare", description=__doc__)
    arguments.add_data(parser)
    parser.add_argument("--effects", default="", metavar="a,b", help="effects to add, in this order")
    arguments.add_catalogue(parser)
    parser.add_argument(
        "--hold",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="add a step with this parameter held at VALUE; all others, and their errors, stay as fitted",
    )
    parser.add_argument(
        "--selection", type=Path, metavar="FILE.yaml", help="model, effects and held values as the explorer saved them"
    )
    parser.add_argument(
        "--bootstrap", type=int, metavar="N", help="also standard errors from N bootstrap draws of the trials"
    )
    arguments.add_fitters(parser)
    args = parser.parse_args(argv)
    args.typed = shlex.join(["trackway", "compare", *argv])
    arguments.check_report(args)
    if args.bootstrap is not None and args.bootstrap < 2:
        raise InputError(f"--bootstrap {args.bootstrap}: 2 or more draws are needed")
    if args.bootstrap is None:
        refuse_worker_options(args, "only the draws of --bootstrap N are shared out; give that too")
    fitters = arguments.fitters(args)
    _run(args, _selection(args), fitters)


def _run(args: argparse.Namespace, selection: Selection, fitters: "AbstractContextManager[Map]") -> None:
    # Imported only once the options are parsed, so that --help and mistakes in them are answered at once.
    from sandbot_model.data.conditions import cells_of
    from sandbot_model.discovery.assumed import assumed
    from sandbot_model.discovery.reproduce import steps_of
    from sandbot_model.physics.catalogue import catalogue
    from sandbot_model.physics.model import model_of
    from sandbot_model.tools import answer, tables

    effects = catalogue(args.effects_from, selection.formulas)
    held, held_notes = _held(selection, model_of(selection.model, selection.effects, effects))
    trials, robot_line = arguments.trials(args)
    readings = arguments.readings(args)
    notes = arguments.notes(args, trials)
    cells = cells_of(trials, readings)
    notes += (*cells.notes, *held_notes)
    steps = steps_of(selection, cells, effects)
    print(answer.of_comparison(steps), end="\n\n")
    print(filled(tables.data_line(steps[0])), filled(robot_line), sep="\n")
    print(tables.notes(notes))
    if unused := _unused(args, selection, effects):
        print(filled(unused), end="\n\n")
    if held:
        unchanged = "nothing is refitted: all else, and its error, as before"
        print(filled(f"last step held by hand: {held}; {unchanged}"), end="\n\n")
    print(_tables(steps, arguments.ALL if args.verbose else FEW))
    content = steps.to_dict()
    content["data"]["notes"] = [*assumed(trials, cells), *notes]
    if args.bootstrap is not None:
        model = model_of(selection.model, selection.effects, effects, cells.robot)
        drawn = _bootstrap(args.bootstrap, trials, model, readings, steps[-1], fitters)
        print("\n" + tables.bootstrap(steps[-1], drawn, args.bootstrap))
        content["bootstrap"] = {"draws": args.bootstrap, "stderr": drawn}
    if args.json is not None:
        write_json(args.json, content)
    if args.html is not None:
        from sandbot_model.report import write_comparison

        origin = arguments.origin(args)
        with writing(args.html):
            write_comparison(args.html, steps, trials, **origin)


def _unused(args: argparse.Namespace, selection: Selection, effects: "Mapping[str, Effect]") -> str:
    """That no effect of ``--effects-from`` is selected; empty if any is, or there are none."""
    from sandbot_model.physics.catalogue import catalogue

    own = sorted(effects.keys() - catalogue(formulas=selection.formulas).keys()) if args.effects_from else []
    if not own or set(own) & set(selection.effects):
        return ""
    return f"not fitted: {', '.join(own)} of --effects-from; --effects {own[0]} adds it"


def _bootstrap(
    draws: int,
    trials: "Trials",
    model: "Model",
    readings: "Readings | None",
    fit: "Fit",
    fitters: "AbstractContextManager[Map]",
) -> dict[str, float]:
    """Standard errors from refits to draws of the trials, each started at the fit, with a progress bar."""
    from tqdm import tqdm

    from sandbot_model.fitting.bootstrap import bootstrap

    bar = partial(tqdm, total=draws, desc="bootstrap", unit="draw", file=sys.stderr, disable=None)
    with fitters as fit_all:
        return bootstrap(trials, model, draws, readings=readings, near=fit.warm_start, fit_all=fit_all, each=bar)


def _tables(steps: "Comparison", missed: int) -> str:
    """The ladder, the parameters of its last step, the cell means that it misses, and the lock."""
    from sandbot_model.tools import tables

    last = steps[-1]
    parts = (tables.ladder(steps), tables.parameters(last), tables.fails(last, missed))
    return "\n\n".join(filter(None, (*parts, filled(tables.lock_line(steps.lock)))))


def _held(selection: Selection, model: "Model") -> tuple[str, list[str]]:
    """The values held by hand as text, and notes on those outside their plausible range. Raises InputError for a
    parameter that the model does not have, or an impossible value of one.
    """
    values, notes = [], []
    for name, value in selection.by_hand:
        parameter = model.parameter(name)
        parameter.check(value, f"--hold {name}")
        values.append(f"{name} = {parameter.with_unit(value)}")
        if not parameter.low <= value <= parameter.high:
            ends = f"{parameter.low:g} to {parameter.with_unit(parameter.high)}"
            notes.append(f"{values[-1]} is held outside its plausible range, {ends}")
    return ", ".join(values), notes


def _selection(args: argparse.Namespace) -> Selection:
    """What the arguments, or the file of ``--selection`` in their place, select. Raises InputError."""
    given = arguments.selection(args)
    # Every --effect is added; --effects only gives its place in the order.
    given = given.toggled([*given.effects, *(name_of(text) for text in args.effect)])
    for held in args.hold:
        given = held_by_text(given, held, "--hold")
    if args.selection is not None:
        if given != Selection():
            raise InputError("--selection gives model, effects and held values: leave out the options that do so, too")
        given = read_selection(args.selection)
    if given.by_hand and args.bootstrap is not None:
        source = f"{args.selection}: by_hand" if args.selection else "--hold"
        raise InputError(f"{source}: a parameter held by hand has no standard error; leave out --bootstrap")
    return given


if __name__ == "__main__":
    raise SystemExit(main())
