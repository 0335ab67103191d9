"""Uniform command lines: exit code 0 on success, 2 with one line on bad input, 130 on Ctrl-C."""

import argparse
import ast
import errno
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
from sandbot_common.interrupt import ctrl_c_where_safe
from sandbot_common.parameters import usage
from sandbot_common.suggest import did_you_mean

BAD_INPUT = 2
INTERRUPTED = 130
OUT_OF_REACH = (
    errno.EACCES, errno.EPERM, errno.EIO, errno.ESTALE, errno.ETIMEDOUT, errno.EHOSTDOWN, errno.ENOTCONN, errno.ENODEV,
    errno.ENXIO, errno.ELOOP, errno.ENAMETOOLONG,
)  # fmt: skip
"""Why a file can't be had that is no fault of ours: no permission, a disk or network that is lost, an unusable name."""
SHORT = 30
"""Characters of either end of a name that is too long for a file."""


class Parser(argparse.ArgumentParser):
    """An ArgumentParser with one-line errors and no abbreviated options: ``--effect`` is not ``--effects``."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **{"allow_abbrev": False, **kwargs})

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As the base class; for an unknown option, the error suggests the one that may have been meant."""
        options, unknown = self.parse_known_args(args, namespace)
        if unknown:
            self.error(self._unknown_argument(unknown[0]))
        self._check_outputs(options)
        return options

    def _check_outputs(self, options: argparse.Namespace) -> None:
        """Refuse an ``output`` that would overwrite an input or another output."""
        files = [
            (action, path)
            for action in self._actions
            for path in _as_list(getattr(options, action.dest, None))
            if isinstance(path, Path)
        ]
        for (action, path), (other, taken) in product(files, files):
            if action.type is output and other is not action and same_file(path, taken):
                self.error(f"{_name(action)} {path}: would replace {_name(other)} {taken}; give another name")

    def _unknown_argument(self, word: str) -> str:
        if not word.startswith("-"):
            return f"{word!r} is one argument too many"
        name = word.split("=")[0]
        known = [option for option in self._option_string_actions if option.startswith("--")]
        return f"no option {name}{did_you_mean(name, known)}"

    def error(self, message: str) -> NoReturn:
        """Raise InputError in place of usage and exit."""
        raise InputError(f"{message} (see {self.prog} --help)")


def _as_list(value: Any) -> Sequence[Any]:
    return value if isinstance(value, list) else [value]


def _name(action: argparse.Action) -> str:
    """An argument as it is typed, or as ``--help`` names it."""
    return action.option_strings[0] if action.option_strings else str(action.metavar or action.dest)


OF_EVERY_NODE = ("use_sim_time", "qos_overrides.", "start_type_description_service")
"""Prefixes of the parameters that every ROS node has."""


def with_ros(parser: argparse.ArgumentParser, argv: Sequence[str]) -> tuple[argparse.Namespace, list[str]]:
    """Our own options, and the arguments from --ros-args on, which ROS parses.

    Raises InputError for a ROS parameter: a command with options has no parameters of its own.
    """
    cut = list(argv).index("--ros-args") if "--ros-args" in argv else len(argv)
    _check_rules(argv[cut:])
    for flag, rule in pairwise(argv[cut:]):
        name = rule.partition(":=")[0].rpartition(":")[2]
        if flag in ("-p", "--param") and not name.startswith(OF_EVERY_NODE):
            raise no_parameter(name, parser.prog)
    return parser.parse_args(argv[:cut]), list(argv[cut:])


def no_parameter(name: str, program: str) -> InputError:
    """The error for a ROS parameter given to a command that is configured by options."""
    return InputError(f"--ros-args -p {name}: {program} is set by options of its own (see --help)")


def _check_rules(arguments: Sequence[str]) -> None:
    """Raises InputError for a malformed rule, for which ROS itself would print a traceback."""
    for flag, rule in pairwise([*arguments, ""]):
        if flag in ("-p", "--param", "-r", "--remap") and ":=" not in rule:
            raise InputError(f"--ros-args {f'{flag} {rule}'.strip()}: expected {flag} NAME:=VALUE")


class Main(Protocol):
    """What a console script calls."""

    def __call__(self, argv: Sequence[str] | None = None) -> int:
        """Run the command line and return the exit code."""


def node(module: str, parameters: type) -> Main:
    """The console script of a node: ``--help`` and argument errors are handled before ROS is loaded.

    ``module`` has the node's ``main``, and its docstring is the help text; ``parameters`` is its dataclass.
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
    """The arguments outside --ros-args ... [--]."""
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
    """The docstring of a module, without importing it."""
    found = find_spec(module)
    if found is None or found.origin is None:
        raise ModuleNotFoundError(module)
    return ast.get_docstring(ast.parse(Path(found.origin).read_text(encoding="utf-8"))) or ""


def output(text: str) -> Path:
    """A file to write, as an argparse type: a path that can't be written is refused before the work begins."""
    if text == "-":
        raise argparse.ArgumentTypeError("-: standard output is /dev/stdout, a file of this name ./-")
    try:
        return check_output(Path(text))
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def run(command: Callable[[Sequence[str]], int | None], argv: Sequence[str] | None = None) -> int:
    """Run ``command`` on the arguments and return the exit code; only InputError, a file that the system does not give,
    and Ctrl-C are caught."""
    name = os.path.basename(sys.argv[0])
    speak_line_by_line()
    try:
        with ctrl_c_where_safe(last=True):
            # `trackway` and `ros2 run` block Ctrl-C until here, where it can be reported in one line.
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
            code = command(sys.argv[1:] if argv is None else argv) or 0
            _check_output_written()
            return code
    except InputError as error:
        # A file name may contain a newline.
        print(f"{name}: error: {' '.join(str(error).splitlines())}", file=sys.stderr)
        return BAD_INPUT
    except OSError as error:
        if error.filename is None or error.errno not in OUT_OF_REACH:
            raise
        # `Path.exists` raises these, too.
        print(f"{name}: error: {_file_name(error)}: {error.strerror}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print(f"{name}: interrupted; what was finished is kept", file=sys.stderr)
        return INTERRUPTED


def _file_name(error: OSError) -> str:
    """The file that an error names, without the middle of one that is too long."""
    text = " ".join(os.fsdecode(error.filename).splitlines())
    return f"{text[:SHORT]}…{text[-SHORT:]}" if error.errno == errno.ENAMETOOLONG else text


def _check_output_written() -> None:
    """Raise InputError if output was lost, as on a full disk."""
    if isinstance(sys.stdout, Outlet) and sys.stdout.lost:
        raise InputError(f"output: {sys.stdout.lost.strerror}; files written by the command are complete")


class Outlet(io.TextIOWrapper):
    """A stream whose reader (head, less) may close, or whose disk may be full: it then discards its output, so that the
    work goes on."""

    lost: OSError | None = None
    """Why output was lost. A reader that has seen enough is no loss."""

    def write(self, text: str, /) -> int:
        """As for any text stream."""
        try:
            return super().write(text)
        except OSError as error:
            self._fall_silent(error)
            return len(text)

    def flush(self) -> None:
        """As for any text stream."""
        try:
            super().flush()
        except OSError as error:
            self._fall_silent(error)

    def _fall_silent(self, error: OSError) -> None:
        self.lost = None if isinstance(error, BrokenPipeError) else error
        with open(os.devnull, "wb") as nothing:
            os.dup2(nothing.fileno(), self.fileno())


def speak_line_by_line() -> None:
    """Make stdout and stderr line-buffered, also through a pipe: other programs wait for "recording to …".

    Neither ``campaign PLAN 2>&1 | head``, nor a stream that was closed from the start, nor an encoding without φ then
    ends a campaign.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif stream is getattr(sys, f"__{name}__"):
            errors = "replace" if stream.errors == "strict" else stream.errors
            setattr(sys, name, Outlet(stream.buffer, stream.encoding, errors, line_buffering=True))
