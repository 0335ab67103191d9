"""``make bench [ONLY=name]`` and ``make bench-quick``. Never part of the tests.

A benchmark is a module here with ``main() -> str`` that returns a section of Markdown: medians of several runs,
peers measured in the same run, ratios rather than bare times. Its report is benchmarks/<name>.md. Without ONLY those
run, the shortest first, that fit into an hour by what they took the last time; benchmarks/README.md says which did.
``--quick`` measures the ratios of a few and fails where one lost more than a fifth of what the last whole run stored.
"""

import importlib
import os
import pkgutil
import platform
import re
import subprocess
import sys
import time
from pathlib import Path

import _ratios
import _short

HERE = Path(__file__).resolve().parent
BUDGET_S = 3300.0
"""An hour, less what times vary by."""
UNKNOWN_S = 600.0
"""What a benchmark is taken to need that has not run yet."""


def main(only: list[str]) -> int:
    """Run the named benchmarks, or all that fit; 2 where a name is unknown, 1 where ``--quick`` finds a loss."""
    if only == ["--quick"]:
        return quick()
    names = sorted(m.name for m in pkgutil.iter_modules([str(HERE)]) if m.name != "run" and not m.name.startswith("_"))
    if unknown := set(only) - set(names):
        print(f"bench: no benchmark {', '.join(sorted(unknown))}; there are {', '.join(names)}", file=sys.stderr)
        return 2
    took = {name: last_took_s(HERE / f"{name}.md") for name in names}
    chosen = only or fitting(took, BUDGET_S)
    for name in chosen:
        _report(name)
    if not only:
        ratios = _ratios.measured()
        _ratios.store(ratios)
        _ratios.plot(ratios, HERE / "ratios.svg")
        (HERE / "README.md").write_text(readme(ratios, names, chosen), encoding="utf-8")
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


def last_took_s(report: Path) -> float:
    """What a report says its run took."""
    found = re.search(r"took (\d+) s", report.read_text(encoding="utf-8")) if report.is_file() else None
    return float(found[1]) if found else UNKNOWN_S


def fitting(took_s: dict[str, float], budget_s: float) -> list[str]:
    """The shortest benchmarks that fit into a budget together."""
    chosen, spent = [], 0.0
    for name in sorted(took_s, key=lambda name: (took_s[name], name)):
        if spent + took_s[name] <= budget_s:
            chosen.append(name)
            spent += took_s[name]
    return chosen


def readme(ratios: list[_ratios.Ratio], names: list[str], ran: list[str]) -> str:
    """benchmarks/README.md: ratios beside aims and peers, then every report and whether this run wrote it."""
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=HERE, capture_output=True, text=True, check=False
    )
    lines = [
        "# Benchmarks",
        "",
        "Written by `make bench`; `make bench-quick` measures these ratios again and fails on a loss of a fifth. More "
        "is better; both sides of a ratio were measured in one run.",
        "",
        f"Commit {commit.stdout.strip() or 'unknown'}; {os.cpu_count()} cores, {platform.machine()}, Python "
        f"{platform.python_version()}; load average at the end {os.getloadavg()[0]:.1f}.",
        "",
        _ratios.table(ratios),
        "",
        *_short.lines(),
        "",
        "![Ratios in parts of their aims](ratios.svg)",
        "",
        "| report | took | this run |",
        "|---|---|---|",
    ]
    for name in names:
        report = HERE / f"{name}.md"
        took = f"{last_took_s(report):.0f} s" if report.is_file() and "took" in report.read_text("utf-8") else "–"
        link = f"[{name}]({name}.md)" if report.is_file() else name
        said = "yes" if name in ran else f"no: `make bench ONLY={name}`"
        lines.append(f"| {link} | {took} | {said} |")
    return "\n".join(lines) + "\n"


def _report(name: str) -> None:
    start = time.perf_counter()
    print(f"bench: {name} ...", flush=True)
    section = importlib.import_module(name).main()
    machine = f"Python {platform.python_version()}, {platform.machine()}; took {time.perf_counter() - start:.0f} s."
    (HERE / f"{name}.md").write_text(f"{section.rstrip()}\n\n{machine}\n", encoding="utf-8")
    print(section, flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
