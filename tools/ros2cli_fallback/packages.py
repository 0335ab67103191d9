"""``ros2 run``: find an executable of a package through the ament index and become it."""

import argparse
import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from ament_index_python.packages import PackageNotFoundError, get_package_prefix

from ros2cli_fallback.cover import Failure, Parser


def executable(package: str, name: str) -> Path:
    """The path of ``name`` in ``<prefix>/lib/<package>``; Failure with the real ros2's words if it is not there."""
    try:
        folder = Path(get_package_prefix(package)) / "lib" / package
    except (PackageNotFoundError, ValueError):
        raise Failure(f"Package '{package}' not found") from None
    found = [path for path in sorted(folder.rglob(name)) if path.is_file() and os.access(path, os.X_OK)]
    if not found:
        raise Failure("No executable found")
    if len(found) > 1:
        raise Failure("Multiple executables found:\n" + "\n".join(f"- {path}" for path in found))
    return found[0]


def become(path: Path, arguments: Sequence[str], prefix: Sequence[str] = ()) -> NoReturn:
    """Replace this process by the executable, so that signals and the exit code are its own."""
    command = [*prefix, str(path), *arguments]
    os.execvp(command[0], command)


def main(argv: Sequence[str]) -> int:
    """``run [--prefix CMD] PACKAGE EXECUTABLE [ARGUMENT...]``."""
    parser = Parser(prog="ros2 run", description="Run a package specific executable.")
    parser.add_argument("--prefix", default="", help="command to put before the executable, e.g. 'gdb -ex run --args'")
    parser.add_argument("package_name", help="name of the ROS package")
    parser.add_argument("executable_name", help="name of the executable")
    parser.add_argument("argv", nargs=argparse.REMAINDER, help="passed on as they are")
    args = parser.parse_args(argv)
    path = executable(args.package_name, args.executable_name)
    become(path, args.argv, shlex.split(args.prefix))
