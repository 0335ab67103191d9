"""Parallel work: on worker processes here, or on the workers of a Dask cluster (``cluster``)."""

import argparse
import os
import pickle
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol

from sandbot_common.errors import InputError
from sandbot_common.interrupt import ctrl_c_where_safe
from sandbot_common.workers import Finished, pool

Map = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]
"""The signature of an order-preserving ``map``."""


class Crew(Protocol):
    """Workers that run tasks in parallel."""

    @property
    def size(self) -> int:
        """The number of workers."""

    @property
    def lost(self) -> str:
        """The message for an executor that has broken down."""

    def check(self, folder: Path) -> None:
        """Raises InputError if a worker does not see a folder that this process sees."""

    def map(self) -> AbstractContextManager[Map]:
        """An order-preserving ``map`` for many short tasks that share much data of this process.

        It raises InputError if a worker is lost.
        """

    def executor(self) -> AbstractContextManager[Executor]:
        """An executor for long tasks, whose functions must be importable by name."""


@dataclass(frozen=True)
class Processes:
    """Worker processes of this machine; with ``size`` 1, short tasks run in this process."""

    size: int
    lost = "a worker process was killed (out of memory?)"

    def check(self, folder: Path) -> None:
        """Local workers see what this process sees."""

    @contextmanager
    def map(self) -> Iterator[Map]:
        """Forked workers: they inherit a user's effects, which can't be imported by name."""
        if self.size <= 1:
            yield map
            return
        forked = pool(self.size, "fork")

        def spread(function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[Any]:
            # A single task runs here: workers forked later inherit what it loads and compiles.
            if len(tasks) == 1:
                yield function(tasks[0])
                return
            try:
                # Pickled here: in the pool's own thread an error of pickling would let ``shutdown`` wait for ever.
                yield from _in_order(forked, [pickle.dumps((function, task)) for task in tasks])
            except BrokenExecutor:
                raise InputError(self.lost) from None

        with ctrl_c_where_safe():
            try:
                yield spread
            finally:
                forked.shutdown(cancel_futures=True)

    def executor(self) -> Executor:
        """Spawned workers: forked ones would inherit the state of the parent's threads (numba, DDS)."""
        return pool(self.size, "spawn")


def _in_order(workers: Executor, pickled: Sequence[bytes]) -> Iterator[Any]:
    """Results in the order of the tasks, as from ``Executor.map``, which Ctrl-C could leave waiting for ever."""
    futures = [workers.submit(_call, task) for task in pickled]
    finished, done = Finished(), set()
    for future in futures:
        finished.announce(future)
    try:
        for future in futures:
            while future not in done:
                done.add(finished.next())
            yield future.result()
    finally:
        for future in futures:
            future.cancel()


def _call(pickled: bytes) -> Any:
    function, task = pickle.loads(pickled)
    return function(task)


def one_a_cpu() -> Processes:
    """One process per CPU that this process may use."""
    return Processes(len(os.sched_getaffinity(0)))


def add_crew(parser: argparse.ArgumentParser, work: str, usual: int | None = None) -> None:
    """Options ``--workers`` and ``--dask`` for this ``work``; default: ``usual`` processes (None: one per CPU)."""
    who = parser.add_mutually_exclusive_group()
    default = "one per CPU" if usual is None else usual
    who.add_argument("--workers", type=count, metavar="N", help=f"processes that {work} at once (default: {default})")
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


def no_crew(options: argparse.Namespace, why: str) -> None:
    """Refuse ``--workers`` and ``--dask`` where nothing runs in parallel. Raises InputError."""
    for option in ("workers", "dask"):
        if getattr(options, option) is not None:
            raise InputError(f"--{option}: {why}")


def crew_of(
    options: argparse.Namespace, usual: int | None = None, by_value: Sequence[ModuleType] = ()
) -> AbstractContextManager[Crew]:
    """The workers chosen by ``--workers`` or ``--dask``, else ``usual`` processes (None: one per CPU).

    Modules ``by_value`` are sent to a cluster with the tasks. Raises InputError.
    """
    if options.dask is None:
        workers = options.workers or usual
        return nullcontext(one_a_cpu() if workers is None else Processes(workers))
    from sandbot_common.cluster import connected

    return connected(options.dask, by_value=by_value)
