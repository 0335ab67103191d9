"""``make bench [ONLY=name]`` and ``make bench-quick``. Never part of the tests.

A benchmark is a module here with ``main() -> str`` that returns a section of Markdown: medians of several runs,
peers measured in the same run, ratios rather than bare times. Its report is benchmarks/<name>.md. A long one also has
``sample() -> list[Figure]``, minutes of it: those figures run without ONLY, and the report stays as it was. A short
one may say its ``figures() -> list[Figure]`` after ``main``. All that ran and how long is in benchmarks/README.md; what
would not end within the hour is left out and named there. ``--quick`` measures the ratios of a few and fails where one
lost more than a fifth of what the last whole run stored.
"""

import importlib
import os
import pkgutil
import platform
import re
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
    if only:
        for name in only:
            report(name)
        return 0
    ratios = _ratios.measured()
    _ratios.store(ratios)
    _ratios.plot(ratios, HERE / "ratios.svg")
    took, figures = whole(names, last_took_s(README))
    README.write_text(readme(ratios, figures, names, took), encoding="utf-8")
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


def last_took_s(page: Path) -> dict[str, float]:
    """What each benchmark took in the last whole run, as its page says."""
    text = page.read_text(encoding="utf-8") if page.is_file() else ""
    return {name: float(took) for name, took in re.findall(r"^\| \[(\w+)\]\(\w+\.md\) \| (\d+) s", text, re.M)}


def whole(names: Sequence[str], last_s: Mapping[str, float]) -> tuple[dict[str, float], list[_figures.Figure]]:
    """Run all, the shortest first, that end within the budget by what they last took: seconds, and figures."""
    begun_s, took, figures = time.perf_counter(), dict[str, float](), list[_figures.Figure]()
    for name in sorted(names, key=lambda name: (last_s.get(name, UNKNOWN_S), name)):
        start_s = time.perf_counter()
        if start_s - begun_s + last_s.get(name, UNKNOWN_S) > BUDGET_S:
            print(f"bench: {name} would not end within the hour", flush=True)
            continue
        try:
            found = _run(name)
        except Exception as error:  # nobody is there to begin anew: the others are worth having
            print(f"bench: {name} failed: {type(error).__name__}: {error}", file=sys.stderr, flush=True)
            continue
        print(*(one.row() for one in found), sep="\n", flush=True)
        figures += found
        took[name] = time.perf_counter() - start_s
    return took, figures


def _run(name: str) -> Sequence[_figures.Figure]:
    """A sample of a long one, the whole of a short one: its figures."""
    module = importlib.import_module(name)
    if hasattr(module, "sample"):
        print(f"bench: {name}, a sample ...", flush=True)
        return list(module.sample())
    report(name)
    return list(module.figures()) if hasattr(module, "figures") else []


def readme(
    ratios: list[_ratios.Ratio], figures: list[_figures.Figure], names: list[str], took_s: Mapping[str, float]
) -> str:
    """benchmarks/README.md: ratios and figures beside aims and peers, then every report and what of it this run did."""
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=HERE, capture_output=True, text=True, check=False
    )
    lines = [
        "# Benchmarks",
        "",
        "Written by `make bench`; `make bench-quick` measures the ratios again and fails on a loss of a fifth. Of a "
        "ratio more is better; both sides of it were measured in one run. Of the long reports this run did a sample; "
        "each was written whole by `make bench ONLY=name`.",
        "",
        f"Commit {commit.stdout.strip() or 'unknown'}; {os.cpu_count()} cores, {platform.machine()}, Python "
        f"{platform.python_version()}; {sum(took_s.values()) / 60:.0f} minutes; load average at the end "
        f"{os.getloadavg()[0]:.1f}.",
        "",
        _ratios.table(ratios),
        "",
        "![Ratios in parts of their aims](ratios.svg)",
        "",
        _figures.table(figures),
        "",
        *_short.lines(),
        "",
        "| report | took | this run |",
        "|---|---|---|",
    ]
    for name in names:
        link = f"[{name}]({name}.md)" if (HERE / f"{name}.md").is_file() else name
        took = f"{took_s[name]:.0f} s" if name in took_s else "–"
        lines.append(f"| {link} | {took} | {_did(name, took_s)} |")
    return "\n".join(lines) + "\n"


def _did(name: str, took_s: Mapping[str, float]) -> str:
    if name not in took_s:
        return f"no: `make bench ONLY={name}`"
    return "a sample" if hasattr(importlib.import_module(name), "sample") else "whole"


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
