"""Many fits at once: in this process, in worker processes, or on a Dask cluster."""

import multiprocessing
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

T = TypeVar("T")
R = TypeVar("R")
Map = Callable[[Callable[[T], R], Sequence[T]], Iterable[R]]


@contextmanager
def workers(count: int) -> Iterator[Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]]:
    """A ``map`` that keeps the order; ``count`` 1 stays in this process."""
    if count <= 1:
        yield map
        return
    # Forked workers see a user's effects as they are; none of them could be found again by name.
    with ProcessPoolExecutor(count, mp_context=multiprocessing.get_context("fork")) as pool:
        yield pool.map
