import os
import signal
import subprocess
import sys
import time

import pytest

from sandbot_common.process import Neighbour, awaits_disk, own_name

TELL = "from sandbot_common.process import own_name; print(own_name(), flush=True); input()"


@pytest.fixture
def other():
    """A process that has told its name, and the name."""
    process = subprocess.Popen([sys.executable, "-c", TELL], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    yield process, process.stdout.readline().strip()
    process.kill()
    process.communicate()


def until(condition):
    end = time.monotonic() + 30.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.001)


def test_a_process_lives_is_frozen_lives_again_and_is_gone(other):
    process, name = other
    one = Neighbour.of(name)
    assert one.pid == str(process.pid)
    assert one.fault == ""
    process.send_signal(signal.SIGSTOP)
    until(lambda: one.fault == "is frozen")
    process.send_signal(signal.SIGCONT)
    until(lambda: one.fault == "")
    process.kill()
    until(lambda: one.fault == "is gone")  # nobody has asked for its exit code yet
    process.wait()
    assert one.fault == "is gone"
    assert Neighbour.of(name) is None


BLOCKED = "import ctypes, time; ctypes.PyDLL(None).vfork() or time.sleep(600)"
"""It waits in the kernel, as for a disk, until what it has started lets go of its memory."""


def test_who_waits_in_the_kernel_waits_for_a_disk_and_who_waits_for_a_line_does_not(other):
    assert not awaits_disk(other[0].pid)
    process = subprocess.Popen([sys.executable, "-c", BLOCKED], start_new_session=True)
    try:
        until(lambda: awaits_disk(process.pid))
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    assert not awaits_disk(process.pid)  # gone


def test_a_number_used_again_is_another_process():
    host, pid, start = own_name().split()
    assert Neighbour.of(own_name()).fault == ""
    assert Neighbour.of(f"{host} {pid} {int(start) + 1}") is None
    assert Neighbour(pid, f"{int(start) + 1}").fault == "is gone"


@pytest.mark.parametrize(
    "change", [lambda name: "x" + name, lambda name: name.split()[0], lambda _: "", lambda _: "a b c"]
)
def test_who_is_elsewhere_or_says_nothing_of_himself_is_no_neighbour(change):
    assert Neighbour.of(change(own_name())) is None


@pytest.mark.parametrize("pid", ["", "x", "²", "1" * 5000])
def test_what_is_no_number_is_no_process(pid):
    host, _, start = own_name().split()
    assert Neighbour.of(f"{host} {pid} {start}") is None


def test_waiting_for_a_cpu_is_counted_and_sleeping_is_not(other):
    one = Neighbour.of(other[1])
    before_s = one.starved_s
    time.sleep(0.3)
    assert 0.0 <= one.starved_s - before_s < 0.3  # it sleeps; waking up it may wait for a moment
    other[0].kill()
    other[0].wait()
    assert one.starved_s == 0.0


HURRY = """
import os, sys, threading
from sandbot_common.process import ask_for_real_time, ordinary, real_time_while

def look(own):
    if own == "own":
        ask_for_real_time(5)
    if own == "resends":
        with open(f"/proc/self/task/{threading.get_native_id()}/comm", "w") as name:
            name.write("dds.asyn.0.0")
    ready.wait()
    while not done.wait(0.001):
        seen[own] = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority

seen, ready, done = {}, threading.Barrier(4), threading.Event()
for own in ("ordinary", "own", "resends"):
    threading.Thread(target=look, args=(own,)).start()
ready.wait()
for needed in (True, False):
    real_time_while(needed, 1)
    seen.clear()
    while len(seen) < 3:
        done.wait(0.001)
    with ordinary():
        within = os.sched_getscheduler(0)
    print(os.sched_getscheduler(0), within, *(seen[own] for own in ("ordinary", "own", "resends")), flush=True)
done.set()
"""


def test_all_threads_hurry_but_for_those_with_a_priority_of_their_own_and_the_one_that_sends_again():
    told = subprocess.check_output([sys.executable, "-c", HURRY], text=True, timeout=60).splitlines()
    if told[0].startswith(f"{os.SCHED_OTHER} "):
        pytest.skip("real-time priority is not granted here")
    own, without = (os.SCHED_FIFO, 5), (os.SCHED_OTHER, 0)
    assert told == [
        f"{os.SCHED_FIFO} {os.SCHED_OTHER} {(os.SCHED_FIFO, 1)} {own} {without}",
        f"{os.SCHED_OTHER} {os.SCHED_OTHER} {without} {own} {without}",
    ]
