"""Whether the host's shared memory is large enough for the nodes of a trackway, which exchange messages through it.

A node takes 8 MB, or 64 if it publishes frames (decision 6). One that gets none falls back to UDP, and loses messages.
"""

import shutil
import sys
from pathlib import Path

SHARED_MEMORY = Path("/dev/shm")
NEEDED_BYTES = 512 << 20


def shortage(folder: Path = SHARED_MEMORY) -> str:
    """What is too small and what would help, in one line; empty if it is large enough, or not there to be told."""
    size = shutil.disk_usage(folder).total if folder.is_dir() else NEEDED_BYTES
    if size >= NEEDED_BYTES:
        return ""
    return (
        f"{folder} is {size >> 20} MB, nodes need {NEEDED_BYTES >> 20}, and messages may be lost: "
        f"docker run --shm-size=1g, or mount -o remount,size=1g {folder}"
    )


def note_shortage() -> None:
    """Say on stderr what is too small, if anything is."""
    if short := shortage():
        print(f"note: {short}", file=sys.stderr)
