"""An executor that outlives its workers: where one was killed, the next task begins a new pool."""

import threading
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future
from typing import Any


class RestartingPool(Executor):
    """The ``first`` pool until it breaks, then what ``anew`` makes, each time.

    What was under way in a broken pool fails with BrokenExecutor. Once this process has threads, ``anew`` must spawn.
    """

    def __init__(self, first: Executor, anew: Callable[[], Executor]) -> None:
        self._pool, self._anew = first, anew
        self._lock = threading.Lock()

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """As for any executor."""
        with self._lock:
            try:
                return self._pool.submit(function, *args, **kwargs)
            except BrokenExecutor:
                self._pool = self._anew()
                return self._pool.submit(function, *args, **kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """As for any executor."""
        self._pool.shutdown(wait, cancel_futures=cancel_futures)
