"""Which process a node is, and what the system says of it: on one host nobody need be guessed dead from his silence."""

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

_PROC = Path("/proc")
_STATE, _START = 0, 19
"""Places in /proc/PID/stat after the command's name (proc(5), fields 3 and 22)."""
_FROZEN, _ENDED = ("T", "t"), ("Z", "X", "x")


def own_name() -> str:
    """This process's name, as others are told it: host, number and start; empty where there is no /proc."""
    pid = os.getpid()
    stat = _stat(pid)
    # The start, too: numbers are used again.
    return f"{_host()} {pid} {stat[_START]}" if stat else ""


def ask_for_real_time(priority: int) -> bool:
    """For the calling thread and those it starts, which sleep nearly all the time; who may not runs as it is."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (AttributeError, OSError):
        return False
    return True


def real_time_while(needed: bool, priority: int) -> None:
    """All ordinary threads of this process get real-time priority, or those that have this one give it back."""
    before, after = ((os.SCHED_OTHER, 0), (os.SCHED_FIFO, priority))[:: 1 if needed else -1]
    for task in (_PROC / "self/task").glob("*"):
        thread = int(task.name)
        with suppress(AttributeError, OSError):  # a thread may end meanwhile, or none may have it
            if (os.sched_getscheduler(thread), os.sched_getparam(thread).sched_priority) == before:
                os.sched_setscheduler(thread, after[0], os.sched_param(after[1]))


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
        try:
            return int((_PROC / str(self.pid) / "schedstat").read_text().split()[1]) * 1e-9
        except (OSError, IndexError, ValueError):
            return 0.0


def _host() -> str:
    """This start of this host, and its process numbers' namespace: containers may share the one and not the other."""
    try:
        boot = (_PROC / "sys/kernel/random/boot_id").read_text().strip()
        return f"{boot}/{(_PROC / 'self/ns/pid').stat().st_ino}"
    except OSError:
        return ""


def _stat(pid: int) -> list[str]:
    try:
        return (_PROC / str(pid) / "stat").read_text().rpartition(")")[2].split()
    except OSError:
        return []
