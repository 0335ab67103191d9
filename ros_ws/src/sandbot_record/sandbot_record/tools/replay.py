"""replay: publish a bag's messages as they were recorded. Space pauses, left/right seek by 1 s, up/down change the
rate."""

from collections.abc import Collection, Sequence
from pathlib import Path

from sandbot_common import cli
from sandbot_common.errors import InputError
from sandbot_common.suggest import did_you_mean
from sandbot_common.topics import NAME


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    return cli.run(_replay, argv)


def _replay(argv: Sequence[str]) -> int:
    parser = cli.Parser(prog="replay", description=__doc__)
    parser.add_argument("bag", type=Path, metavar="BAG", help="a bag's folder, or one .mcap or .db3 file")
    parser.add_argument("--rate", "-r", type=float, default=1.0, help="bag seconds per second (default: 1)")
    parser.add_argument("--loop", "-l", action="store_true", help="begin again at the end of the bag, or at --until")
    parser.add_argument("--start", type=float, default=0.0, metavar="S", help="seconds after the bag's first message")
    parser.add_argument("--until", type=float, metavar="S", help="seconds after the bag's first message")
    parser.add_argument("--topics", nargs="+", metavar="TOPIC", help="publish only these topics")
    parser.add_argument("--remap", "-m", nargs="+", default=[], metavar="OLD:=NEW", help="publish under other names")
    parser.add_argument("--clock", action="store_true", help="publish bag time on /clock, 100 times a second")
    parser.add_argument(
        "--delay", type=float, default=1.0, metavar="S", help="wait this long for subscribers (default: 1)"
    )
    parser.add_argument("--decode-jpeg", action="store_true", help="publish JPEG frames as raw images")
    parser.add_argument(
        "--with-commands", action="store_true", help="publish even into a live trackway: LEGS AND AIR OBEY"
    )
    options, ros_arguments = cli.with_ros(parser, argv)
    if not 0 <= options.delay < 1e6:
        raise InputError(f"--delay: {options.delay} is not a number of seconds from 0 up")
    # Imported only after parsing, so that --help and errors in the options are printed at once.
    from sandbot_record.bags.playback import Player, Timeline
    from sandbot_record.bags.reader import Bag
    from sandbot_record.nodes.replay_node import Options, replay

    timeline = Timeline(Bag.open(options.bag), options.topics, decode_jpeg=options.decode_jpeg)
    if options.decode_jpeg and not timeline.decoded:
        raise InputError("--decode-jpeg: none of the topics that are played has JPEG frames")
    remap = _remap(options.remap, timeline.topics)
    player = Player(timeline, rate=options.rate, loop=options.loop, start_s=options.start, until_s=options.until)
    code, line = replay(player, Options(remap, options.clock, options.delay, options.with_commands), ros_arguments)
    if line:
        print(line, flush=True)
    return code


def _remap(texts: Sequence[str], played: Collection[str]) -> dict[str, str]:
    """New topic names by old ones. Raises InputError if an old one is not ``played`` or is given two new names."""
    pairs: dict[str, str] = {}
    for text in texts:
        old, _, new = text.partition(":=")
        if not NAME.fullmatch(new):
            raise InputError(f"--remap {text!r} is not /old:=/new, topic names such as /leg_states")
        if old not in played:
            raise InputError(f"--remap {text}: {old} is not played{did_you_mean(old, played)}")
        if pairs.setdefault(old, new) != new:
            raise InputError(f"--remap {text}: {old} is {pairs[old]} already")
    return pairs


if __name__ == "__main__":
    raise SystemExit(main())
