"""Arguments that compare, discover and effects share."""

import argparse
import json
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from sandbot_common.cli import Parser, output
from sandbot_common.errors import InputError
from sandbot_common.files import write_text, writing
from sandbot_model.data.conditions import Cells, cells_of
from sandbot_model.data.penetrometer import Readings, read_readings
from sandbot_model.fitting.parallel import Map, cluster, workers
from sandbot_model.physics.walking import BASES
from sandbot_record.trials.table import Trials


def add_catalogue(parser: Parser) -> None:
    """Where effects come from beside the catalogue."""
    parser.add_argument(
        "--effects-from",
        type=Path,
        action="append",
        default=[],
        metavar="FILE.py",
        help="your own effects: subclasses of sandbot_model.physics.chain.Effect",
    )
    parser.add_argument(
        "--effect",
        action="append",
        default=[],
        metavar="'NAME: STAGE: FORMULA; a [unit] in LOW..HIGH'",
        help="an effect as a formula, e.g. 'boost: strength: k*(1 + a*(phi - 0.6)); a [1] in -5..5'",
    )


def add_data(parser: Parser) -> None:
    """What to read and what to write."""
    parser.add_argument("data", type=Path, nargs="+", metavar="DATA", help="a campaign folder, bags, or a trials CSV")
    add_penetrometer(parser)
    parser.add_argument("--model", choices=tuple(BASES), default="simple", help="base model (default: simple)")
    parser.add_argument("--json", type=output, metavar="OUT", help="write the result as JSON")
    parser.add_argument("--html", type=output, metavar="OUT", help="write a self-contained report")
    parser.add_argument("--title", default=None, help="title of the report (default: the name of DATA)")


def add_penetrometer(parser: Parser) -> None:
    """What is known of the ground without a robot."""
    parser.add_argument(
        "--penetrometer",
        type=Path,
        metavar="FILE.csv",
        help="readings of the ground by itself: columns phi, depth_m, force_n or phi, k_n_per_m (and their sd)",
    )


def cells(args: argparse.Namespace, trials: Trials) -> Cells:
    """The trials of DATA as cells, with the penetrometer's readings if there are any. Raises InputError."""
    return cells_of(trials, readings(args))


def readings(args: argparse.Namespace) -> Readings | None:
    """What ``--penetrometer`` names. Raises InputError."""
    return None if args.penetrometer is None else read_readings(args.penetrometer)


def add_fitters(parser: Parser) -> None:
    """Who does many fits."""
    who = parser.add_mutually_exclusive_group()
    who.add_argument("--workers", type=int, default=2, metavar="N", help="processes that fit at once (default: 2)")
    who.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="fit on the Dask cluster whose scheduler is at this address, e.g. tcp://host:8786",
    )


def fitters(args: argparse.Namespace) -> AbstractContextManager[Map]:
    """The ``map`` that ``--workers`` or ``--dask`` asks for; use it in a ``with``. Raises InputError."""
    if args.workers < 1:
        raise InputError(f"--workers {args.workers}: at least one is needed")
    return workers(args.workers) if args.dask is None else cluster(args.dask)


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write JSON, whole or not at all."""
    with writing(path):
        write_text(path, json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
