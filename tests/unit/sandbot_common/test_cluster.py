"""Work on a cluster: done in order and elsewhere, by another where a worker dies, and one line where nobody works."""

import os
import signal
import socket
import sys
from concurrent.futures import BrokenExecutor, CancelledError

import pytest

from sandbot_common.cluster import chunk_size, connected
from sandbot_common.errors import InputError


@pytest.mark.slow
def test_a_cluster_keeps_the_order_in_other_processes(scheduler):
    with connected(scheduler) as workers, workers.map() as spread:
        found = list(spread(lambda task: (task * task, os.getpid()), range(50)))
    assert [square for square, _ in found] == [task * task for task in range(50)]
    assert len({pid for _, pid in found} - {os.getpid()}) == 2


def test_what_goes_wrong_on_a_cluster_is_told_here(scheduler):
    def refuse(task):
        raise InputError(f"task {task} can't be done")

    def lacking(task):
        raise ModuleNotFoundError("No module named 'sandbot_lab'", name="sandbot_lab")

    with connected(scheduler) as workers, workers.map() as spread:
        with pytest.raises(InputError, match="task 0 can't be done"):
            list(spread(refuse, range(5)))
        with pytest.raises(InputError, match="a worker has no module 'sandbot_lab'"):
            list(spread(lacking, range(5)))
        assert list(spread(abs, [-1])) == [1]


@pytest.mark.slow
def test_a_scheduler_without_workers_is_one_line():
    from distributed import LocalCluster

    with (
        LocalCluster(n_workers=0, dashboard_address=":0", host="127.0.0.1") as empty,
        pytest.raises(InputError, match="no workers yet; start some with dask worker tcp://"),
        connected(empty.scheduler_address, 2.0),
    ):
        pass


def test_another_kind_of_server_is_no_scheduler():
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(InputError, match="no Dask scheduler there"), connected(address, 0.3):
            pass


@pytest.mark.parametrize("address", ["", "host", "tcp://host", "carrier-pigeon://host:1", "tcp://[::1"])
def test_what_is_no_address_is_refused(address):
    with pytest.raises(InputError, match=r"no Dask scheduler there .*e\.g\. tcp://host:8786"), connected(address, 0.3):
        pass


def test_without_dask_its_project_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"distributed is not installed; pip install distributed$"):
        connected("tcp://127.0.0.1:1").__enter__()


@pytest.mark.parametrize(("tasks", "threads", "size"), [(1, 2, 1), (23, 2, 2), (1000, 2, 16), (1000, 64, 3), (5, 0, 1)])
def test_chunks_keep_every_thread_busy_and_the_bar_moving(tasks, threads, size):
    assert chunk_size(tasks, threads) == size


@pytest.mark.slow
def test_what_was_or_is_asked_of_a_cluster_that_is_lost_is_one_line():
    from distributed import LocalCluster

    local = LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0", host="127.0.0.1")
    with connected(local.scheduler_address, 2.0) as workers, workers.executor() as hands, workers.map() as spread:
        assert hands.submit(abs, -1).result() == 1
        found = iter(spread(abs, range(1000)))
        next(found)
        local.close()
        with pytest.raises(InputError, match="the cluster was lost"):
            list(found)
        with pytest.raises(BrokenExecutor):
            _ = workers.size
        with pytest.raises(CancelledError):
            hands.submit(abs, -2).result()
        with pytest.raises(InputError, match="the cluster was lost"):
            list(spread(abs, [-3]))
        workers._client.close()  # as it does by itself, when it has tried again for long enough
        with pytest.raises(BrokenExecutor):
            _ = workers.size
        with pytest.raises(InputError, match=f"{local.scheduler_address}: the cluster was lost"):
            list(spread(abs, [-3]))


def test_a_worker_that_does_not_see_a_folder_is_named(scheduler, tmp_path):
    with connected(scheduler) as workers:
        workers.check(tmp_path)
        with pytest.raises(InputError, match=rf"worker tcp://\S+ does not see {tmp_path}/absent"):
            workers.check(tmp_path / "absent")


@pytest.mark.slow
def test_an_executor_does_the_task_of_a_worker_that_dies_on_another(scheduler, tmp_path):
    def die_once(mark):
        if not os.path.exists(mark):
            open(mark, "w").close()
            os.kill(os.getpid(), signal.SIGKILL)
        return os.getpid()

    with connected(scheduler) as workers, workers.executor() as hands:
        assert workers.size == 2
        assert hands.submit(die_once, str(tmp_path / "died")).result() != os.getpid()
        assert (tmp_path / "died").exists()
        with pytest.raises(ZeroDivisionError):
            hands.submit(divmod, 1, 0).result()
