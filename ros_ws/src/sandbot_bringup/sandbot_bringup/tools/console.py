"""``ros2 run sandbot_bringup console [--ros-args -p port:=8060]``: the live page of the running trackway."""

from collections.abc import Sequence

from sandbot_bringup import console_node


def main(argv: Sequence[str] | None = None) -> int:
    """Serve the page until Ctrl-C; exit code as in sandbot_common.cli."""
    return console_node.main(argv)


if __name__ == "__main__":
    raise SystemExit(main())
