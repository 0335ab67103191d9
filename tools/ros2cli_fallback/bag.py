"""``ros2 bag``: the project's own record, replay and info, their flags translated."""

import argparse
import time
from collections.abc import Callable, Sequence

from ros2cli_fallback.cover import NotCovered, verbs_parser
from ros2cli_fallback.packages import become, executable

PACKAGE = "sandbot_record"
WRITTEN, READ = ("", "mcap"), ("", "mcap", "sqlite3")
"""Storages of `-s`; none given: mcap is written, and what is read tells by itself."""


def main(argv: Sequence[str]) -> int:
    """``bag VERB ...``."""
    name, arguments = translate(argv)
    become(executable(PACKAGE, name), arguments)


def translate(argv: Sequence[str]) -> tuple[str, list[str]]:
    """The executable of sandbot_record and its arguments for a ``ros2 bag`` command line."""
    args = _parser().parse_args(argv)
    if args.storage not in args.storages:
        raise NotCovered(f"ros2 bag: storage {args.storage!r}; here: {', '.join(filter(None, args.storages))}")
    how: Callable[[argparse.Namespace], tuple[str, list[str]]] = args.how
    return how(args)


def _record(args: argparse.Namespace) -> tuple[str, list[str]]:
    if not (args.all or args.regex or args.topics or args.topic_list):
        raise NotCovered("ros2 bag record: name topics, or give --all or --regex")
    # The real one's name for a bag that was given none.
    output = args.output or time.strftime("rosbag2_%Y_%m_%d-%H_%M_%S")
    arguments = [*args.topics, *args.topic_list, "--out", output]
    if args.all:
        arguments.append("--all")
    if args.regex:
        arguments += ["--regex", args.regex]
    if args.exclude_regex:
        arguments += ["--exclude", args.exclude_regex]
    if args.max_bag_duration:
        arguments += ["--max-duration", str(args.max_bag_duration)]
    if args.max_bag_size:
        arguments += ["--max-size", str(args.max_bag_size / 2**20)]
    if args.compression_format:
        arguments += ["--compression", args.compression_format]
    return "record", arguments


def _play(args: argparse.Namespace) -> tuple[str, list[str]]:
    arguments = [args.bag_path, "--rate", str(args.rate), "--start", str(args.start_offset)]
    if args.loop:
        arguments.append("--loop")
    if args.clock:
        arguments.append("--clock")
    if args.delay is not None:
        arguments += ["--delay", str(args.delay)]
    if args.remap:
        arguments += ["--remap", *args.remap]
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
    verb.add_argument("-x", "--exclude-regex", help="leave out topics whose name matches")
    verb.add_argument("-d", "--max-bag-duration", type=float, help="begin a new file after so long [s]")
    verb.add_argument("-b", "--max-bag-size", type=int, help="begin a new file after so many bytes")
    verb.add_argument("-o", "--output", help="the bag to write")
    verb.add_argument("-s", "--storage", default="", help="mcap, the only one written here")
    verb.add_argument("--compression-format", choices=("zstd", "lz4"))
    verb.add_argument("--compression-mode", choices=("none", "file", "message"), help="accepted; chunks are compressed")
    verb.set_defaults(how=_record, storages=WRITTEN)
    verb = verbs.add_parser("play", help="publish the messages of a bag")
    verb.add_argument("bag_path")
    verb.add_argument("-r", "--rate", type=float, default=1.0, help="speed of playback")
    verb.add_argument("-l", "--loop", action="store_true", help="begin anew at the end")
    verb.add_argument("--start-offset", type=float, default=0.0, help="begin this far into the bag [s]")
    verb.add_argument("--topics", nargs="+", default=[], help="only these topics")
    verb.add_argument("-m", "--remap", nargs="+", default=[], help="publish under other names, OLD:=NEW")
    verb.add_argument("--clock", action="store_true", help="publish bag time on /clock")
    verb.add_argument("-d", "--delay", type=float, help="wait so long before the first message [s]")
    verb.add_argument("-s", "--storage", default="", help="mcap or sqlite3")
    verb.set_defaults(how=_play, storages=READ)
    verb = verbs.add_parser("info", help="what a bag contains")
    verb.add_argument("bag_path")
    verb.add_argument("-s", "--storage", default="", help="mcap or sqlite3")
    verb.set_defaults(how=_info, storages=READ)
    return parser
