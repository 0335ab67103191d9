"""The options ``--workers`` and ``--dask`` of a command: who does its work in parallel."""

import argparse
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from types import ModuleType

from sandbot_common.errors import InputError
from sandbot_common.parallel import Processes, Workers, one_per_cpu


def add_worker_options(parser: argparse.ArgumentParser, work: str, usual: int | None = None) -> None:
    """Options ``--workers`` and ``--dask`` for this ``work``; default: ``usual`` processes (None: one per CPU)."""
    who = parser.add_mutually_exclusive_group()
    default = "one per CPU" if usual is None else usual
    who.add_argument(
        "--workers", type=count, metavar="N", help=f"processes that {work} in parallel (default: {default})"
    )
    who.add_argument(
        "--dask",
        metavar="ADDRESS",
        help=f"{work} on the Dask cluster whose scheduler is at this address, e.g. tcp://host:8786",
    )


def count(text: str) -> int:
    """A number of processes, as an argparse type."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of processes: 1 or more are needed")
    return int(text)


def refuse_worker_options(options: argparse.Namespace, why: str) -> None:
    """Refuse ``--workers`` and ``--dask`` where nothing runs in parallel. Raises InputError."""
    for option in ("workers", "dask"):
        if getattr(options, option) is not None:
            raise InputError(f"--{option}: {why}")


def workers_of(
    options: argparse.Namespace, usual: int | None = None, by_value: Sequence[ModuleType] = ()
) -> AbstractContextManager[Workers]:
    """The workers chosen by ``--workers`` or ``--dask``, else ``usual`` processes (None: one per CPU).

    Modules ``by_value`` are sent to a cluster with the tasks. Raises InputError.
    """
    if options.dask is None:
        size = options.workers or usual
        return nullcontext(one_per_cpu() if size is None else Processes(size))
    from sandbot_common.cluster import connected

    return connected(options.dask, by_value=by_value)
