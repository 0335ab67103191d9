"""Command lines with one manner: 0 on success, 2 with one line on bad input, 130 on Ctrl-C."""

import argparse
import ast
import io
import os
import signal
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.util import find_spec
from itertools import pairwise, product
from pathlib import Path
from typing import Any, NoReturn, Protocol

from sandbot_common.errors import InputError
from sandbot_common.files import check_output, same_file
from sandbot_common.parameters import usage
from sandbot_common.suggest import did_you_mean

BAD_INPUT = 2
INTERRUPTED = 130


class Parser(argparse.ArgumentParser):
    """An ArgumentParser whose complaint is one line; an option is written out: ``--effect`` is not ``--effects``."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **{"allow_abbrev": False, **kwargs})

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As the base class does; an option it does not have is answered with the one that may be meant."""
        options, unknown = self.parse_known_args(args, namespace)
        if unknown:
            self.error(self._stranger(unknown[0]))
        self._check_outputs(options)
        return options

    def _check_outputs(self, options: argparse.Namespace) -> None:
        """No ``output`` replaces what it is made from, nor another output."""
        files = [
            (action, path)
            for action in self._actions
            for path in _several(getattr(options, action.dest, None))
            if isinstance(path, Path)
        ]
        for (action, path), (other, taken) in product(files, files):
            if action.type is output and other is not action and same_file(path, taken):
                self.error(f"{_name(action)} {path}: would replace {_name(other)} {taken}; give another name")

    def _stranger(self, word: str) -> str:
        if not word.startswith("-"):
            return f"{word!r} is one argument too many"
        name = word.split("=")[0]
        known = [option for option in self._option_string_actions if option.startswith("--")]
        return f"no option {name}{did_you_mean(name, known)}"

    def error(self, message: str) -> NoReturn:
        """Raise InputError in place of usage and exit."""
        raise InputError(f"{message} (see {self.prog} --help)")


def _several(value: Any) -> Sequence[Any]:
    return value if isinstance(value, list) else [value]


def _name(action: argparse.Action) -> str:
    """An argument as it is typed, or as ``--help`` names it."""
    return action.option_strings[0] if action.option_strings else str(action.metavar or action.dest)


OF_EVERY_NODE = ("use_sim_time", "qos_overrides.")
"""How parameters begin that any node has."""


def with_ros(parser: argparse.ArgumentParser, argv: Sequence[str]) -> tuple[argparse.Namespace, list[str]]:
    """Our own options, and what begins with --ros-args, which is ROS's own to read.

    Raises InputError for a parameter: a command that has options has none of its own.
    """
    cut = list(argv).index("--ros-args") if "--ros-args" in argv else len(argv)
    _check_rules(argv[cut:])
    for flag, rule in pairwise(argv[cut:]):
        name = rule.partition(":=")[0].rpartition(":")[2]
        if flag in ("-p", "--param") and not name.startswith(OF_EVERY_NODE):
            raise no_parameter(name, parser.prog)
    return parser.parse_args(argv[:cut]), list(argv[cut:])


def no_parameter(name: str, program: str) -> InputError:
    """What is raised where a command that begins by options of its own is given a parameter."""
    return InputError(f"--ros-args -p {name}: {program} is set by options of its own (see --help)")


def _check_rules(arguments: Sequence[str]) -> None:
    """ROS itself answers a rule that is none with a trace. Raises InputError."""
    for flag, rule in pairwise([*arguments, ""]):
        if flag in ("-p", "--param", "-r", "--remap") and ":=" not in rule:
            raise InputError(f"--ros-args {f'{flag} {rule}'.strip()}: expected {flag} NAME:=VALUE")


class Main(Protocol):
    """What a console script calls."""

    def __call__(self, argv: Sequence[str] | None = None) -> int:
        """Run the command line and return the exit code."""


def node(module: str, parameters: type) -> Main:
    """The console script of a node: ``--help`` and a slip are answered before ROS is loaded.

    ``module`` has the node's ``main`` and, in its docstring, what it does; ``parameters`` is its dataclass.
    """

    def start(arguments: Sequence[str]) -> int:
        own = _outside_ros(arguments)
        if {"-h", "--help"} & set(own):
            print(usage(os.path.basename(sys.argv[0]), _docstring(module), parameters))
            return 0
        if own:
            raise InputError(f"unknown argument {own[0]!r}; parameters are set with --ros-args -p NAME:=VALUE")
        _check_rules(arguments)
        code: int = import_module(module).main(arguments)
        return code

    def main(argv: Sequence[str] | None = None) -> int:
        return run(start, argv)

    return main


def _outside_ros(arguments: Sequence[str]) -> list[str]:
    """What does not stand between --ros-args and its end (``--``, if there is one)."""
    own, ros = [], False
    for word in arguments:
        if word == "--ros-args":
            ros = True
        elif ros:
            ros = word != "--"
        else:
            own.append(word)
    return own


def _docstring(module: str) -> str:
    """What a module says of itself, which is not imported."""
    found = find_spec(module)
    if found is None or found.origin is None:
        raise ModuleNotFoundError(module)
    return ast.get_docstring(ast.parse(Path(found.origin).read_text(encoding="utf-8"))) or ""


def output(text: str) -> Path:
    """A file to write, as an argparse type. What can't be one is refused before the work begins."""
    try:
        return check_output(Path(text))
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def run(command: Callable[[Sequence[str]], int | None], argv: Sequence[str] | None = None) -> int:
    """Run ``command`` on the arguments and return the exit code; only InputError and Ctrl-C are caught."""
    name = os.path.basename(sys.argv[0])
    speak_line_by_line()
    try:
        # `trackway` and `ros2 run` hold Ctrl-C back until there is somebody to answer it in one line.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        code = command(sys.argv[1:] if argv is None else argv) or 0
        _check_heard()
        return code
    except InputError as error:
        # A file's name may hold the end of a line.
        print(f"{name}: error: {' '.join(str(error).splitlines())}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print(f"{name}: interrupted; what was finished is kept", file=sys.stderr)
        return INTERRUPTED


def _check_heard() -> None:
    """Refuse to call done what could not be printed, as on a full disk."""
    if isinstance(sys.stdout, Outlet) and sys.stdout.lost:
        raise InputError(f"output: {sys.stdout.lost.strerror}; what was written to files of its own is complete")


class Outlet(io.TextIOWrapper):
    """An output whose reader (head, less) may go, or whose disk may be full: from then on it is silent, for the work
    goes on and files may still have to be written."""

    lost: OSError | None = None
    """Why output was lost; that a reader wants no more is no loss."""

    def write(self, text: str, /) -> int:
        """As of any text stream."""
        try:
            return super().write(text)
        except OSError as error:
            self._fall_silent(error)
            return len(text)

    def flush(self) -> None:
        """As of any text stream."""
        try:
            super().flush()
        except OSError as error:
            self._fall_silent(error)

    def _fall_silent(self, error: OSError) -> None:
        self.lost = None if isinstance(error, BrokenPipeError) else error
        os.dup2(os.open(os.devnull, os.O_WRONLY), self.fileno())


def speak_line_by_line() -> None:
    """Let each line be seen when it is said, also through a pipe: other programs wait for "recording to …".

    Progress and errors as well: ``campaign PLAN 2>&1 | head`` ends no campaign. Nor does an output that was closed from
    the start, or one whose encoding has no φ.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif stream is getattr(sys, f"__{name}__"):
            errors = "replace" if stream.errors == "strict" else stream.errors
            setattr(sys, name, Outlet(stream.buffer, stream.encoding, errors, line_buffering=True))
