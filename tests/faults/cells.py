"""What came of the cells of the matrix of faults: JSON lines, and the tables of docs/faults.md made of them."""

import argparse
import fcntl
import json
import math
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
    """Whether it says nothing: the trial was over before the fault, or what was to stop had stopped already."""
    late = row.get({"walking": "legs [s]", "blowing": "air [s]"}.get(row["moment"], ""))
    return row["campaign"].startswith(NEVER_CAME) or late == NONE


def missing(cells: Iterable[Key], path: Path) -> list[Key]:
    """The cells that have not been run, or in vain."""
    done = read(path)
    return [cell for cell in cells if cell not in done or spoilt(done[cell])]


def line(values: Iterable[str]) -> str:
    """A line of a table."""
    return "| " + " | ".join(values) + " |"


def table(rows: Iterable[Row]) -> str:
    """All cells, a line each."""
    return _table(HEAD, ([row[name] if name != "campaign" else _exit(row) for name in HEAD] for row in rows))


def worst(rows: Iterable[Row]) -> str:
    """A line for each fault of each process: the slowest of its moments, and the loads."""
    by: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        by.setdefault((row["who"], row["fault"]), []).append(row)
    head = ("who", "fault", "moments", "legs [s]", "air [s]", "bags whole", "left running", "load")
    return _table(head, ([*who, *_worst(some)] for who, some in by.items()))


def _worst(rows: Sequence[Row]) -> list[str]:
    run = [row for row in rows if not spoilt(row)]
    slowest = (max((row[name] for row in run), default=NONE, key=_seconds) for name in ("legs [s]", "air [s]"))
    whole = sum(row["bag"] == "whole" for row in run)
    left = {row["left running"] for row in run} - {"nothing"}
    loads = sorted(int(row["load"]) for row in run)
    span = f"{loads[0]} to {loads[-1]}" if loads else NONE
    return [str(len(run)), *slowest, str(whole), ", ".join(left) or "nothing", span]


def _seconds(text: str) -> float:
    """What a cell says of legs or air, for comparing."""
    known = {NONE: -1.0, "goes on": 0.0, "NEVER": math.inf}
    return known[text] if text in known else float(text)


def _exit(row: Row) -> str:
    """The campaign's exit code; its last words only where they say more than the trial's bag."""
    code, _, words = row["campaign"].removeprefix("exit ").partition(": ")
    return code if not words or words.endswith(row["exit_status"]) else f"{code}: {words}"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return "\n".join([line(head), "|" + "---|" * len(head), *map(line, rows)])


def main(argv: Sequence[str] | None = None) -> int:
    """Print the tables of a file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    rows = sorted(read(parser.parse_args(argv).file).values(), key=key)
    print(worst(rows), table(rows), sep="\n\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
