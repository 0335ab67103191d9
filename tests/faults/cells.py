"""What came of the cells of the matrix of faults: JSON lines, and the tables of docs/faults.md made of them."""

import argparse
import fcntl
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

HEAD = ("who", "fault", "moment", "legs [s]", "air [s]", "bag", "exit_status", "campaign", "left running", "load")
NEVER_CAME = "the moment never came"
"""Of a cell whose trial a busy machine ended before the fault: it says nothing, and is run again."""
NONE = "-"

Row = Mapping[str, str]
Key = tuple[str, str, str]


def key(row: Row) -> Key:
    """Who was struck, by what, when."""
    return row["who"], row["fault"], row["moment"]


def read(path: Path) -> dict[Key, Row]:
    """The last row of each cell; one whose moment never came only where there is no other."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    rows = [dict(zip(HEAD, json.loads(line), strict=True)) for line in lines]
    return {key(row): row for row in sorted(rows, key=lambda row: not spoilt(row))}


def add(path: Path, row: Sequence[str]) -> None:
    """Append a row; others may write there, too."""
    with path.open("a", encoding="utf-8") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.write(json.dumps(row, ensure_ascii=False) + "\n")


def spoilt(row: Row) -> bool:
    return row["exit_status"].startswith(NEVER_CAME)


def missing(cells: Iterable[Key], path: Path) -> list[Key]:
    """The cells that have not been run, or in vain."""
    done = read(path)
    return [cell for cell in cells if cell not in done or spoilt(done[cell])]


def line(values: Iterable[str]) -> str:
    """A line of a table."""
    return "| " + " | ".join(values) + " |"


def table(rows: Iterable[Row]) -> str:
    """All cells, a line each."""
    return "\n".join([line(HEAD), "|" + "---|" * len(HEAD), *(line(row[name] for name in HEAD) for row in rows)])


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table of a file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    print(table(read(parser.parse_args(argv).file).values()))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
