"""Worker processes as a crew: results in order, and nobody left behind by an end."""

import os
import signal
import subprocess
import sys

import psutil
import pytest

from sandbot_common.crew import Processes, one_a_cpu
from sandbot_common.errors import InputError


def test_worker_processes_keep_the_order():
    with Processes(2).map() as spread:
        assert list(spread(abs, range(-20, 0))) == list(range(20, 0, -1))


def test_what_cannot_be_pickled_is_an_error_and_no_endless_wait():
    with pytest.raises(AttributeError, match="lambda"), Processes(2).map() as spread:
        list(spread(lambda one: one, range(4)))


def end(_):
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_killed_worker_is_an_error_in_one_line():
    with pytest.raises(InputError, match="killed"), Processes(2).map() as spread:
        list(spread(end, range(4)))


def test_an_error_of_a_task_stays_what_it_is():
    with pytest.raises(TypeError, match="abs"), Processes(2).map() as spread:
        list(spread(abs, ["one", "two"]))


def test_there_is_one_process_per_cpu_that_may_be_used(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3, 5, 7})
    assert one_a_cpu().size == 3


INTERRUPTED = """
import os, signal, sys, threading
from sandbot_common.crew import Processes

here = os.getpid(), threading.get_ident()
entered, untouched = 0, threading.Condition.__enter__

def enter(condition):
    # Ctrl-C comes between taking a lock and the block that would give it back.
    global entered
    result = untouched(condition)
    if (os.getpid(), threading.get_ident()) == here:
        entered += 1
        if entered == nth:
            signal.raise_signal(signal.SIGINT)
    return result

for nth in range(1, int(sys.argv[1]) + 1):
    entered = 0
    try:
        with Processes(2).map() as spread:
            threading.Condition.__enter__ = enter
            list(spread(abs, range(-3, 0)))
    except KeyboardInterrupt:
        print(nth)
    threading.Condition.__enter__ = untouched
"""


@pytest.mark.slow
def test_ctrl_c_within_a_lock_leaves_nothing_locked():
    command = [sys.executable, "-c", INTERRUPTED, "10"]
    done = subprocess.run(command, text=True, capture_output=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.split() == [str(nth) for nth in range(1, 11)]


@pytest.mark.slow
@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGKILL, -signal.SIGKILL)])
def test_an_end_leaves_no_worker_behind(sent, code):
    program = """
import os, signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)
from sandbot_common import cli
from sandbot_common.crew import Processes

def wait(_):
    os.write(1, b"at work\\n")
    time.sleep(0.5)

def run(_):
    with Processes(2).map() as spread:
        list(spread(wait, range(1000)))

sys.exit(cli.run(run, []))
"""
    parent = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert parent.stdout is not None
    assert parent.stdout.readline() == "at work\n"
    children = psutil.Process(parent.pid).children()
    assert len(children) == 2
    parent.send_signal(sent)
    _, said = parent.communicate(timeout=20)
    assert parent.returncode == code
    assert "Traceback" not in said
    assert psutil.wait_procs(children, timeout=20)[1] == []
