"""Which process a node is, and its state: on the same host a node's death is observed, not inferred from silence."""

import ctypes
import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

_PROC = Path("/proc")
_STATE, _START = 0, 19
"""Indices into /proc/PID/stat after the command's name (proc(5), fields 3 and 22)."""
_FROZEN, _ENDED, _BLOCKED = ("T", "t"), ("Z", "X", "x"), "D"
_RESENDING = "dds.asyn"
"""Name of the Fast DDS thread that resends what a reader has missed."""
_MIB = 1 << 20
_KEPT = {-1: 256 * _MIB, -2: 16 * _MIB, -3: 32 * _MIB}
"""M_TRIM_THRESHOLD, M_TOP_PAD and M_MMAP_THRESHOLD of malloc.h [bytes]."""


def keep_memory() -> None:
    """Have glibc keep freed memory: allocating and returning it for each frame took half of a reader's CPU time."""
    with suppress(OSError, AttributeError):
        mallopt = ctypes.CDLL(None).mallopt
        for parameter, size in _KEPT.items():
            mallopt(parameter, size)


def own_name() -> str:
    """This process's identity, as sent to other nodes: host, PID and start time; empty without /proc."""
    pid = os.getpid()
    stat = _stat(pid)
    # With the start time, as PIDs are reused.
    return f"{_host()} {pid} {stat[_START]}" if stat else ""


def awaits_disk(pid: int) -> bool:
    """Whether a thread of the process waits for a disk that does not answer; until it does not even a kill ends it."""
    tasks = (_PROC / f"{pid}/task").glob("*")
    return any(_stat(f"{pid}/task/{task.name}")[_STATE : _STATE + 1] == [_BLOCKED] for task in tasks)


def ask_for_real_time(priority: int) -> bool:
    """Real-time priority for the calling thread and those it starts, which mostly sleep; False if not permitted."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (AttributeError, OSError):
        return False
    return True


def real_time_while(needed: bool, priority: int) -> None:
    """While ``needed``, give all ordinary threads of this process real-time priority; otherwise take it back.

    The resending thread is excluded: resending frames at this priority to a reader that gets no CPU would starve it.
    """
    before, after = ((os.SCHED_OTHER, 0), (os.SCHED_FIFO, priority))[:: 1 if needed else -1]
    for task in (_PROC / "self/task").glob("*"):
        thread = int(task.name)
        with suppress(AttributeError, OSError):  # the thread has ended, or real time is not permitted
            if (task / "comm").read_text().startswith(_RESENDING):
                continue
            if (os.sched_getscheduler(thread), os.sched_getparam(thread).sched_priority) == before:
                os.sched_setscheduler(thread, after[0], os.sched_param(after[1]))


def ordinary() -> AbstractContextManager[None]:
    """Context without real-time priority for the calling thread."""
    return _scheduled(lambda: os.SCHED_OTHER, 0)


def real_time(priority: int, *, inherited: bool = False) -> AbstractContextManager[None]:
    """Context with real-time priority for the calling thread; threads it starts have none, unless ``inherited``."""
    return _scheduled(lambda: os.SCHED_FIFO if inherited else os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, priority)


@contextmanager
def _scheduled(policy: Callable[[], int], priority: int) -> Iterator[None]:
    """Context with another priority for the calling thread, where the system supports and permits it."""
    try:
        before = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, policy(), os.sched_param(priority))
    except (AttributeError, OSError):
        yield
        return
    try:
        yield
    finally:
        os.sched_setscheduler(0, *before)


@dataclass(frozen=True)
class Neighbour:
    """Another process of this host."""

    pid: str
    start: str

    @classmethod
    def of(cls, name: str) -> "Neighbour | None":
        """The live process with that ``own_name``; None if it is gone, on another host, or not accessible."""
        host, _, rest = name.partition(" ")
        pid, _, start = rest.partition(" ")
        if host != _host() or not pid.isdigit():
            return None
        one = cls(pid, start)
        return None if one.fault == "is gone" else one

    @property
    def fault(self) -> str:
        """What happened to it; an empty string while it is alive, however busy."""
        stat = _stat(self.pid)
        if not stat or stat[_START] != self.start or stat[_STATE] in _ENDED:
            return "is gone"
        return "is frozen" if stat[_STATE] in _FROZEN else ""

    @property
    def starved_s(self) -> float:
        """Total time its main thread was ready to run but got no CPU; 0 if the system does not report it."""
        fields = _read(f"{_PROC}/{self.pid}/schedstat").split()
        return int(fields[1]) * 1e-9 if len(fields) > 1 else 0.0


def _host() -> str:
    """The host's boot and PID namespace: containers may share the former but not the latter."""
    try:
        boot = (_PROC / "sys/kernel/random/boot_id").read_text().strip()
        return f"{boot}/{(_PROC / 'self/ns/pid').stat().st_ino}"
    except OSError:
        return ""


def _stat(pid: int | str) -> list[str]:
    return _read(f"{_PROC}/{pid}/stat").rpartition(")")[2].split()


def _read(path: str) -> str:
    """The text of a /proc file; empty if there is none. Low-level for speed: a campaign reads 300 a second."""
    try:
        file = os.open(path, os.O_RDONLY)
    except OSError:
        return ""
    try:
        return os.read(file, 4096).decode("ascii", "replace")
    except OSError:
        return ""
    finally:
        os.close(file)
