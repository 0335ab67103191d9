"""Arguments that several commands share.

Modules that read and fit are imported by the functions that need them, so that ``--help`` and mistakes in the options
are answered at once.
"""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sandbot_common.cli import Parser, output
from sandbot_common.errors import InputError
from sandbot_common.files import base_name
from sandbot_common.robot import SANDBOT, Robot, difference, read_robot, to_mapping
from sandbot_model.discovery.criteria import DEFAULT, Criteria, of_bed
from sandbot_model.discovery.selection import Selection
from sandbot_model.physics.gait import USUAL_FRAME_RATE_HZ
from sandbot_model.physics.walking import BASES

ALL = 10**6
"""More rows than any table has."""
FITTERS = 2
"""Default number of processes that fit at once."""
LEG_KEYS = ("leg_mount_rad", "legs_per_tripod", "leg_order")
"""Keys of a robot that the reading of bags depends on: another file can't change them afterwards."""

if TYPE_CHECKING:
    from sandbot_model.data.conditions import Cells
    from sandbot_model.data.penetrometer import Readings
    from sandbot_model.discovery.compare import Comparison
    from sandbot_model.fitting.parallel import Map
    from sandbot_record.trials.table import Trials


def add_catalogue(parser: Parser) -> None:
    """Options for effects that are not in the catalogue."""
    parser.add_argument(
        "--effects-from",
        type=Path,
        action="append",
        default=[],
        metavar="FILE.py",
        help="your own effects: subclasses of sandbot_model.Effect",
    )
    parser.add_argument(
        "--effect",
        action="append",
        default=[],
        metavar="'NAME: STAGE: FORMULA; a [unit] in LOW..HIGH'",
        help="an effect as a formula, e.g. 'boost: strength: k*(1 + a*(omega/12 - 1)); a [1] in -1..1'",
    )


def add_data(parser: Parser) -> None:
    """Options for what to read and what to write."""
    parser.add_argument("data", type=Path, nargs="+", metavar="DATA", help="a campaign folder, bags, or a trials CSV")
    add_setting(parser)
    add_penetrometer(parser)
    add_model(parser)
    parser.add_argument("--json", type=output, metavar="OUT", help="write the result as JSON")
    parser.add_argument("--html", type=output, metavar="OUT", help="write a self-contained report")
    parser.add_argument("--title", default=None, help="title of the report (default: the name of DATA)")
    parser.add_argument(
        "--verbose", "-v", action="store_true", help="list every effect tried and every cell mean missed"
    )


def title(args: argparse.Namespace) -> str:
    """``--title``, else the name of DATA."""
    return args.title or base_name(args.data[0])


def origin(args: argparse.Namespace) -> dict[str, Any]:
    """Where a report comes from: its title, a film strip of DATA, DATA, and the command line as typed."""
    from sandbot_record.trials.film_strip import film_strip

    return {"title": title(args), "frames": film_strip(args.data[0]), "data": args.data, "command": args.typed}


def check_report(args: argparse.Namespace) -> None:
    """Raises InputError for an option of a report that is not written."""
    if args.title is not None and args.html is None:
        raise InputError("--title: only the report of --html OUT has one; give that too")


def add_model(parser: Parser) -> None:
    """The base model; each command adds an ``--effects`` of its own."""
    parser.add_argument("--model", choices=tuple(BASES), default="simple", help="base model (default: simple)")


def selection(args: argparse.Namespace) -> Selection:
    """What ``--model``, ``--effects`` and ``--effect`` select."""
    names = tuple(name.strip() for name in args.effects.split(",") if name.strip())
    return Selection(args.model, names, tuple(args.effect))


def add_setting(parser: Parser) -> None:
    """Options for what a bag contains and a table doesn't: the robot, and the frame rate."""
    parser.add_argument(
        "--robot",
        type=Path,
        metavar="FILE.yaml",
        help="the robot, as in robot.yaml (default: the data's own, else SandBot)",
    )
    parser.add_argument(
        "--cameras",
        type=Path,
        metavar="FILE.yaml",
        help=f"the cameras' frame rate and accuracy (default: the data's own, else {USUAL_FRAME_RATE_HZ:g} frames/s)",
    )


def add_bed(parser: Parser) -> None:
    """Options for priors on the bed."""
    parser.add_argument(
        "--bed-scatter",
        type=float,
        metavar="FRACTION",
        help="prior sd of the variation of k from batch to batch "
        f"(default: {DEFAULT.bed_scatter:g}; beds have 0.003 to 0.01)",
    )
    parser.add_argument(
        "--bed-drift",
        type=float,
        metavar="FRACTION",
        help=f"prior sd of the drift of k by the end of a campaign (default: {DEFAULT.drift:g})",
    )


def criteria(args: argparse.Namespace) -> Criteria:
    """Criteria of a verdict, with the bed's priors from the options. Raises InputError."""
    return of_bed(args.bed_scatter, args.bed_drift)


def check_bed(args: argparse.Namespace, cells: "Cells") -> None:
    """Raises InputError for an option on the bed that these trials can't use."""
    if args.bed_drift is not None and cells.order is None:
        raise InputError(
            f"--bed-drift {args.bed_drift:g}: DATA do not say in which order trials were run (run_order, or started); "
            "add that, or leave the option out"
        )


def trials(args: argparse.Namespace) -> "tuple[Trials, str]":
    """The trials of DATA, with the robot and cameras that the options name, and a line on which robot that is.

    Raises InputError.
    """
    from sandbot_model.discovery.assumed import NO_ROBOT
    from sandbot_record.trials.from_bags import robot_file

    found = _read(args, args.data)
    if args.robot is not None:
        return of_robot(found, read_robot(args.robot), str(args.robot))
    if found.robot is None:
        return found, f"{NO_ROBOT} (--robot FILE.yaml names another)"
    beside = dict.fromkeys(str(file) for path in args.data if (file := robot_file(path)) is not None)
    return found, f"robot: {', '.join(beside) or 'as in the bags'}"


def ladder(args: argparse.Namespace) -> "tuple[Trials, str, Comparison]":
    """As ``trials``, and the ladder of the selected model fitted to them. Raises InputError."""
    from sandbot_model.data.conditions import cells_of
    from sandbot_model.discovery.reproduce import steps_of
    from sandbot_model.physics.catalogue import catalogue

    effects = catalogue(args.effects_from, tuple(args.effect))
    found, line = trials(args)
    return found, line, steps_of(selection(args), cells_of(found), effects)


def notes(args: argparse.Namespace, trials: "Trials") -> tuple[str, ...]:
    """Notes on suspicious trials of DATA. Raises InputError for impossible ones."""
    from sandbot_model.data.quality import checked
    from sandbot_record.trials.read import named

    return checked(trials, named(args.data))


def beside(args: argparse.Namespace, first: "Trials", path: Path) -> "Trials":
    """The trials of ``path``, to show with DATA: with the same options, and of the robot of ``first``.

    Raises InputError if they are another robot's.
    """
    found = _read(args, path)
    if args.robot is not None:
        return of_robot(found, read_robot(args.robot), str(args.robot))[0]
    robot = first.robot or SANDBOT
    if found.robot not in (None, robot):
        raise InputError(
            f"--beside {path}: trials of another robot than DATA ({difference(found.robot, robot)}); "
            "explore one robot at a time, or name the right one with --robot FILE.yaml"
        )
    return replace(found, robot=robot)


def _read(args: argparse.Namespace, data: "Path | Sequence[Path]") -> "Trials":
    """Trials with the frame rate and accuracy of ``--cameras``, else with their own."""
    from sandbot_record.trials.read import read
    from sandbot_record.trials.setting import of_cameras

    found = read(data)
    if args.cameras is None:
        return found
    rate_hz, accuracy = of_cameras(args.cameras)
    return replace(found, frame_rate_hz=rate_hz, accuracy=accuracy)


def check_setting(args: argparse.Namespace) -> None:
    """Check the files of ``--robot``, ``--cameras`` and ``--penetrometer`` by reading them. Raises InputError."""
    from sandbot_record.trials.setting import of_cameras

    if args.robot is not None:
        read_robot(args.robot)
    if args.cameras is not None:
        of_cameras(args.cameras)
    readings(args)


def of_robot(trials: "Trials", robot: Robot, where: str) -> "tuple[Trials, str]":
    """The trials as walked by this robot, named ``where``, and a line that says so. Raises InputError."""
    own, line = trials.robot, f"robot: {where}"
    if own is not None and own != robot:
        for name in LEG_KEYS:
            given, read = to_mapping(robot)[name], to_mapping(own)[name]
            if given != read:
                raise InputError(
                    f"{where}: {name}: {given}, but the first steps in DATA were read with {read}; use that here, too"
                )
        line += f" in place of the data's own ({difference(robot, own)})"
    return replace(trials, robot=robot), line


def add_penetrometer(parser: Parser) -> None:
    """Option for measurements of the ground itself."""
    parser.add_argument(
        "--penetrometer",
        type=Path,
        metavar="FILE.csv",
        help="penetrometer readings: columns phi, depth_m, force_n, or phi, k_n_per_m (and their sd)",
    )


def cells(args: argparse.Namespace, trials: "Trials") -> "Cells":
    """The trials of DATA as cells, with the penetrometer's readings if there are any. Raises InputError."""
    from sandbot_model.data.conditions import cells_of

    return cells_of(trials, readings(args))


def readings(args: argparse.Namespace) -> "Readings | None":
    """The readings in the file of ``--penetrometer``, if given. Raises InputError."""
    if args.penetrometer is None:
        return None
    from sandbot_model.data.penetrometer import read_readings

    return read_readings(args.penetrometer)


def add_fitters(parser: Parser) -> None:
    """Options for the processes that fit."""
    from sandbot_common.worker_options import add_worker_options

    add_worker_options(parser, "fit", usual=FITTERS)


@contextmanager
def fitters(args: argparse.Namespace) -> Iterator["Map"]:
    """The ``map`` of the processes that ``--workers`` or ``--dask`` names. Raises InputError."""
    from sandbot_common.worker_options import workers_of
    from sandbot_model.fitting.parallel import users_modules

    with workers_of(args, usual=FITTERS, by_value=users_modules()) as workers, workers.map() as fit_all:
        yield fit_all
