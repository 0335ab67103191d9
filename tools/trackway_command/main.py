"""Pick the verb, run it, say what is next."""

import shlex
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib.metadata import distribution
from pathlib import Path
from threading import Thread

from ros2cli_fallback.cover import Failure
from ros2cli_fallback.packages import executable
from sandbot_common import cli
from sandbot_common.errors import InputError
from sandbot_common.suggest import did_you_mean
from trackway_command.verbs import VERBS, then, usage
from trackway_command.version import version

TOOLS = Path(__file__).resolve().parents[1]
PACKAGES = (
    *("sandbot_clock", "sandbot_bed", "sandbot_tracking", "sandbot_model", "sandbot_lab", "sandbot_record"),
    *("sandbot_hardware", "sandbot_bringup"),
)
DEMO = ("runs/demo", "")
FOREIGN = ("demo", "live")
"""Verbs whose processes know nothing of a Ctrl-C that is held back."""
ENDS_S = 0.5
"""Time for a process to end at an interrupt of its own before that of `trackway` is handed on to it."""
LAUNCH = ("ros2", "launch", "sandbot_bringup", "trackway.launch.py")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code, the verb's own."""
    sys.argv[0] = "trackway"
    return cli.run(_main, argv)


def _main(argv: Sequence[str]) -> int:
    others = {name: package for package in PACKAGES for name in executables(package) if name not in VERBS}
    if not argv or argv[0] in ("-h", "--help"):
        print(usage(sorted(others)))
        return 0
    name, *arguments = argv
    if name in ("--version", "-V", "version"):
        print(f"trackway {version()}")
        return 0
    if name == "help":
        return _main([*arguments[:1], "--help"])
    if name == "doctor":
        from trackway_command import doctor

        sys.argv[0] = name
        code = cli.run(doctor.main, arguments)
    else:
        code = _run(command(name, arguments, others), ours=name not in FOREIGN)
    verb = VERBS.get(name)
    if verb is not None and code == 0 and not {"-h", "--help"} & set(arguments):
        given = _demo(arguments)[:1] if name == "demo" else arguments
        for number, line in enumerate(then(verb, given)):
            print(f"{'     ' if number else 'next:'} {line}", file=sys.stderr)
    return code


def executables(package: str) -> list[str]:
    """The console scripts of a package; none where it is not built."""
    try:
        found = distribution(package).entry_points.select(group="console_scripts")
    except ModuleNotFoundError:
        return []
    return sorted(entry.name for entry in found)


def command(name: str, arguments: Sequence[str], others: dict[str, str]) -> list[str]:
    """The process that a verb is. Raises InputError for a verb that is none, or whose package is not built."""
    if name == "live":
        return [*LAUNCH, *arguments]
    if name == "demo":
        return ["bash", str(TOOLS / "demo.sh"), *_demo(arguments)]
    package = VERBS[name].package if name in VERBS else others.get(name)
    if package is None:
        raise InputError(f"no verb {name!r}{did_you_mean(name, [*VERBS, *others])}")
    try:
        return [str(executable(package, name)), *arguments]
    except Failure as error:
        raise InputError(f"{name}: {error}; trackway doctor says what is wrong") from None


def _demo(arguments: Sequence[str]) -> tuple[str, str]:
    """Folder and seed of the demo; the script itself takes any word for a folder."""
    parser = cli.Parser(prog="trackway demo", description=f"{VERBS['demo'].says}; two live trials before it.")
    parser.add_argument("out", nargs="?", default=DEMO[0], metavar="FOLDER", help=f"where (default: {DEMO[0]})")
    parser.add_argument(
        "seed", nargs="?", default=DEMO[1], metavar="SEED", help="hides one more effect in addition to the paper's"
    )
    given = parser.parse_args(arguments)
    return given.out, given.seed


def _run(words: Sequence[str], *, ours: bool) -> int:
    """The exit code of a process to which the terminal's Ctrl-C goes as well; this one waits for its end, and hands on
    signals that it alone was sent.

    Ctrl-C stays blocked in our own executables until they can answer it (``cli.run``).
    """
    signals = {signal.SIGINT}
    signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    free = None if ours else lambda: signal.pthread_sigmask(signal.SIG_UNBLOCK, signals)
    try:
        # Files stay open: the shell's <(…) is one.
        with subprocess.Popen(words, preexec_fn=free, close_fds=False) as process:
            for number in (signal.SIGTERM, signal.SIGHUP):
                signal.signal(number, lambda sent, _frame: process.send_signal(sent))
            Thread(target=_hand_on, args=(process,), daemon=True).start()
            code = process.wait()
    except OSError as error:
        raise InputError(f"{shlex.join(words)}: {error.strerror}") from None
    return code if code >= 0 else 128 - code


def _hand_on(process: "subprocess.Popen[bytes]") -> None:
    """Send the process each interrupt that a process sent; those of the terminal, from the kernel, reach both.

    One that was sent to both is not doubled for a process that ends at once: a second might spoil its end.
    """
    while True:
        if signal.sigwaitinfo({signal.SIGINT}).si_code <= 0:
            with suppress(subprocess.TimeoutExpired):
                process.wait(ENDS_S)
            process.send_signal(signal.SIGINT)  # nothing, if it has ended
