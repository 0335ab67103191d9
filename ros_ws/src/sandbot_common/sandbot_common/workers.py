"""Worker processes that leave Ctrl-C to their parent and end with it."""

import gc
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing.connection import wait
from multiprocessing.context import ForkContext, ForkProcess, SpawnContext, SpawnProcess
from queue import SimpleQueue
from typing import Any, Literal


def pool(count: int, start: Literal["fork", "spawn"], also: Callable[[], None] | None = None) -> ProcessPoolExecutor:
    """``count`` worker processes; each runs ``also`` before its first task.

    A forked worker inherits what its parent has loaded (a user's effects could not be imported by name). If the parent
    has threads (DDS, numba), spawn is needed, which starts a fresh interpreter.
    """
    context = _Spawned() if start == "spawn" else _Forked()
    return ProcessPoolExecutor(count, mp_context=context, initializer=_start, initargs=(also,))


class Finished:
    """Waits for futures, in the order they finish, so that Ctrl-C can end it at any moment.

    It is held back within ``concurrent.futures`` (see ``interrupt``), but not here: a SimpleQueue's lock is taken in C.
    """

    def __init__(self) -> None:
        self._done: SimpleQueue[Future[Any]] = SimpleQueue()

    def announce(self, future: Future[Any]) -> None:
        """Let ``next`` return this future when it is done."""
        future.add_done_callback(self._done.put)

    def next(self) -> Future[Any]:
        """The next future that is done."""
        return self._done.get()


class _Starts:
    """A process that starts with Ctrl-C blocked: during its imports it would end with a traceback."""

    def start(self) -> None:
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            super().start()  # type: ignore[misc]
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _SpawnedProcess(_Starts, SpawnProcess):
    pass


class _ForkedProcess(_Starts, ForkProcess):
    """Never collects objects inherited from the parent: OpenCV's would wait for threads that a fork does not have."""

    def run(self) -> None:
        gc.freeze()
        super().run()


class _Spawned(SpawnContext):
    Process = _SpawnedProcess


class _Forked(ForkContext):
    Process = _ForkedProcess


def _start(also: Callable[[], None] | None) -> None:
    # Ctrl-C reaches the whole process group; the parent decides, and a worker finishes its task.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if also is not None:
        also()


def _end_with_parent() -> None:
    # A killed parent can't stop its workers, which must not race with the next run.
    if (parent := multiprocessing.parent_process()) is not None:
        wait([parent.sentinel])
        os._exit(1)
