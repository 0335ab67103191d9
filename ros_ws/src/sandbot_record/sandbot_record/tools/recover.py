"""recover: copy everything intact in an unfinished or damaged bag to a new, complete one, and report the losses."""

from collections.abc import Sequence
from pathlib import Path

from sandbot_common import cli
from sandbot_common.errors import InputError
from sandbot_common.terminal import counted


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    return cli.run(_recover, argv)


def _recover(argv: Sequence[str]) -> None:
    parser = cli.Parser(prog="recover", description=__doc__)
    parser.add_argument("bag", type=Path, metavar="BAG", help="the bag's folder, or one .mcap file; it is not changed")
    parser.add_argument("new", type=Path, metavar="NEW_BAG", help="the bag to write; must not exist")
    options = parser.parse_args(argv)
    # Imported only after parsing, so that --help and errors in the options are printed at once.
    from sandbot_record.bags.recover import recover

    try:
        result = recover(options.bag, options.new)
    except OSError as error:
        raise InputError(f"{options.new}: {error.strerror}") from None
    for line in result.lines():
        print(line)
    total = counted(sum(result.counts.values()), "message")
    print(f"{options.new}: {total}, complete{' and nothing lost' * result.lossless}")


if __name__ == "__main__":
    raise SystemExit(main())
