"""Pick the command, run it, and turn what goes wrong into a line and an exit code."""

import io
import os
import shutil
import signal
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from ros2cli_fallback.cover import FAILED, INTERRUPTED, MISUSED, VERBS, Failure, Misused, NotCovered, covered

# A command's module is imported only when it is asked for: `ros2 run` must not pay for rclpy.
_MODULES = {
    "run": "packages",
    "launch": "launching",
    "topic": "topics",
    "node": "nodes",
    "param": "parameters",
    "service": "services",
    "bag": "bag",
}

_OURS = Path(__file__).parent.name
"""What stands beside the stand-in, and not beside a real ros2."""
_IGNORED = ("--use-python-default-buffering",)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code."""
    arguments = [one for one in (sys.argv[1:] if argv is None else argv) if one not in _IGNORED]
    if isinstance(sys.stdout, io.TextIOWrapper):
        # As the real one under a terminal: a message is seen when it comes, also through a pipe.
        sys.stdout.reconfigure(line_buffering=True)
    try:
        if arguments[:1] != ["run"]:
            # What is run answers by itself, as soon as it can.
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        return _dispatch(arguments)
    except Misused as error:
        print(error, file=sys.stderr)
        return MISUSED
    except Failure as error:
        print(error, file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        # The reader of our output (head, less) has gone: not an error of ours.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def real_ros2() -> str | None:
    """The first ``ros2`` on the PATH that is none of ours, or None.

    Two checkouts sourced in one shell would otherwise take each other for the real one, and hand over for ever.
    """
    for folder in os.environ.get("PATH", "").split(os.pathsep):
        found = shutil.which("ros2", path=folder) if folder else None
        if found is not None and not (Path(found).resolve().parent / _OURS).is_dir():
            return found
    return None


def _dispatch(arguments: Sequence[str]) -> int:
    if not arguments or arguments[0] in ("-h", "--help"):
        print(f"usage: ros2 COMMAND ...\n\nThis is trackway's stand-in for ros2. It covers {covered()}.")
        return 0
    command, *rest = arguments
    if command not in VERBS:
        raise NotCovered(f"ros2: no command {command!r}")
    try:
        module = import_module(f"ros2cli_fallback.{_MODULES[command]}")
    except ModuleNotFoundError as error:
        raise Failure(f"ros2: {error.name} is not importable; source env.sh of the workspace first") from None
    if hasattr(sys.stdout, "reconfigure"):
        sys.stdout.reconfigure(line_buffering=True)
    return int(module.main(rest) or 0)
