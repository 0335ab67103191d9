"""What a person waits for at the command line: `--help` of every command, the table and discovery of 147 trials.

Judged by CPU time, which other work on the machine hardly changes: what one waits on a free machine, at least.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from importlib.metadata import distributions
from pathlib import Path

import yaml

import scale
from _figures import Figure, table
from sandbot_bringup.tools import campaign

REPEATS = 3
PLAN = {"name": "one", "gait": "UNIFORM", "phi": [0.605], "omega_rad_s": [8.0], "replicates": 1, "images": "none"}
_found: list[Figure] = []


def main() -> str:
    """Markdown with what was measured."""
    helped = {name: seconds([sys.executable, "-c", _help(name, module)], REPEATS) for name, module in scripts()}
    slowest = max(helped, key=lambda name: helped[name][1])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bags = scale.campaign_of_bags(folder / "c147", trial(folder), 147)
        (bags / ".table-cache.json").unlink(missing_ok=True)
        tabled = seconds(_tool("sandbot_record.tools.table", bags, "--out", folder / "t.csv"), 1)
        again = seconds(_tool("sandbot_record.tools.table", bags, "--out", folder / "t.csv"), REPEATS)
        csv = scale.campaign_csv(folder / "d.csv", 49, 3)
        discovered = seconds(_tool("sandbot_model.tools.discover", csv), REPEATS)
    cores = os.cpu_count() or 1
    _found[:] = [
        Figure(
            "`--help`, CPU time of the slowest command", f"{slowest} of {len(helped)}", helped[slowest][1], "≤ 0.6 s"
        ),
        Figure(
            "table of 147 trials without images, CPU time a core", "bags not read before", tabled[1] / cores, "< 2 s"
        ),
        Figure("table of 147 trials, CPU time, second call", "rows cached", again[1], "< 2 s"),
        Figure("discover, 147 trials, CPU time", "one effect hidden", discovered[1], "≤ 4 s"),
    ]
    rows = [f"| `{name} --help` | {wall:.2f} | {cpu:.2f} |" for name, (wall, cpu) in sorted(helped.items())]
    others = {"table, first": tabled, "table, again": again, "discover": discovered}
    rows += [f"| {what}, 147 trials | {wall:.2f} | {cpu:.2f} |" for what, (wall, cpu) in others.items()]
    note = f"Fastest of {REPEATS}, each in a process of its own; load average at the end {os.getloadavg()[0]:.1f}."
    head = ["", "| what | s | CPU s |", "|---|---|---|"]
    return "\n".join(["# Commands", "", table(_found), *head, *rows, "", note])


def figures() -> list[Figure]:
    """Those of the last ``main``."""
    return _found


def scripts() -> list[tuple[str, str]]:
    """Names and modules of all commands."""
    ours = [one for one in distributions() if (one.metadata["Name"] or "").startswith("sandbot")]
    entries = {
        e.name: e.value.partition(":")[0] for one in ours for e in one.entry_points.select(group="console_scripts")
    }
    return sorted(entries.items())


def trial(folder: Path) -> Path:
    """A trial of the virtual lab, filmed and tracked, without its frames."""
    (folder / "one.yaml").write_text(yaml.safe_dump(PLAN))
    if code := campaign.main([str(folder / "one.yaml"), "--out", str(folder / "one"), "--batch"]):
        raise RuntimeError(f"campaign ended with exit code {code}")
    return next((folder / "one" / "trials").iterdir())


def seconds(command: Sequence[str], repeats: int) -> tuple[float, float]:
    """The least time a command took, and CPU time."""
    walls, spent = [], []
    for _ in range(repeats):
        begun_s, before = time.perf_counter(), os.times()
        subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True)
        after = os.times()
        walls.append(time.perf_counter() - begun_s)
        spent.append(after.children_user + after.children_system - before.children_user - before.children_system)
    return min(walls), statistics.median(spent)


def _tool(module: str, *arguments: object) -> list[str]:
    main = f"import sys; from {module} import main; sys.exit(main(sys.argv[1:]))"
    return [sys.executable, "-c", main, *map(str, arguments)]


def _help(name: str, module: str) -> str:
    return f"import sys; sys.argv = [{name!r}, '--help']; from {module} import main; sys.exit(main())"


if __name__ == "__main__":
    print(main())
