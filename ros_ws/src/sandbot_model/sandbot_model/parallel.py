"""Many fits at once: in this process or in worker processes."""

import multiprocessing
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any

Map = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]
"""What ``map`` does, in order."""


@contextmanager
def workers(count: int) -> Iterator[Map]:
    """A ``map`` that keeps the order; ``count`` 1 stays in this process."""
    if count <= 1:
        yield map
        return
    # Forked workers see a user's effects as they are; none of them could be found again by name.
    with ProcessPoolExecutor(count, mp_context=multiprocessing.get_context("fork")) as pool:
        yield pool.map
