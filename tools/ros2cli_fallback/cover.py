"""What the stand-in covers, its way of refusing, and its parser."""

import argparse
from collections.abc import Sequence
from typing import Any, NoReturn

VERBS = {
    "run": (),
    "launch": (),
    "topic": ("list", "echo", "hz", "info", "type"),
    "node": ("list", "info"),
    "param": ("list", "get", "set", "describe", "dump"),
    "service": ("list", "type", "call"),
    "bag": ("record", "play", "info"),
}

FAILED = 1
MISUSED = 2
INTERRUPTED = 2  # what the real ros2 returns on Ctrl-C: the number of SIGINT


class Failure(RuntimeError):
    """What was asked can't be done; ``str`` is the line for stderr, the exit code is 1 as with the real ros2."""


class Misused(Failure):
    """What was asked is no whole command; exit code 2."""


class NotCovered(Misused):
    """A command, verb or flag of the real ros2 that this stand-in does not have; exit code 2."""

    def __init__(self, message: str) -> None:
        super().__init__(f"{message} (this is trackway's stand-in for ros2; it covers {covered()})")


class Parser(argparse.ArgumentParser):
    """An ArgumentParser whose complaint is one line that says what is covered."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        # An abbreviation that works here might mean another flag of the real ros2.
        super().__init__(*args, **{"allow_abbrev": False, **kwargs})

    def run(self, argv: Sequence[str]) -> int:
        """Parse, and run the verb."""
        args = self.parse_args(argv)
        code: int = args.run(args)
        return code

    def error(self, message: str) -> NoReturn:
        """Raise NotCovered in place of usage and exit."""
        raise NotCovered(f"{self.prog}: {message}")


def covered() -> str:
    """The covered commands and verbs in one line."""
    return ", ".join(f"{command} {'|'.join(verbs)}".strip() for command, verbs in VERBS.items())


def verbs_parser(command: str) -> tuple[Parser, Any]:
    """The parser of a command and its sub-parsers action for the verbs."""
    parser = Parser(prog=f"ros2 {command}")
    return parser, parser.add_subparsers(dest="verb", required=True, metavar="|".join(VERBS[command]))
