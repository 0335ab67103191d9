"""info: what a bag contains, whether it is complete (exit code 1: unfinished or damaged), and where it comes from."""

from collections.abc import Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from sandbot_common import cli
from sandbot_common.errors import InputError
from sandbot_common.terminal import counted
from sandbot_record.bags.reader import Bag
from sandbot_record.bags.video import VideoFrames, place

SHORT = 200
"""Characters shown of a value."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; exit code 1 if the bag is unfinished or damaged."""
    return cli.run(_info, argv)


def _info(argv: Sequence[str]) -> int:
    parser = cli.Parser(prog="info", description=__doc__)
    parser.add_argument("bag", type=Path, metavar="BAG", help="a bag's folder, or one .mcap or .db3 file")
    options = parser.parse_args(argv)
    bag = Bag.open(options.bag, strict=False)
    films = [_film(bag, topic, file) for topic, file in bag.videos.items() if file.is_file()]
    print("\n".join([describe(bag), *films, *_not_measured(bag)]))
    return 1 if bag.problems else 0


def describe(bag: Bag) -> str:
    """The bag in the layout of `ros2 bag info`, then state, provenance and attachments."""
    size = sum(file.stat().st_size for file in bag.files)
    lines = [
        f"Files:             {', '.join(file.name for file in bag.files)}",
        f"Bag size:          {_size(size)}",
        f"Storage id:        {bag.info.storage if bag.info else bag.files[0].suffix.removeprefix('.')}",
        f"ROS Distro:        {bag.info.distro if bag.info else 'unknown'}",
        f"Duration:          {(bag.end_ns - bag.start_ns) * 1e-9:.9f}s",
        f"Start:             {_time(bag.start_ns)}",
        f"End:               {_time(bag.end_ns)}",
        f"Messages:          {bag.count}",
    ]
    topics = [
        f"Topic: {topic.name} | Type: {topic.type} | Count: {topic.count} | "
        f"Serialization Format: {topic.interface.encoding}"
        for topic in bag.topics.values()
    ]
    lines += [f"Topic information: {topics[0] if topics else 'none'}", *(f"{'':19}{line}" for line in topics[1:])]
    lines.append(f"State:             {'complete' if not bag.problems else bag.problems[0]}")
    lines += [f"{'':19}{problem}" for problem in bag.problems[1:10]]
    if len(bag.problems) > 10:
        lines.append(f"{'':19}and {len(bag.problems) - 10} more")
    if bag.problems:
        lines.append(f"{'':19}{bag.remedy}")
    for name, values in bag.provenance.items():
        lines.append(f"Metadata:          {name}")
        lines += [f"{'':19}{key}: {_short(value)}" for key, value in values.items()]
    lines += [f"Attachment:        {name} ({len(data)} bytes)" for name, data in bag.attachments.items()]
    return "\n".join(lines)


def _film(bag: Bag, topic: str, file: Path) -> str:
    """A line on the video of a frame index topic; missing or damaged frames are added to the bag's problems."""
    frames, gone = VideoFrames(file), 0
    for message in bag.messages([topic]):
        try:
            frames.frame(place(message.data))
        except InputError:
            gone += 1
    if gone:
        bag.problems.append(f"{file.name}: {counted(gone, 'frame')} missing or damaged")
    intact = bag.topics[topic].count - gone
    return f"Video:             {file.name} | {intact} frames intact, {gone} not | {_size(file.stat().st_size)}"


def _not_measured(bag: Bag) -> list[str]:
    """A line on what of a whole trial was not measured; none for other bags."""
    # Imported here, so that nobody else waits for it.
    from sandbot_record.trials.from_bags import not_measured

    with suppress(InputError):
        if not bag.problems and (reason := not_measured(bag)):
            return [f"Not measured:      {reason}"]
    return []


def _size(count: float) -> str:
    for unit in ("B", "KiB", "MiB"):
        if count < 1024:
            return f"{count:.1f} {unit}"
        count /= 1024
    return f"{count:.1f} GiB"


def _time(t_ns: int) -> str:
    seconds, rest = divmod(t_ns, 10**9)  # a float has too few digits for ns
    return f"{datetime.fromtimestamp(seconds, UTC):%b %d %Y %H:%M:%S}.{rest:09d} UTC ({seconds}.{rest:09d})"


def _short(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= SHORT else f"{line[:SHORT]}…"


if __name__ == "__main__":
    raise SystemExit(main())
