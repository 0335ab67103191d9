"""``ros2 bag``: the project's own record, replay and info, their flags translated."""

import argparse
from collections.abc import Callable, Sequence

from ros2cli_fallback.cover import NotCovered, verbs_parser
from ros2cli_fallback.packages import become, executable

PACKAGE = "sandbot_record"
STORAGE = "mcap"


def main(argv: Sequence[str]) -> int:
    """``bag VERB ...``."""
    name, arguments = translate(argv)
    become(executable(PACKAGE, name), arguments)


def translate(argv: Sequence[str]) -> tuple[str, list[str]]:
    """The executable of sandbot_record and its arguments for a ``ros2 bag`` command line."""
    args = _parser().parse_args(argv)
    if args.storage not in ("", STORAGE):
        raise NotCovered(f"ros2 bag: storage {args.storage!r}; only {STORAGE} is written and read here")
    how: Callable[[argparse.Namespace], tuple[str, list[str]]] = args.how
    return how(args)


def _record(args: argparse.Namespace) -> tuple[str, list[str]]:
    if not (args.all or args.regex or args.topics or args.topic_list):
        raise NotCovered("ros2 bag record: name topics, or give --all or --regex")
    arguments = [*args.topics, *args.topic_list]
    if args.output:
        arguments += ["--out", args.output]
    if args.all:
        arguments.append("--all")
    if args.regex:
        arguments += ["--regex", args.regex]
    if args.compression_format:
        arguments += ["--compression", args.compression_format]
    return "record", arguments


def _play(args: argparse.Namespace) -> tuple[str, list[str]]:
    arguments = [args.bag_path, "--rate", str(args.rate), "--start", str(args.start_offset)]
    if args.loop:
        arguments.append("--loop")
    if args.topics:
        arguments += ["--topics", *args.topics]
    return "replay", arguments


def _info(args: argparse.Namespace) -> tuple[str, list[str]]:
    return "info", [args.bag_path]


def _parser() -> argparse.ArgumentParser:
    parser, verbs = verbs_parser("bag")
    verb = verbs.add_parser("record", help="record messages of topics into a bag")
    verb.add_argument("topics", nargs="*", help="topics to record")
    verb.add_argument("--topics", dest="topic_list", nargs="+", default=[], help="topics to record")
    verb.add_argument("-a", "--all", "--all-topics", action="store_true", help="all topics")
    verb.add_argument("-e", "--regex", help="topics that match a regular expression")
    verb.add_argument("-o", "--output", help="the bag to write")
    verb.add_argument("-s", "--storage", default="", help="mcap, the only one here")
    verb.add_argument("--compression-format", choices=("zstd", "lz4"))
    verb.add_argument("--compression-mode", choices=("none", "file", "message"), help="accepted; chunks are compressed")
    verb.set_defaults(how=_record)
    verb = verbs.add_parser("play", help="publish what a bag holds")
    verb.add_argument("bag_path")
    verb.add_argument("-r", "--rate", type=float, default=1.0, help="speed of playback")
    verb.add_argument("-l", "--loop", action="store_true", help="begin anew at the end")
    verb.add_argument("--start-offset", type=float, default=0.0, help="begin this far into the bag [s]")
    verb.add_argument("--topics", nargs="+", default=[], help="only these topics")
    verb.add_argument("-s", "--storage", default="", help="mcap, the only one here")
    verb.set_defaults(how=_play)
    verb = verbs.add_parser("info", help="what a bag holds")
    verb.add_argument("bag_path")
    verb.add_argument("-s", "--storage", default="", help="mcap, the only one here")
    verb.set_defaults(how=_info)
    return parser
