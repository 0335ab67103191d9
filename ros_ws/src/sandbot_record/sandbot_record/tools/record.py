"""record: record topics to a bag, counting any loss, such that the bag survives a crash."""

import argparse
import re
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from sandbot_common import cli
from sandbot_common.errors import InputError
from sandbot_common.process import keep_memory
from sandbot_common.topics import NAME
from sandbot_record.bags.mcap_writer import COMPRESSIONS
from sandbot_record.bags.video import CODECS

if TYPE_CHECKING:
    from sandbot_record.bags.recording import Recording

MIB = 1 << 20


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; exit code 1 if it stopped on a failure or a topic could not be recorded."""
    return cli.run(_record, argv)


def _record(argv: Sequence[str]) -> int:
    keep_memory()
    options, ros_arguments = cli.with_ros(_parser(), argv)
    _check(options)
    attachments = {path.name: _content(path) for path in options.attach}
    # Imported only after parsing, so that --help and errors in the options are printed at once.
    from sandbot_record.nodes.recorder_node import Selection, record

    selection = Selection(
        tuple(dict.fromkeys(options.topics)),
        options.all,
        options.regex,
        options.exclude,
        options.images,
        options.fresh,
        options.end_with_stdin,
    )
    code, line = record(selection, lambda: _begin(options, attachments), ros_arguments)
    if line:
        print(line, flush=True)
    return code


def _begin(options: argparse.Namespace, attachments: Mapping[str, bytes]) -> "Recording":
    """Open the bag. Raises InputError if it can't be opened."""
    from sandbot_record.bags.recording import Limits, Recording
    from sandbot_record.bags.writer import BagWriter, Split

    try:
        writer = BagWriter(
            options.out,
            compression=options.compression,
            flush_period_s=0.0,  # Recording does the flushing
            chunk_size=1 << 18,
            fsync=options.fsync,
            split=Split(int((options.max_size or 0) * MIB), options.max_duration or 0.0),
            whole=False,
        )
        recording = Recording(
            writer,
            limits=Limits(int(options.min_free * MIB), options.duration or 0.0),
            images=options.images,
            images_paused=options.pause_images,
            codec=options.video_codec or "rawvideo",
            monotonic_s=time.monotonic,
        )
    except OSError as error:
        raise InputError(f"{options.out}: {error.strerror}") from None
    for name, data in attachments.items():
        recording.attach(name, data)
    return recording


def _parser() -> cli.Parser:
    parser = cli.Parser(prog="record", description=__doc__)
    parser.add_argument("topics", nargs="*", metavar="TOPIC", help="topics to record")
    parser.add_argument("--out", "-o", required=True, type=Path, metavar="BAG", help="the bag folder; must not exist")
    parser.add_argument(
        "-a", "--all", action="store_true", help="record every topic, including those that appear later"
    )
    parser.add_argument("--regex", "-e", default="", help="record topics whose name matches, including later ones")
    parser.add_argument("--exclude", "-x", default="", help="leave out topics whose name matches")
    parser.add_argument("--duration", type=float, metavar="S", help="stop after so many seconds (default: at Ctrl-C)")
    parser.add_argument(
        "--compression", choices=COMPRESSIONS, default="none", help="compression of the chunks (default: none)"
    )
    parser.add_argument(
        "--images",
        choices=("raw", "jpeg", "video", "none"),
        default="raw",
        help="how raw images are recorded: as they are, as JPEG messages, as a video file for each camera, not at all",
    )
    parser.add_argument(
        "--pause-images",
        action="store_true",
        help="record raw images only after /recorder/pause_images is called with false",
    )
    parser.add_argument(
        "--video-codec",
        choices=tuple(CODECS),
        help="codec of --images video (default: rawvideo); ffv1 is smaller and slower",
    )
    parser.add_argument("--max-size", type=float, metavar="MIB", help="begin a new file at this size (default: never)")
    parser.add_argument(
        "--max-duration", type=float, metavar="S", help="begin a new file after this time (default: never)"
    )
    parser.add_argument(
        "--min-free", type=float, default=200.0, metavar="MIB", help="stop when less space is free (default: 200)"
    )
    parser.add_argument("--attach", nargs="+", default=[], type=Path, metavar="YAML", help="files to store in the bag")
    parser.add_argument("--fresh", action="store_true", help="leave out latched messages from before the recording")
    parser.add_argument(
        "--end-with-stdin",
        action="store_true",
        help="end when standard input does; its last line is how the trial ended (exit_status of the bag)",
    )
    parser.add_argument("--fsync", action="store_true", help="survive a power cut, not only a crash")
    return parser


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"--attach: {path}: no such file") from None
    except OSError as error:
        raise InputError(f"--attach: {path}: {error.strerror}") from None


def _check(options: argparse.Namespace) -> None:
    if not (options.topics or options.all or options.regex):
        raise InputError("nothing to record: give topics, --all or --regex")
    for name in ("regex", "exclude"):
        try:
            re.compile(getattr(options, name))
        except re.error as error:
            raise InputError(f"--{name}: {getattr(options, name)!r} is not a regular expression: {error}") from None
    for topic in options.topics:
        if not NAME.fullmatch(topic):
            raise InputError(f"{topic!r} is not a topic name such as /leg_states")
    for name in ("duration", "max_size", "max_duration"):
        value = getattr(options, name)
        if value is not None and not 0 < value < 1e12:
            raise InputError(f"--{name.replace('_', '-')} {value:g}: more than 0 is needed; leave it out for no limit")
    if not 0 <= options.min_free < 1e12:
        raise InputError(f"--min-free: {options.min_free} is not a number from 0 up")
    if options.max_size is not None and options.max_size * MIB < 1:
        raise InputError(f"--max-size: {options.max_size:g} MiB is less than a byte")
    _check_ignored(options)


def _check_ignored(options: argparse.Namespace) -> None:
    """Raise InputError for options that would have no effect."""
    if options.exclude and not (options.all or options.regex):
        raise InputError("--exclude: of topics that are named none is left out; it is for --all or --regex")
    if options.pause_images and options.images == "none":
        raise InputError("--pause-images: --images none records none to pause")
    if options.video_codec is not None and options.images != "video":
        raise InputError(f"--video-codec: --images is {options.images}, not video: nothing would be coded")
    names = [path.name for path in options.attach]
    if twice := next((name for name in names if names.count(name) > 1), ""):
        raise InputError(f"--attach: two files are named {twice}, and a bag carries one of a name")


if __name__ == "__main__":
    raise SystemExit(main())
