"""`make fuzz FUZZ=100000`: real files spoilt at random, for every parser; none may answer with a traceback or hang.

A case is a parser and a number, its seed: it draws a good file and what is done to it, so that any case can be had
again (`python tests/faults/fuzz.py --only plan --case 4711`). It must end as a result, or as an InputError in one line
that names the file. Counts are kept in runs/fuzz.json, from which the next call goes on; benchmarks/fuzz.md shows them.
"""

import argparse
import contextlib
import copy
import io
import json
import random
import re
import resource
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from fuzz_parsers import PARSERS, ROOT, Parser

from sandbot_common.errors import InputError

KEPT, PAGE = ROOT / "runs" / "fuzz.json", ROOT / "benchmarks" / "fuzz.md"
CPU_S, WALL_S = 20.0, 600.0
"""A hang: so much work, or so long a wait; a machine with a load of 25 has taken 29 s for one second of work."""
MEMORY_BYTES = 8 << 30
BATCH = 500
"""Cases after which counts are kept."""
WORDS = [
    word.encode()
    for word in (
        *("nan", ".nan", "inf", "-inf", "1e400", "-1", "0", "1e-320", "9" * 400, "0x10", "1_000", "١٢", "true", "null"),
        *(
            "~",
            "",
            " ",
            "[]",
            "{}",
            "''",
            '"',
            "'",
            ":",
            ";",
            ",",
            "\t",
            "\n",
            "\r",
            "\0",
            "\ufeff",
            "\u2028",
            "é",
            "😀",
        ),
        *("&a ", "*a", "<<: ", "!!python/object:os.system ", "!!binary ", "!!timestamp ", "2026-01-01", "---\n", "..."),
        *("|\n", "> ", "#", "- ", "? ", "__class__", "../../etc/passwd", "/dev/null", "%s", "%00", "{0}", "a" * 5000),
        *("[" * 300, "(" * 300, "1.2.3", "+", "=", "phi", "omega_rad_s", "**9**9**9", "ok", "T", "12:30:00", "1e9"),
        *("against=?" * 1500, "&against=", "%", "&hold=", "; b [1] in 0..1", " in 1..2", "\\"),
    )
] + [b"\xff\xfe", b"\xef\xbb\xbf", b"\x89MCAP0\r\n", b"\xff" * 8, b"\0" * 8]
"""What a file may hold by mistake or malice."""
VALUES: tuple[Any, ...] = (
    *(
        None,
        True,
        False,
        0,
        -1,
        1,
        2**31,
        2**63,
        10**30,
        10**400,
        1e308,
        1e-308,
        float("nan"),
        float("inf"),
        "",
        " ",
        "x",
    ),
    *("0.6", "nan", [], {}, [[]], [None], [1, "a"], [0.6] * 2000, {"a": 1}, "é\n😀", "../x", "\0", "a" * 3000),
)
NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")


@dataclass
class Count:
    """How the cases of one parser have ended so far."""

    cases: int = 0
    good: int = 0
    refused: int = 0
    failures: list[str] = field(default_factory=list)
    mended: int = 0
    """Of those read or refused, how many failed at first."""


def spoilt(seeds: Sequence[bytes], number: int, parser: str) -> bytes:
    """The content of one case."""
    rng = random.Random(f"{parser} {number}")
    content = rng.choice(seeds)
    if rng.random() < 0.4 and (tree := _tree(content)) is not None:
        for _ in range(rng.randint(1, 3)):
            tree = _grafted(copy.deepcopy(tree), rng)
        with contextlib.suppress(yaml.YAMLError, ValueError):
            content = (json.dumps(tree) if content[:1] in b"{[" else yaml.safe_dump(tree)).encode(errors="replace")
        if rng.random() < 0.8:
            return content
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8, 30))):
        content = _edited(content, seeds, rng)
    return content


def _tree(content: bytes) -> Any:
    """What a file of YAML or JSON holds; None for others."""
    if len(content) > 60_000:
        return None
    with contextlib.suppress(yaml.YAMLError, ValueError):
        tree = yaml.load(content, Loader=yaml.CSafeLoader)
        return tree if isinstance(tree, dict | list) else None
    return None


def _grafted(tree: Any, rng: random.Random) -> Any:
    """The tree with one node that is something else, gone, doubled or under another key."""
    places = list(_places(tree))
    if not places:
        return rng.choice(VALUES)
    holder, key = rng.choice(places)
    match rng.randrange(6):
        case 0:
            del holder[key]
        case 1 if isinstance(holder, dict):
            holder[rng.choice((str(key) + "x", str(key)[:-1], 1, None, True, "", 0.5))] = holder.pop(key)
        case 2:
            holder[key] = [holder[key]]
        case 3 if isinstance(holder[key], int | float) and abs(holder[key]) < 1e300:
            holder[key] = holder[key] * rng.choice((-1, 0, 1e-9, 1e6, 1e300, 0.5, 2))
        case 4:
            other, name = rng.choice(places)
            holder[key] = copy.deepcopy(
                other.get(name) if isinstance(other, dict) else other[name % max(len(other), 1)]
            )
        case _:
            holder[key] = rng.choice(VALUES)
    return tree


def _places(tree: Any) -> Iterator[tuple[Any, Any]]:
    if not isinstance(tree, dict | list):
        return
    for key in list(tree) if isinstance(tree, dict) else range(len(tree)):
        yield tree, key
        yield from _places(tree[key])


def _edited(content: bytes, seeds: Sequence[bytes], rng: random.Random) -> bytes:
    """One edit of the bytes."""
    at, size = rng.randint(0, len(content)), rng.choice((1, 1, 2, 8, 40, 400))
    before, taken, after = content[:at], content[at : at + size], content[at + size :]
    match rng.randrange(9):
        case 0:
            return before + after
        case 1:
            return before + rng.choice(WORDS) + content[at:]
        case 2:
            return before + rng.choice(WORDS) + after
        case 3:
            return before + bytes(byte ^ (1 << rng.randrange(8)) for byte in taken[:4]) + content[at + len(taken[:4]) :]
        case 4:
            return before + taken * rng.choice((2, 3, 50)) + after
        case 5:
            other = rng.choice(seeds)
            return before + other[rng.randint(0, len(other)) :]
        case 6 if numbers := list(NUMBER.finditer(content[:200_000])):
            found = rng.choice(numbers)
            return content[: found.start()] + rng.choice(WORDS) + content[found.end() :]
        case 7:
            return before if rng.random() < 0.3 else before + rng.randbytes(size) + after
        case _:
            lines = content.split(b"\n")
            index, other = rng.randrange(len(lines)), rng.randrange(len(lines))
            lines[index], lines[other] = lines[other], lines[index]
            return b"\n".join(lines if rng.random() < 0.5 else [*lines[:index], lines[other], *lines[index:]])


class HangError(Exception):
    """A case that took too long."""


def _alarm(*_: object) -> None:
    raise HangError(f"more than {CPU_S:g} s of work, or {WALL_S:g} s of waiting")


def run(parser: Parser, path: Path, content: bytes) -> str:
    """``good``, ``refused``, or what went wrong."""
    path.write_bytes(content)
    signal.setitimer(signal.ITIMER_PROF, CPU_S)
    signal.setitimer(signal.ITIMER_REAL, WALL_S)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            parser.read(path)
    except InputError as error:
        said = str(error)
        if "\n" in said or "\r" in said:
            return f"several lines: {said!r}"
        named = not parser.names_file or str(path.parent) in said
        return "refused" if named else f"without the file's name: {said}"
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:
        where = [one for one in traceback.extract_tb(error.__traceback__) if "/sandbot_" in one.filename]
        last = f"{Path(where[-1].filename).name}:{where[-1].lineno}" if where else "?"
        return f"{type(error).__name__} at {last}: {' '.join(str(error).split())[:160]}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
    return "good"


@contextlib.contextmanager
def careful() -> Iterator[None]:
    """A case may take no more than so much memory, and no longer than so long; numpy keeps quiet, as in a command."""
    before = {one: signal.signal(one, _alarm) for one in (signal.SIGALRM, signal.SIGPROF)}
    limits = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY_BYTES, limits[1]))
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limits)
        for one, handler in before.items():
            signal.signal(one, handler)


def cases(parser: Parser, numbers: Sequence[int], folder: Path, count: Count) -> None:
    """Run some cases and count how they end."""
    here = folder / parser.name
    here.mkdir(exist_ok=True)
    seeds = parser.seeds(here)
    with careful():
        for number in numbers:
            ended = run(parser, here / parser.file, spoilt(seeds, number, parser.name))
            count.cases += 1
            count.good += ended == "good"
            count.refused += ended == "refused"
            if ended not in ("good", "refused"):
                count.failures.append(f"{number}: {ended}")


def again_what_failed(parser: Parser, folder: Path, count: Count) -> None:
    """Run the cases anew that have failed: those that do no longer are mended."""
    failed, count.failures = count.failures, []
    count.cases -= len(failed)
    cases(parser, [int(one.partition(":")[0]) for one in failed], folder, count)
    count.mended += len(failed) - len(count.failures)


def page(counts: dict[str, Count]) -> str:
    """benchmarks/fuzz.md."""
    total = sum(count.cases for count in counts.values())
    failed = sum(len(count.failures) for count in counts.values())
    lines = [
        "# Spoilt files and texts",
        "",
        f"{total:,} cases, {failed} of them a traceback, a hang (over {CPU_S:g} s of CPU), {MEMORY_BYTES >> 30} GB, an "
        "error of several lines or one without its file's name. `make fuzz FUZZ=N` runs N more; the seed of a case "
        "is its parser and its number, counted on from the last run. `make test` runs a sample "
        "(`tests/faults/test_fuzz.py`), and every case that once failed.",
        "",
        "A case takes a real file (the project's plans, worlds, robots, cameras and tables, the bag of a trial, what "
        "`discover` wrote) and changes it: bytes flipped, cut, doubled or exchanged with another file's, numbers and "
        "words replaced by odd ones, nodes of the tree removed, renamed, nested or given other types.",
        "",
        "Mended, counted from 50,000 on: cases that failed when they were first run, and are read or refused since.",
        "",
        "| parser | cases | read all the same | refused in one line | mended | failed |",
        "|---|---|---|---|---|---|",
    ]
    for name, count in counts.items():
        figures = f"{count.cases:,} | {count.good:,} | {count.refused:,} | {count.mended} | {len(count.failures)}"
        lines.append(f"| {name} | {figures} |")
    return "\n".join(lines) + "\n"


def main(argv: Sequence[str] | None = None) -> int:
    """Run cases, keep the counts, write the page; 1 where one failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--only", nargs="+", choices=[one.name for one in PARSERS])
    parser.add_argument("--case", type=int, help="one case, with its content and traceback")
    options = parser.parse_args(argv)
    chosen = [one for one in PARSERS if not options.only or one.name in options.only]
    with tempfile.TemporaryDirectory() as name:
        if options.case is not None:
            return again(chosen[0], options.case, Path(name))
        kept = json.loads(KEPT.read_text()) if KEPT.exists() else {}
        counts = {one.name: Count(**kept.get(one.name, {})) for one in PARSERS}
        shares = sum(one.share for one in chosen)
        for one in chosen:
            if counts[one.name].failures:
                again_what_failed(one, Path(name), counts[one.name])
            first, before = counts[one.name].cases, len(counts[one.name].failures)
            last = first + round(options.cases * one.share / shares)
            for start in range(first, last, BATCH):
                cases(one, range(start, min(start + BATCH, last)), Path(name), counts[one.name])
                KEPT.parent.mkdir(exist_ok=True)
                KEPT.write_text(json.dumps({name: asdict(count) for name, count in counts.items()}, indent=1))
            found = counts[one.name]
            print(f"{one.name}: {found.cases} cases, {found.good} good, {found.refused} refused", flush=True)
            print(*found.failures[before:], sep="\n", end="\n" * bool(found.failures[before:]))
    PAGE.write_text(page(counts), encoding="utf-8")
    return int(any(count.failures for count in counts.values()))


def again(parser: Parser, number: int, folder: Path) -> int:
    """One case in full."""
    content = spoilt(parser.seeds(folder), number, parser.name)
    path = folder / parser.file
    path.write_bytes(content)
    sys.stdout.write(f"{content[:3000]!r}\n")
    parser.read(path)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
