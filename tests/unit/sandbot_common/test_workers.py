import gc
import os
import signal
import subprocess
import sys
from concurrent.futures import BrokenExecutor

import pytest

from sandbot_common.restarting_pool import RestartingPool
from sandbot_common.workers import pool

ORPHANS = """
import os, sys, time
from sandbot_common.workers import pool

if __name__ == "__main__":
    with pool(1, sys.argv[1]) as workers:
        print(workers.submit(os.getpid).result(), flush=True)
        workers.submit(time.sleep, 600)
        sys.stdin.read()
"""


def ignores_ctrl_c(_task: int) -> bool:
    return signal.getsignal(signal.SIGINT) is signal.SIG_IGN


def in_worker() -> None:
    os.environ["SANDBOT_TEST_WORKER"] = "ready"


def readiness(_task: int) -> str | None:
    return os.environ.get("SANDBOT_TEST_WORKER")


def test_workers_leave_ctrl_c_to_their_parent_and_run_what_is_asked_first():
    with pool(2, "fork", also=in_worker) as workers:
        assert list(workers.map(ignores_ctrl_c, range(4))) == [True] * 4
        assert list(workers.map(readiness, range(4))) == ["ready"] * 4
    assert not ignores_ctrl_c(0)
    assert readiness(0) is None


class Ended:
    """Garbage of this process that only a collection finds: it is part of a cycle."""

    where: list[int] = []

    def __init__(self) -> None:
        self.itself = self

    def __del__(self) -> None:
        self.where.append(os.getpid())


def collected(_task: int) -> list[int]:
    gc.collect()
    return Ended.where


def test_a_forked_worker_does_not_end_what_its_parent_has_left():
    """A film of OpenCV ended in a worker waits for ever for its threads, which are the parent's."""
    gc.disable()
    try:
        Ended.where.clear()
        Ended()
        with pool(1, "fork") as workers:
            assert workers.submit(collected, 0).result() == []
        assert collected(0) == [os.getpid()]
    finally:
        gc.enable()


HASTY = """
import os, signal, sys
from sandbot_common.workers import pool

if __name__ == "__main__":
    signal.signal(signal.SIGINT, lambda *_: None)
    with pool(1, "spawn") as workers:
        task = workers.submit(os.getpid)
        os.killpg(0, signal.SIGINT)
        print(task.result())
else:
    # A worker is being imported: Ctrl-C comes just now.
    os.kill(os.getpid(), signal.SIGINT)
"""


def test_ctrl_c_while_a_worker_is_being_born_is_its_parents_affair(tmp_path):
    script = tmp_path / "hasty.py"
    script.write_text(HASTY)
    done = subprocess.run(
        [sys.executable, str(script)], text=True, capture_output=True, start_new_session=True, timeout=120, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert int(done.stdout) > 0


@pytest.mark.parametrize("start", ["fork", "spawn"])
def test_a_worker_ends_with_a_parent_that_was_killed(tmp_path, start):
    script = tmp_path / "orphans.py"
    script.write_text(ORPHANS)
    command = [sys.executable, str(script), start]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as parent:
        assert int(parent.stdout.readline()) != parent.pid
        parent.kill()
        # The pipe ends only when the worker, busy for ten minutes, has gone too; the test's timeout is shorter.
        assert parent.stdout.read() == ""


def end(_task: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_killed_worker_costs_what_it_had_in_hand_and_nothing_more():
    made = []

    def anew():
        made.append(pool(1, "fork"))
        return made[-1]

    with RestartingPool(pool(1, "fork"), anew) as workers:
        assert workers.submit(abs, -1).result() == 1
        with pytest.raises(BrokenExecutor):
            workers.submit(end, 0).result()
        assert workers.submit(abs, -2).result() == 2
        with pytest.raises(TypeError):  # of a task: no reason for a new pool
            workers.submit(abs, "three").result()
        assert workers.submit(abs, -4).result() == 4
    assert len(made) == 1
