"""replay: publish a bag's messages as they were recorded. Space pauses, left/right seek by 1 s, up/down change the
rate."""

from collections.abc import Sequence
from pathlib import Path

from sandbot_common import cli
from sandbot_common.errors import InputError


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    return cli.run(_replay, argv)


def _replay(argv: Sequence[str]) -> int:
    parser = cli.Parser(prog="replay", description=__doc__)
    parser.add_argument("bag", type=Path, metavar="BAG", help="a bag's folder, or one .mcap or .db3 file")
    parser.add_argument("--rate", "-r", type=float, default=1.0, help="bag seconds a second")
    parser.add_argument("--loop", "-l", action="store_true", help="begin again at the end")
    parser.add_argument("--start", type=float, default=0.0, metavar="S", help="seconds after the first message")
    parser.add_argument("--until", type=float, metavar="S", help="seconds after the first message")
    parser.add_argument("--topics", nargs="+", metavar="TOPIC", help="only these")
    parser.add_argument("--remap", "-m", nargs="+", default=[], metavar="OLD:=NEW", help="publish under other names")
    parser.add_argument("--clock", action="store_true", help="publish bag time on /clock, 100 times a second")
    parser.add_argument("--delay", type=float, default=1.0, metavar="S", help="wait for subscribers to find us")
    parser.add_argument("--decode-jpeg", action="store_true", help="publish JPEG frames as raw images")
    parser.add_argument("--with-commands", action="store_true", help="command legs and air also on a live trackway")
    options, ros_arguments = cli.with_ros(parser, argv)
    if not 0 <= options.delay < 1e6:
        raise InputError(f"--delay: {options.delay} is not a number of seconds from 0 up")
    # Imported now that the options are understood: --help and a slip in them are answered at once.
    from sandbot_record.bags.playback import Player, Timeline
    from sandbot_record.bags.reader import Bag
    from sandbot_record.tools.replay_node import Options, replay

    timeline = Timeline(Bag.open(options.bag), options.topics, decode_jpeg=options.decode_jpeg)
    player = Player(timeline, rate=options.rate, loop=options.loop, start_s=options.start, until_s=options.until)
    remap = dict(_pair(text) for text in options.remap)
    code, line = replay(player, Options(remap, options.clock, options.delay, options.with_commands), ros_arguments)
    print(line, flush=True)
    return code


def _pair(text: str) -> tuple[str, str]:
    old, separator, new = text.partition(":=")
    if not separator or not old.startswith("/") or not new.startswith("/"):
        raise InputError(f"--remap {text!r} is not /old:=/new")
    return old, new


if __name__ == "__main__":
    raise SystemExit(main())
