"""Who does work that can be shared out: worker processes here, or the workers of a Dask cluster (``cluster``)."""

import argparse
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol

from sandbot_common.errors import InputError
from sandbot_common.workers import pool

Map = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]
"""What ``map`` does, in order."""


class Crew(Protocol):
    """Those who work at once."""

    @property
    def size(self) -> int:
        """How many they are."""

    @property
    def lost(self) -> str:
        """Why their executor gives no results any more, in words."""

    def check(self, folder: Path) -> None:
        """Raises InputError where one of them does not see a folder that this process sees."""

    def map(self) -> AbstractContextManager[Map]:
        """A ``map`` that keeps the order, for work of this process: many short tasks that share much."""

    def executor(self) -> AbstractContextManager[Executor]:
        """An executor for long tasks of functions that can be found by name."""


@dataclass(frozen=True)
class Processes:
    """Worker processes of this machine; one alone does short tasks in this process."""

    size: int
    lost = "a worker process was killed (out of memory?)"

    def check(self, folder: Path) -> None:
        """They see what this process sees."""

    @contextmanager
    def map(self) -> Iterator[Map]:
        """Forked: they see a user's effects, none of which could be found again by name."""
        if self.size <= 1:
            yield map
            return
        forked = pool(self.size, "fork")

        def spread(function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterable[Any]:
            # One alone is done here: what it loads and compiles the workers, forked later, have already.
            return map(function, tasks) if len(tasks) == 1 else forked.map(function, tasks)

        try:
            yield spread
        finally:
            forked.shutdown(cancel_futures=True)

    def executor(self) -> Executor:
        """Spawned: a forked worker would inherit the parent's threads (numba, DDS)."""
        return pool(self.size, "spawn")


def one_a_cpu() -> Processes:
    """As many processes as this machine has processors."""
    return Processes(os.cpu_count() or 1)


def add_crew(parser: argparse.ArgumentParser, work: str, usual: int | None = None) -> None:
    """Options ``--workers`` and ``--dask`` for those who do this ``work``: ``usual`` processes (None: one a CPU)."""
    who = parser.add_mutually_exclusive_group()
    count = "one a CPU" if usual is None else usual
    who.add_argument("--workers", type=_count, metavar="N", help=f"processes that {work} at once (default: {count})")
    who.add_argument(
        "--dask",
        metavar="ADDRESS",
        help=f"{work} on the Dask cluster whose scheduler is at this address, e.g. tcp://host:8786",
    )


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is no number of processes; at least one is needed")
    return int(text)


def no_crew(options: argparse.Namespace, why: str) -> None:
    """Refuse ``--workers`` and ``--dask`` where nothing is shared out. Raises InputError."""
    for option in ("workers", "dask"):
        if getattr(options, option) is not None:
            raise InputError(f"--{option}: {why}")


def crew_of(
    options: argparse.Namespace, usual: int | None = None, by_value: Sequence[ModuleType] = ()
) -> AbstractContextManager[Crew]:
    """Those whom ``--workers`` or ``--dask`` names, else ``usual`` processes (None: one a CPU). Raises InputError.

    The workers of a cluster get the modules ``by_value`` with their tasks.
    """
    if options.dask is None:
        count = options.workers or usual
        return nullcontext(one_a_cpu() if count is None else Processes(count))
    from sandbot_common.cluster import connected

    return connected(options.dask, by_value=by_value)
