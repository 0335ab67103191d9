"""Participant numbers a new node should not take: those of killed processes to which somebody still sends.

A sender through shared memory keeps the receiver's port mapped (/dev/shm/fastrtps_portN). A node that starts after a
kill gets the dead process's number, and with it its ports: it creates their files anew, while senders that map the old
ones keep sending to nobody until Fast DDS notices: after 2 to 20 s, once not within a minute. A process killed while
it created such a file leaves it incomplete, and whoever opens it waits forever (decision 6).
"""

import re
import socket
import time
from collections.abc import Iterator, Sequence, Set
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

SHARED_MEMORY, PROCESSES = Path("/dev/shm"), Path("/proc")
MOST = 16
"""The most numbers reserved at once. Nodes of one host look for each other under the first 32."""
CREATION_S = 2.0
"""Longer than it takes to create a port's file."""
_READY = (2).to_bytes(4, "little")
"""First bytes of a port's file that is complete (boost/interprocess/detail/managed_open_or_create_impl.hpp)."""
_MAPPED = re.compile(r"/fastrtps_port(\d+)(?: \(deleted\))?$", re.M)
_LOCKED = re.compile(r"FLOCK .* (\d+) [0-9a-f]+:[0-9a-f]+:(\d+) ")


@contextmanager
def fresh_participant_number(domain: int) -> Iterator[None]:
    """Context in which a process creates its first node of a ROS domain, which gets no killed process's number."""
    remove_incomplete()
    with reserved(dead_ports(domain)):
        yield


def dead_ports(domain: int, shared_memory: Path = SHARED_MEMORY, processes: Path = PROCESSES) -> list[int]:
    """Ports of a ROS domain that somebody sends to and nobody reads: 7411 + 250 domain + 2 number (RTPS 2.3, 9.6.1).

    The reader of a port holds a lock on the port's _el file, which the system releases when the process dies. If the
    locks can't be listed, no port counts as dead.
    """
    try:
        locks = _LOCKED.findall((processes / "locks").read_text())
    except OSError:
        return []
    mapped: set[int] = set()
    for process in {process for process, _ in locks}:  # every sender is a reader, too
        with suppress(OSError):  # gone meanwhile, or no permission
            mapped.update(int(port) for port in _MAPPED.findall((processes / process / "maps").read_text()))
    read = _locked(shared_memory, {inode for _, inode in locks})
    first = 7400 + 250 * domain
    return sorted(port for port in mapped - read if first < port < first + 250)


def _locked(shared_memory: Path, inodes: Set[str]) -> set[int]:
    found = set()
    for lock in shared_memory.glob("fastrtps_port*_el"):
        with suppress(OSError):
            if str(lock.stat().st_ino) in inodes:
                found.add(int(lock.name.removeprefix("fastrtps_port").removesuffix("_el")))
    return found


def remove_incomplete(shared_memory: Path = SHARED_MEMORY) -> None:
    """Remove the ports' files whose creator died before they were complete."""
    for port in shared_memory.glob("fastrtps_port*[0-9]"):
        with suppress(OSError):  # gone meanwhile, or not ours
            with port.open("rb") as file:
                ready = file.read(len(_READY)) == _READY
            if not ready and port.stat().st_mtime < time.time() - CREATION_S:
                port.unlink()


@contextmanager
def reserved(ports: Sequence[int]) -> Iterator[None]:
    """Context in which no node of this host takes these ports' numbers; no effect on more than ``MOST`` ports.

    A number belongs to whoever binds its UDP discovery port, the one below.
    """
    with ExitStack() as kept:
        for port in ports if len(ports) <= MOST else ():
            with suppress(OSError):  # another starting node has reserved it already
                kept.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)).bind(("", port - 1))
        yield
