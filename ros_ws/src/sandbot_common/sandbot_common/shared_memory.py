"""Whether the host's shared memory has room for the nodes of a trackway, which exchange messages through it.

A node takes 8 MB, or 64 if it publishes frames (decision 6). One that gets none falls back to UDP, and may lose
messages. Where not a page is left, a new node is not heard by others at all, or ends with a bus error.
"""

import shutil
import sys
from pathlib import Path

from sandbot_common.errors import InputError

SHARED_MEMORY = Path("/dev/shm")
NEEDED_BYTES = 512 << 20
LAUNCH_BYTES = 256 << 20
"""What the nodes of one launch, two cameras among them, and a campaign take."""
FULL_BYTES = 1 << 20
"""Less than this is full: a new node could not even create its port, of 124 KB."""
CLEAR = "remove what fills it; trackway doctor says what killed nodes have left there"


def shortage(folder: Path = SHARED_MEMORY) -> str:
    """What is too small and what would help, in one line; empty if it is large enough, or can't be read."""
    if not folder.is_dir():
        return ""
    size, _, free = shutil.disk_usage(folder)
    if size < NEEDED_BYTES:
        return (
            f"{folder} is {size >> 20} MB, nodes need {NEEDED_BYTES >> 20}, and messages may be lost: "
            f"docker run --shm-size=1g, or mount -o remount,size=1g {folder}"
        )
    if free >= LAUNCH_BYTES:
        return ""
    taken = f"{folder} has {free >> 20} MB free, nodes take up to {LAUNCH_BYTES >> 20}, and messages may be lost"
    return f"{taken}: {CLEAR}"


def note_shortage() -> None:
    """Say on stderr what is too small, if anything is."""
    if short := shortage():
        print(f"note: {short}", file=sys.stderr)


def check_room(folder: Path = SHARED_MEMORY) -> None:
    """Raise InputError if it is full: a campaign that starts, or its next recorder, could not be heard."""
    if folder.is_dir() and shutil.disk_usage(folder).free < FULL_BYTES:
        raise InputError(f"{folder} is full, and a new node would not be heard: {CLEAR}")
