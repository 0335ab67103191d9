"""Whose number a new node should not take: that of a killed process to which somebody still sends.

Who sends through shared memory keeps the receiver's port mapped (/dev/shm/fastrtps_portN). A node that starts after a
kill gets the dead one's number, and with it his ports: it makes their files anew, and those who map the old ones send
on to nobody until Fast DDS notices: after 2 to 20 s, once not within a minute. And who was killed while it made such a
file has left it half made: whoever opens that waits for ever for it to be finished (decision 6).
"""

import re
import socket
import time
from collections.abc import Iterator, Sequence, Set
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

SHARED_MEMORY, PROCESSES = Path("/dev/shm"), Path("/proc")
MOST = 16
"""Numbers left aside at once. Nodes of one host look for each other under the first 32."""
MAKING_S = 2.0
"""Longer than it takes to make a port's file."""
_READY = (2).to_bytes(4, "little")
"""How the file of a port begins that has been made (boost/interprocess/detail/managed_open_or_create_impl.hpp)."""
_MAPPED = re.compile(r"/fastrtps_port(\d+)(?: \(deleted\))?$", re.M)
_LOCKED = re.compile(r"FLOCK .* (\d+) [0-9a-f]+:[0-9a-f]+:(\d+) ")


@contextmanager
def number_of_its_own(domain: int) -> Iterator[None]:
    """While in here a process makes its first node of a ROS domain: it gets the number of none that was killed."""
    clear_half_made()
    with left_aside(dead_ports(domain)):
        yield


def dead_ports(domain: int, shared_memory: Path = SHARED_MEMORY, processes: Path = PROCESSES) -> list[int]:
    """Ports of a ROS domain that somebody sends to and nobody reads: 7411 + 250 domain + 2 number (RTPS 2.3, 9.6.1).

    Who reads a port holds a lock on a file beside it, which the system takes from the dead. Unknown locks: none.
    """
    try:
        locks = _LOCKED.findall((processes / "locks").read_text())
    except OSError:
        return []
    mapped: set[int] = set()
    for process in {process for process, _ in locks}:  # whoever sends reads as well
        with suppress(OSError):  # gone meanwhile, or not ours to see
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


def clear_half_made(shared_memory: Path = SHARED_MEMORY) -> None:
    """Remove the ports' files that nobody will finish."""
    for port in shared_memory.glob("fastrtps_port*[0-9]"):
        with suppress(OSError):  # gone meanwhile, or not ours
            with port.open("rb") as file:
                ready = file.read(len(_READY)) == _READY
            if not ready and port.stat().st_mtime < time.time() - MAKING_S:
                port.unlink()


@contextmanager
def left_aside(ports: Sequence[int]) -> Iterator[None]:
    """While in here no node of this host takes the numbers to which these ports belong; any, of more than ``MOST``.

    A number is taken by whoever gets its UDP port of discovery, the one below.
    """
    with ExitStack() as kept:
        for port in ports if len(ports) <= MOST else ():
            with suppress(OSError):  # another node that starts keeps it too
                kept.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)).bind(("", port - 1))
        yield
