"""Many fits at once: in this process, in worker processes, or over a Dask cluster."""

import asyncio
import logging
import pickle
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from functools import partial
from typing import Any

from sandbot_common.errors import InputError
from sandbot_common.workers import pool
from sandbot_model.physics.catalogue import USER_MODULE

Map = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]
"""What ``map`` does, in order."""
Progress = Callable[[str, int, int], None]
"""Called after each fit with (purpose, fits done, fits in all)."""

PATIENCE_S = 10.0
"""How long to wait for a cluster."""
CHUNKS_PER_THREAD = 4
"""Chunks the cluster gets for each of its threads, so that none stands idle for long while another finishes."""
LONGEST_CHUNK = 16
"""A fit lasts tens of milliseconds, a task costs a scheduler about one: larger chunks would only make the progress bar
jerky."""


@contextmanager
def workers(count: int) -> Iterator[Map]:
    """A ``map`` that keeps the order; ``count`` 1 stays in this process."""
    if count <= 1:
        yield map
        return
    # Forked workers see a user's effects as they are; none of them could be found again by name.
    forked = pool(count, "fork")

    def spread(function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterable[Any]:
        # One alone is done here: what it loads and compiles the workers, forked later, have already.
        return map(function, tasks) if len(tasks) == 1 else forked.map(function, tasks)

    try:
        yield spread
    finally:
        forked.shutdown(cancel_futures=True)


@contextmanager
def cluster(address: str, patience_s: float = PATIENCE_S) -> Iterator[Map]:
    """A ``map`` that keeps the order, over the Dask cluster whose scheduler is at ``address`` (tcp://host:8786).

    Its workers need this project's packages; a user's effects travel with the fits. Raises InputError if Dask is not
    installed, no scheduler or no worker is there within ``patience_s``, or the cluster is lost on the way.
    """
    try:
        import cloudpickle  # type: ignore[import-untyped]
        from distributed import Client
    except ImportError as error:
        raise InputError(f"--dask: {error.name} is not installed; pip install 'sandbot_model[cluster]'") from None
    for module in _users_modules():
        cloudpickle.register_pickle_by_value(module)
    # We report the loss of the scheduler ourselves, once.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        asyncio.run(_answers(address, patience_s))
        client = Client(address, timeout=patience_s, set_as_default=False)
    except (OSError, OverflowError, ValueError) as error:
        # Dask's own time and ours end together; either may be the first to say so.
        late = isinstance(error, TimeoutError) or "Timed out" in str(error)
        why = f"no answer within {patience_s:g} s" if late else _line(error)
        raise InputError(f"--dask {address!r}: no Dask scheduler there ({why}); e.g. tcp://host:8786") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=patience_s)
        except TimeoutError:
            raise InputError(f"--dask {address}: no workers yet; start some with dask worker {address}") from None
        yield partial(_spread, client, cloudpickle.dumps)


async def _answers(address: str, patience_s: float) -> None:
    """Wait for a Dask scheduler to shake hands; a Client would wait for ever for another kind of server."""
    from distributed import Security
    from distributed.comm import connect

    async with asyncio.timeout(patience_s):
        comm = await connect(address, timeout=patience_s, **Security().get_connection_args("client"))
        await comm.close()


def _users_modules() -> list[Any]:
    """Modules of a user's effects, which a worker could not import by name."""
    return [module for name, module in sys.modules.items() if name.startswith(USER_MODULE)]


def _spread(
    client: Any, dumps: Callable[[Any], bytes], function: Callable[[Any], Any], tasks: Sequence[Any]
) -> Iterator[Any]:
    """Results in order. Tasks go in chunks: what those of a chunk share is sent once."""

    # A function within a function is pickled by value: the scheduler needs none of this project's packages.
    def run(work: bytes) -> list[Any]:
        act, chunk = pickle.loads(work)
        return [act(task) for task in chunk]

    size = chunk_size(len(tasks), sum(client.nthreads().values()))
    work = [dumps((function, tasks[i : i + size])) for i in range(0, len(tasks), size)]
    futures = client.map(run, work, pure=False)
    try:
        for future in futures:
            yield from _result(future, client.scheduler.address)
    finally:
        client.cancel(futures)


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
    """Tasks a chunk for a cluster of so many threads."""
    return min(max(tasks // (CHUNKS_PER_THREAD * max(threads, 1)), 1), LONGEST_CHUNK)


def _line(error: BaseException) -> str:
    return " ".join(str(error).split())
