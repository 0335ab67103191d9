"""Which process a node is, and what the system says of it: on one host nobody need be guessed dead from his silence."""

import ctypes
import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

_PROC = Path("/proc")
_STATE, _START = 0, 19
"""Places in /proc/PID/stat after the command's name (proc(5), fields 3 and 22)."""
_FROZEN, _ENDED = ("T", "t"), ("Z", "X", "x")
_RESENDING = "dds.asyn"
"""How Fast DDS names the thread that sends again what a reader has missed."""
_MIB = 1 << 20
_KEPT = {-1: 256 * _MIB, -2: 16 * _MIB, -3: 32 * _MIB}
"""M_TRIM_THRESHOLD, M_TOP_PAD and M_MMAP_THRESHOLD of malloc.h [bytes]."""


def keep_memory() -> None:
    """Have glibc keep what is freed: fetching and giving back memory for each frame was half of a reader's CPU."""
    with suppress(OSError, AttributeError):
        mallopt = ctypes.CDLL(None).mallopt
        for parameter, size in _KEPT.items():
            mallopt(parameter, size)


def own_name() -> str:
    """This process's name, as others are told it: host, number and start; empty where there is no /proc."""
    pid = os.getpid()
    stat = _stat(pid)
    # The start, too: numbers are used again.
    return f"{_host()} {pid} {stat[_START]}" if stat else ""


def ask_for_real_time(priority: int) -> bool:
    """Real-time priority for the calling thread and those it starts, which mostly sleep; False where not permitted."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (AttributeError, OSError):
        return False
    return True


def real_time_while(needed: bool, priority: int) -> None:
    """While ``needed``, give all ordinary threads of this process real-time priority; otherwise take it back.

    Not the one that sends again: frames sent with priority to a reader that gets no CPU keep it from getting any.
    """
    before, after = ((os.SCHED_OTHER, 0), (os.SCHED_FIFO, priority))[:: 1 if needed else -1]
    for task in (_PROC / "self/task").glob("*"):
        thread = int(task.name)
        with suppress(AttributeError, OSError):  # a thread may end meanwhile, or none may have it
            if (task / "comm").read_text().startswith(_RESENDING):
                continue
            if (os.sched_getscheduler(thread), os.sched_getparam(thread).sched_priority) == before:
                os.sched_setscheduler(thread, after[0], os.sched_param(after[1]))


def ordinary() -> AbstractContextManager[None]:
    """No real-time priority while in here, for the calling thread."""
    return _scheduled(lambda: os.SCHED_OTHER, 0)


def real_time(priority: int, *, inherited: bool = False) -> AbstractContextManager[None]:
    """Real-time priority while in here, for the calling thread; what it starts has none, unless ``inherited``."""
    return _scheduled(lambda: os.SCHED_FIFO if inherited else os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, priority)


@contextmanager
def _scheduled(policy: Callable[[], int], priority: int) -> Iterator[None]:
    """Another priority of the calling thread while in here, where the system knows such and grants it."""
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

    pid: int
    start: str

    @classmethod
    def of(cls, name: str) -> "Neighbour | None":
        """The living process of that ``own_name``; None where it is on another host, or can't be looked at."""
        host, _, rest = name.partition(" ")
        pid, _, start = rest.partition(" ")
        if host != _host() or not pid.isdigit():
            return None
        one = cls(int(pid), start)
        return None if one.fault == "is gone" else one

    @property
    def fault(self) -> str:
        """What has become of it; an empty string while it lives, however busy it is."""
        stat = _stat(self.pid)
        if not stat or stat[_START] != self.start or stat[_STATE] in _ENDED:
            return "is gone"
        return "is frozen" if stat[_STATE] in _FROZEN else ""

    @property
    def starved_s(self) -> float:
        """For how long so far its main thread was ready to run and got no CPU; 0 where the system does not tell."""
        told = _read(f"{_PROC}/{self.pid}/schedstat").split()
        return int(told[1]) * 1e-9 if len(told) > 1 else 0.0


def _host() -> str:
    """This boot of the host and the PID namespace: containers may share the one and not the other."""
    try:
        boot = (_PROC / "sys/kernel/random/boot_id").read_text().strip()
        return f"{boot}/{(_PROC / 'self/ns/pid').stat().st_ino}"
    except OSError:
        return ""


def _stat(pid: int) -> list[str]:
    return _read(f"{_PROC}/{pid}/stat").rpartition(")")[2].split()


def _read(path: str) -> str:
    """A file of /proc; empty where there is none. By hand: a campaign looks 300 times a second."""
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
