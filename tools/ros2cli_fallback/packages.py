"""``ros2 run``: find an executable of a package through the ament index and become it."""

import argparse
import os
import shlex
import signal
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from ament_index_python.packages import PackageNotFoundError, get_package_prefix

from ros2cli_fallback.cover import Failure, Misused, Parser

OURS = "sandbot_"
"""How the packages of this workspace begin."""


def executable(package: str, name: str) -> Path:
    """The path of ``name`` in ``<prefix>/lib/<package>``; Failure, begun as the real ros2's, if it is not there."""
    found = [path for path in executables(package) if path.name == name]
    if not found:
        raise Failure(f"No executable found{_what_there_is(package)}")
    if len(found) > 1:
        raise Failure("Multiple executables found:\n" + "\n".join(f"- {path}" for path in found))
    return found[0]


def executables(package: str) -> list[Path]:
    """All in ``<prefix>/lib/<package>``; Failure with the real ros2's words where there is no such package."""
    try:
        folder = Path(get_package_prefix(package)) / "lib" / package
    except (PackageNotFoundError, ValueError):
        raise Failure(f"Package '{package}' not found") from None
    return [path for path in sorted(folder.rglob("*")) if path.is_file() and os.access(path, os.X_OK)]


def _what_there_is(package: str) -> str:
    return f"; {package} has: {', '.join(path.name for path in executables(package)) or 'none'}"


def become(path: Path, arguments: Sequence[str], prefix: Sequence[str] = ()) -> NoReturn:
    """Replace this process by the executable, so that signals and the exit code are its own."""
    command = [*prefix, str(path), *arguments]
    if prefix or not path.parent.name.startswith(OURS):
        # Ours unblock it as soon as they can answer in one line (sandbot_common.cli); others know nothing of that.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    os.execvp(command[0], command)


def main(argv: Sequence[str]) -> int:
    """``run [--prefix CMD] PACKAGE EXECUTABLE [ARGUMENT...]``."""
    parser = Parser(prog="ros2 run", description="Run a package specific executable.")
    parser.add_argument("--prefix", default="", help="command to put before the executable, e.g. 'gdb -ex run --args'")
    parser.add_argument("package_name", help="name of the ROS package")
    parser.add_argument("executable_name", nargs="?", help="name of the executable; without one, what there is")
    parser.add_argument("argv", nargs=argparse.REMAINDER, help="passed on as they are")
    args = parser.parse_args(argv)
    if args.executable_name is None:
        raise Misused(f"ros2 run: an executable is needed{_what_there_is(args.package_name)}")
    path = executable(args.package_name, args.executable_name)
    become(path, args.argv, shlex.split(args.prefix))
