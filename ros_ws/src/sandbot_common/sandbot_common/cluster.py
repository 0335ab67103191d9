"""Parallel work on other machines: the workers of a Dask cluster."""

import asyncio
import concurrent.futures
import logging
import os
import pickle
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

from sandbot_common.errors import InputError
from sandbot_common.parallel import Map

PATIENCE_S = 10.0
"""How long to wait for a cluster."""
CHUNKS_PER_THREAD = 4
"""Chunks of work per thread of the cluster, so that no thread is idle for long while another finishes."""
LONGEST_CHUNK = 16
"""A short task takes tens of milliseconds and costs the scheduler about one: larger chunks would only make the
progress bar jerky."""


@contextmanager
def connected(
    address: str, patience_s: float = PATIENCE_S, *, by_value: Sequence[ModuleType] = ()
) -> Iterator["Cluster"]:
    """The Dask cluster whose scheduler is at ``address`` (tcp://host:8786).

    Its workers need this project's packages; modules ``by_value`` are sent with the tasks. Raises InputError if Dask is
    not installed, if no scheduler or no worker answers within ``patience_s``, or if the cluster is lost meanwhile.
    """
    try:
        import cloudpickle  # type: ignore[import-untyped]
        from distributed import Client
    except ImportError as error:
        raise InputError(f"--dask: {error.name} is not installed; pip install distributed") from None
    for module in by_value:
        cloudpickle.register_pickle_by_value(module)
    # We report the loss of the scheduler ourselves, once.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        asyncio.run(_answers(address, patience_s))
        client = Client(address, timeout=patience_s, set_as_default=False)
    except (OSError, OverflowError, ValueError) as error:
        # Dask's timeout and ours are equal; either may expire first.
        late = isinstance(error, TimeoutError) or "Timed out" in str(error)
        why = f"no answer within {patience_s:g} s" if late else _line(error)
        raise InputError(f"--dask {address!r}: no Dask scheduler there ({why}); e.g. tcp://host:8786") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=patience_s)
        except TimeoutError:
            raise InputError(f"--dask {address}: no workers yet; start some with dask worker {address}") from None
        yield Cluster(client, address, cloudpickle.dumps)


async def _answers(address: str, patience_s: float) -> None:
    """Wait for the handshake of a Dask scheduler; with another kind of server a Client would wait forever."""
    from distributed import Security
    from distributed.comm import connect

    async with asyncio.timeout(patience_s):
        comm = await connect(address, timeout=patience_s, **Security().get_connection_args("client"))
        await comm.close()


class Cluster:
    """The workers of a Dask cluster; see ``parallel.Workers``."""

    lost = "the cluster was lost"

    def __init__(self, client: Any, address: str, dumps: Callable[[Any], bytes]) -> None:
        self._client, self._address, self._dumps = client, address, dumps

    @property
    def size(self) -> int:
        """Threads of all workers now connected. Raises BrokenExecutor if the cluster is lost."""
        if self._client.scheduler is None:  # the client has given up
            raise BrokenExecutor("no scheduler is connected")
        try:
            threads: int = sum(self._client.nthreads().values())
        except (OSError, RuntimeError, CancelledError) as error:
            raise BrokenExecutor(_line(error)) from None
        return max(threads, 1)

    def check(self, folder: Path) -> None:
        """Raises InputError if a worker does not see the folder: bags are shared through the file system."""
        path = str(folder.absolute())
        for worker, there in self._client.run(os.path.isdir, path).items():
            if not there:
                raise InputError(f"--dask {self._address}: worker {worker} does not see {path}")

    def map(self) -> AbstractContextManager[Map]:
        """A ``map`` that sends tasks in chunks: what the tasks of a chunk share is sent once."""
        return nullcontext(self._spread)

    def executor(self) -> Executor:
        """An executor that sends tasks one by one; if a worker dies, another repeats its task."""
        return _ClusterExecutor(self._client, self._dumps)

    def _spread(self, function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[Any]:
        try:
            size = chunk_size(len(tasks), self.size)
        except BrokenExecutor as error:
            raise InputError(f"--dask {self._address}: {self.lost} ({error})") from None
        chunks = [tasks[i : i + size] for i in range(0, len(tasks), size)]
        work = [self._dumps(partial(_each, function, chunk)) for chunk in chunks]
        futures = self._client.map(_unpacked(), work, pure=False)
        try:
            for future in futures:
                yield from _result(future, self._address)
        finally:
            self._client.cancel(futures)


class _ClusterExecutor(Executor):
    """Replaces Dask's own executor, which hangs if a worker dies before its result is fetched and the retry fails."""

    def __init__(self, client: Any, dumps: Callable[[Any], bytes]) -> None:
        self._client, self._dumps = client, dumps
        self._submitted: set[Future[Any]] = set()

    def submit(self, function: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """A future that is cancelled if the cluster is lost."""
        found: Future[Any] = Future()
        self._submitted.add(found)
        found.add_done_callback(self._submitted.discard)
        task = self._client.submit(_unpacked(), self._dumps(partial(function, *args, **kwargs)), pure=False)
        task.add_done_callback(partial(self._fetch, found))
        return found

    def _fetch(self, found: Future[Any], task: Any) -> None:
        try:
            found.set_result(task.result())
        except Exception as error:
            if self._client.status == "running" and not isinstance(error, CancelledError):
                found.set_exception(error)
            else:
                found.cancel()
                found.set_running_or_notify_cancel()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:  # noqa: ARG002
        """Wait for all submitted tasks: Dask forgets a cancelled task but does not end it."""
        if wait:
            concurrent.futures.wait(set(self._submitted))


def _unpacked() -> Callable[[bytes], Any]:
    # A nested function is pickled by value, so the scheduler needs none of this project's packages.
    def run(work: bytes) -> Any:
        return pickle.loads(work)()

    return run


def _each(function: Callable[[Any], Any], chunk: Sequence[Any]) -> list[Any]:
    return [function(task) for task in chunk]


def _result(future: Any, address: str) -> list[Any]:
    from distributed import KilledWorker

    try:
        found: list[Any] = future.result()
    except ModuleNotFoundError as error:
        raise InputError(
            f"--dask {address}: a worker has no module {error.name!r}; start it after 'source env.sh'"
        ) from None
    except (CancelledError, KilledWorker, OSError) as error:
        raise InputError(f"--dask {address}: the cluster was lost ({_line(error)})") from None
    return found


def chunk_size(tasks: int, threads: int) -> int:
    """Tasks per chunk for a cluster with this number of threads."""
    return min(max(tasks // (CHUNKS_PER_THREAD * max(threads, 1)), 1), LONGEST_CHUNK)


def _line(error: BaseException) -> str:
    return " ".join(str(error).split())
