"""discover: find the physical effect the model lacks, or say that none is missing, or which can't be told apart."""

import argparse
import shlex
import sys
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from sandbot_common import cli
from sandbot_common.errors import InputError
from sandbot_common.files import write_json, writing
from sandbot_common.terminal import filled
from sandbot_model.tools import arguments

if TYPE_CHECKING:
    from sandbot_model.discovery.error_rates import ErrorRates
    from sandbot_model.discovery.result import Discovery
    from sandbot_model.fitting.parallel import Map, Progress
    from sandbot_model.physics.effect import Effect
    from sandbot_record.trials.table import Trials

CAMPAIGNS = 20
"""Simulated campaigns by default."""
FEW = 5
"""Effects tried that are listed."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    return cli.run(_discover, argv)


def _discover(argv: Sequence[str]) -> None:
    parser = cli.Parser(prog="discover", description=__doc__)
    arguments.add_data(parser)
    arguments.add_bed(parser)
    arguments.add_catalogue(parser)
    parser.add_argument("--max-effects", type=int, default=3, help="largest set of effects tried (default: 3)")
    parser.add_argument(
        "--next", type=cli.output, metavar="OUT.csv", help="write the next trials as a table to fill in and give back"
    )
    parser.add_argument(
        "--calibrate",
        type=int,
        nargs="?",
        const=CAMPAIGNS,
        metavar="N",
        help=f"also judge N simulated campaigns of this design, for the verdict's error rates (default: {CAMPAIGNS})",
    )
    arguments.add_fitters(parser)
    args = parser.parse_args(argv)
    args.typed = shlex.join(["trackway", "discover", *argv])
    if args.max_effects < 0:
        raise InputError(f"--max-effects {args.max_effects}: 0 or more are needed")
    if args.calibrate is not None and args.calibrate < 1:
        raise InputError(f"--calibrate {args.calibrate}: 1 or more campaigns are needed")
    arguments.check_report(args)
    arguments.criteria(args)
    if args.next is not None:
        from sandbot_model.tools.trials_to_run import readings_file

        for path in (args.next, readings_file(args.next)):
            if path.exists():
                raise InputError(f"--next {path}: is there already, perhaps filled in; give another name")
    _run(args, arguments.fitters(args))


def _run(args: argparse.Namespace, fitters: "AbstractContextManager[Map]") -> None:
    # Imported only once the options are parsed, so that --help and mistakes in them are answered at once.
    from tqdm import tqdm

    from sandbot_model.data.conditions import cells_of
    from sandbot_model.discovery.assumed import assumed, priors_assumed
    from sandbot_model.discovery.discover import discover
    from sandbot_model.discovery.each_gait import judged_by_gait
    from sandbot_model.discovery.other_gait import tried_with_other_gaits
    from sandbot_model.physics.catalogue import catalogue
    from sandbot_model.tools import answer, tables

    effects = catalogue(args.effects_from, args.effect)
    trials, robot_line = arguments.trials(args)
    notes = arguments.notes(args, trials)
    readings = arguments.readings(args)
    cells = cells_of(trials, readings)
    notes += cells.notes
    arguments.check_bed(args, cells)
    with fitters as fit_all, tqdm(unit="fit", file=sys.stderr, disable=None) as bar:

        def progress(stage: str, done: int, total: int) -> None:
            if done == 1:
                bar.reset(total)
            bar.set_description(stage)
            bar.update()

        found = discover(
            cells, effects, base=args.model, max_effects=args.max_effects, criteria=arguments.criteria(args),
            fit_all=fit_all, progress=progress, with_limits=_shows_limits(args),
        )  # fmt: skip
        found = judged_by_gait(found, trials, effects, readings, max_effects=args.max_effects, fit_all=fit_all)
        found = tried_with_other_gaits(found, trials, readings)
        rates = _rates(args, found, trials, effects, fit_all, progress) if args.calibrate else []
    print(answer.of_discovery(found, trials.robot), end="\n\n")
    print(filled(tables.data_line(found.steps[0])), filled(robot_line), sep="\n")
    print("".join(f"{filled(line)}\n" for line in priors_assumed(trials, cells, found.criteria)), end="")
    print(tables.notes(notes))
    print(_tables(found, args.verbose))
    if rates:
        print("\n" + filled(f"simulated campaigns of this design: {'; '.join(map(str, rates))}"))
    _write(args, found, trials, [*assumed(trials, cells, found.criteria), *notes], rates)


def _shows_limits(args: argparse.Namespace) -> bool:
    """Whether any output lists limits on absent effects."""
    return bool(args.verbose or args.json or args.html)


def _write(
    args: argparse.Namespace, found: "Discovery", trials: "Trials", notes: Sequence[str], rates: "Sequence[ErrorRates]"
) -> None:
    """Write the files that ``--next``, ``--json`` and ``--html`` name."""
    if args.next is not None:
        from sandbot_model.report.in_words import no_trial
        from sandbot_model.tools.trials_to_run import write_trials_to_run

        print("\n" + filled(write_trials_to_run(found.next_trials, found.cells.trials, args.next, no_trial(found))))
    if args.json is not None:
        content = found.to_dict()
        content["data"]["notes"] = list(notes)
        content |= {"error_rates": [rate.to_dict() for rate in rates]} if rates else {}
        write_json(args.json, content)
    if args.html is not None:
        from sandbot_model.report import write_report

        origin = arguments.origin(args)
        with writing(args.html):
            write_report(args.html, found, trials, **origin)


def _rates(
    args: argparse.Namespace,
    found: "Discovery",
    trials: "Trials",
    effects: "Mapping[str, Effect]",
    fit_all: "Map",
    progress: "Progress",
) -> "list[ErrorRates]":
    """Error rates for campaigns with nothing hidden, and for campaigns with the named effects hidden."""
    from sandbot_model.discovery.error_rates import error_rates

    truths = [found.steps[0], *([found.fit] if found.verdict.status == "identified" else [])]
    return [
        error_rates(
            trials, truth, effects, campaigns=args.calibrate, max_effects=args.max_effects,
            criteria=arguments.criteria(args), fit_all=fit_all, progress=progress,
        )
        for truth in truths
    ]  # fmt: skip


def _tables(found: "Discovery", verbose: bool) -> str:
    """The numbers behind the verdict and what to measure next; all of them if ``verbose``, else the main ones."""
    from sandbot_model.tools import tables

    parts = [tables.ladder_of(found)]
    if found.stages and verbose:
        parts.append(tables.stages(found))
    if found.candidates:
        parts.append(tables.candidates(found, arguments.ALL if verbose else FEW))
    if verbose:
        parts += [tables.parameters(found.steps[-1]), tables.fails(found.steps[-1], arguments.ALL)]
        parts += [filled(f"absent, at 95 %: {'; '.join(map(str, found.limits))}")] if found.limits else []
    if found.next_trials:
        parts.append(f"next trials\n\n{tables.next_trials(found)}")
    return "\n\n".join(parts)


if __name__ == "__main__":
    raise SystemExit(main())
