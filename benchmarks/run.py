"""``make bench [ONLY=name]`` and ``make bench-quick``. Never part of the tests.

A benchmark is a module here with ``main() -> str`` that returns a section of Markdown: medians of several runs,
peers measured in the same run, ratios rather than bare times. Its report is benchmarks/<name>.md. A long one also has
``sample() -> list[Figure]``, minutes of it: without ONLY that is run, and the report stays as it was. A short one may
say its ``figures() -> list[Figure]`` after ``main``. Figures, how long they took and at which load are kept in
figures.json, of which benchmarks/README.md is made: what a busy machine spoilt can be measured again by itself. What
would not end within the hour is left out. ``--quick`` measures the ratios of a few and fails where one lost more than a
fifth of what the last whole run stored.
"""

import importlib
import os
import pkgutil
import platform
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import _figures
import _ratios
import _short

HERE = Path(__file__).resolve().parent
README = HERE / "README.md"
BUDGET_S = 3300.0
"""An hour, less what times vary by."""
UNKNOWN_S = 240.0
"""What a benchmark is taken to need that has not run yet."""


def main(only: list[str]) -> int:
    """Run the named benchmarks, or all that fit; 2 where a name is unknown, 1 where ``--quick`` finds a loss."""
    if only == ["--quick"]:
        return quick()
    names = sorted(m.name for m in pkgutil.iter_modules([str(HERE)]) if m.name != "run" and not m.name.startswith("_"))
    if unknown := set(only) - set(names):
        print(f"bench: no benchmark {', '.join(sorted(unknown))}; there are {', '.join(names)}", file=sys.stderr)
        return 2
    kept = _figures.stored()
    if only:
        for name in only:
            kept[name] = measured(name, "whole")
    else:
        ratios = _ratios.measured()
        _ratios.store(ratios)
        _ratios.plot(ratios, HERE / "ratios.png")
        whole(names, kept)
    _figures.store(kept)
    README.write_text(readme(_ratios.stored(), kept, names), encoding="utf-8")
    return 0


def quick() -> int:
    """Ratios now against those stored."""
    before = _ratios.stored()
    if not before:
        print(f"bench-quick: no {_ratios.STORED.name} yet: make bench writes it", file=sys.stderr)
        return 2
    now = _ratios.measured()
    print(_ratios.table(now))
    losses = _ratios.fallen(now, before)
    for loss in losses:
        print(f"bench-quick: lost a fifth or more: {loss}", file=sys.stderr)
    return 1 if losses else 0


def whole(names: Sequence[str], kept: dict[str, _figures.Run]) -> None:
    """Run all, the shortest first, that end within the budget by what they last took; one that fails ends no other."""
    begun_s = time.perf_counter()
    expected_s = {name: kept[name].took_s if name in kept else UNKNOWN_S for name in names}
    for name in sorted(names, key=lambda name: (expected_s[name], name)):
        if time.perf_counter() - begun_s + expected_s[name] > BUDGET_S:
            print(f"bench: {name} would not end within the hour", flush=True)
            continue
        try:
            kept[name] = measured(name, "a sample")
        except Exception as error:  # nobody is there to begin anew: the others are worth having
            print(f"bench: {name} failed: {type(error).__name__}: {error}", file=sys.stderr, flush=True)
            continue
        print(*(one.row() for one in kept[name].figures), sep="\n", flush=True)


def measured(name: str, how: str) -> _figures.Run:
    """Run a benchmark: its report, or ``a sample`` of it where it has one."""
    start_s, module = time.perf_counter(), importlib.import_module(name)
    if how == "a sample" and hasattr(module, "sample"):
        print(f"bench: {name}, a sample ...", flush=True)
        figures = list(module.sample())
    else:
        how = "whole"
        report(name)
        figures = list(module.figures()) if hasattr(module, "figures") else []
    return _figures.Run(how, time.perf_counter() - start_s, os.getloadavg()[0], commit(), figures)


def commit() -> str:
    """What is checked out."""
    found = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=HERE, capture_output=True, text=True, check=False
    )
    return found.stdout.strip() or "unknown"


def readme(ratios: list[_ratios.Ratio], kept: Mapping[str, _figures.Run], names: list[str]) -> str:
    """benchmarks/README.md: ratios and figures beside aims and peers, then what was run of each."""
    figures = [figure for name in names if name in kept for figure in kept[name].figures]
    lines = [
        "# Benchmarks",
        "",
        "Written by `make bench`, which runs only a sample of each long report; `make bench ONLY=name` runs one report "
        "completely. `make bench-quick` measures the ratios again and fails if one has fallen by a fifth. Higher "
        "ratios are better; both sides of a ratio are measured in the same run.",
        "",
        f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}; "
        f"{sum(one.took_s for one in kept.values()) / 60:.0f} minutes in total.",
        "",
        _ratios.table(ratios),
        "",
        "![Ratios relative to their aims](ratios.png)",
        "",
        _figures.table(figures),
        "",
        *_short.lines(ratios, figures),
        "| report | run | took | load at its end | commit |",
        "|---|---|---|---|---|",
    ]
    for name in names:
        link = f"[{name}]({name}.md)" if (HERE / f"{name}.md").is_file() else name
        lines.append(f"| {link} | {kept[name].row() if name in kept else f'no: `make bench ONLY={name}` | | |'} |")
    return "\n".join(lines) + "\n"


def report(name: str) -> None:
    """Write a benchmark's report."""
    start = time.perf_counter()
    print(f"bench: {name} ...", flush=True)
    section = importlib.import_module(name).main()
    machine = f"Python {platform.python_version()}, {platform.machine()}; took {time.perf_counter() - start:.0f} s."
    (HERE / f"{name}.md").write_text(f"{section.rstrip()}\n\n{machine}\n", encoding="utf-8")
    print(section, flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
