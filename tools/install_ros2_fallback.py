"""Link tools/trackway into the venv's bin, and tools/ros2 if the host has no real ros2; if it has, remove our link.

Idempotent.
"""

import os
import sys
from pathlib import Path

TOOLS = Path(__file__).resolve().parent
FALLBACK = TOOLS / "ros2"
TRACKWAY = TOOLS / "trackway"

sys.path.insert(0, str(TOOLS))

from ros2cli_fallback.main import real_ros2  # noqa: E402


def install(binaries: Path) -> str:
    """Link ``ros2`` in the folder ``binaries`` to the fallback, unless a real one is on the PATH; returns a message."""
    link = binaries / "ros2"
    ours = link.is_symlink() and link.resolve() == FALLBACK
    if not ours and (link.is_symlink() or link.exists()):
        return f"{link} is not the fallback; left as it is"
    if (real := real_ros2()) is not None:
        link.unlink(missing_ok=True)
        return f"ros2 is {real}" + ("; the fallback was taken away" if ours else "; no fallback needed")
    if ours:
        return "ros2 is the fallback already"
    # Relative, so that the work tree can be moved.
    link.symlink_to(os.path.relpath(FALLBACK, binaries))
    return f"no ros2 on the PATH; {link.name} in {binaries.name}/ is the project's fallback"


def install_trackway(binaries: Path) -> None:
    """Link ``trackway``, which works without sourcing env.sh, in the folder ``binaries``."""
    link = binaries / TRACKWAY.name
    link.unlink(missing_ok=True)
    link.symlink_to(os.path.relpath(TRACKWAY, binaries))


def main() -> int:
    """Install into the venv of the running interpreter."""
    binaries = Path(sys.executable).parent
    install_trackway(binaries)
    print(f"trackway: {install(binaries)}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
