"""Cost over trials, bags and conditions: CPU time and memory of the commands themselves, each in a process of its own.

By CPU time, of the process and its workers together, so that whatever else a machine does counts little.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from _drawn import drawn
from _figures import Figure
from sandbot_common import messages, topics
from sandbot_common.serialization import to_cdr
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_record.bags.reader import Bag
from sandbot_record.bags.writer import BagWriter
from sandbot_record.trials.csv_table import write_csv

HERE = Path(__file__).resolve().parent
FIGURE = HERE / "scale.png"
TRIALS = (147, 1_470, 14_700, 100_009)
"""At the same 49 conditions."""
CONDITIONS = (49, 98, 196, 392)
"""Of three trials each."""
BAGS = (100, 1_000, 10_000)
COMMANDS = {
    "table": ["sandbot_record.tools.table", "--out"],
    "compare": ["sandbot_model.tools.compare", "--json"],
    "discover": ["sandbot_model.tools.discover", "--max-effects", "1", "--json"],
}


@dataclass(frozen=True)
class Cost:
    """What one command took."""

    curve: str
    size: int
    cpu_s: float
    memory_mb: float


def cost(curve: str, size: int, module: str, *arguments: object) -> Cost:
    """Run a tool and take what the system says it took."""
    main = f"import sys; from {module} import main; sys.exit(main(sys.argv[1:]))"
    process = subprocess.Popen(
        [sys.executable, "-c", main, *map(str, arguments)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )
    assert process.stderr is not None
    said = process.stderr.read()
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"{module} {arguments}: {said.decode()}")
    return Cost(curve, size, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)


def campaign_csv(path: Path, conditions: int, replicates: int) -> Path:
    """A table of trials in which one effect acts."""
    walker = model_of("simple", ("stance_overlap",), catalogue()).walker
    phi = np.linspace(0.585, 0.632, 7)
    trials = drawn(walker, [{"eta": 0.15}], phi, np.linspace(4.0, 30.0, conditions // 7), replicates, seed=1)
    write_csv(trials, path)
    return path


def campaign_of_bags(folder: Path, source: Path, count: int) -> Path:
    """A campaign of so many bags: one trial's messages under other names."""
    kept = [(one.topic, one.type, bytes(one.data), one.log_time_ns) for one in Bag.open(source).messages()]
    for index in range(len(list(folder.glob("trials/*"))), count):
        name = f"t{index:05d}"
        plan = messages.string(json.dumps({"trial_id": name, "omega_rad_s": 12.0, "gait": "UNIFORM"}))
        with BagWriter(folder / "trials" / name) as writer:
            for topic, kind, data, at_ns in kept:
                writer.add_topic(topic, kind)
                writer.write(topic, to_cdr(plan) if topic == topics.TRIAL.name else data, at_ns)
            writer.metadata("trial", {"id": name, "exit_status": "ok"})
    return folder


def over_tables(folder: Path) -> list[Cost]:
    """All three commands over trials, and what fits over conditions."""
    found = []
    for size in TRIALS:
        path = campaign_csv(folder / "t.csv", 49, size // 49)
        for name, (module, *options) in COMMANDS.items():
            found.append(cost(f"{name}, trials", size, module, path, *options, folder / f"out.{name}"))
            print(found[-1], flush=True)
    for size in CONDITIONS:
        path = campaign_csv(folder / "t.csv", size, 3)
        for name in ("compare", "discover"):
            module, *options = COMMANDS[name]
            found.append(cost(f"{name}, conditions", size, module, path, *options, folder / f"out.{name}"))
            print(found[-1], flush=True)
    return found


def over_bags(folder: Path, source: Path, sizes: Sequence[int]) -> list[Cost]:
    """``table`` of a folder of bags: the first call and a second one."""
    found, module = [], COMMANDS["table"][0]
    for size in sizes:
        campaign = campaign_of_bags(folder / "c", source, size)
        (campaign / ".table-cache.json").unlink(missing_ok=True)
        for name in ("first call", "second call"):
            found.append(cost(f"table of bags, {name}", size, module, campaign, "--out", folder / "bags.csv"))
            print(found[-1], flush=True)
    return found


def slope(costs: Sequence[Cost]) -> float:
    """The power of the size by which CPU time grows between the last two."""
    (a, b) = costs[-2:]
    return float(np.log(b.cpu_s / a.cpu_s) / np.log(b.size / a.size))


def plot(curves: dict[str, list[Cost]]) -> None:
    """CPU time over size, one panel for what the size counts."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(1, 3, figsize=(11, 3.5), layout="constrained")
    for panel, counted in zip(panels, ("trials", "conditions", "bags"), strict=True):
        for name, costs in curves.items():
            if counted in name.split(", " if counted != "bags" else " of "):
                label = name.removesuffix(f", {counted}")
            elif counted == "bags" and "bags" in name:
                label = name
            else:
                continue
            panel.loglog([one.size for one in costs], [one.cpu_s for one in costs], "o-", label=label)
        panel.set_xlabel(counted)
        panel.legend()
    panels[0].set_ylabel("CPU time [s]")
    figure.savefig(FIGURE, dpi=100)
    plt.close(figure)


def report(costs: Sequence[Cost]) -> str:
    """The section of the report, in Markdown."""
    curves: dict[str, list[Cost]] = {}
    for one in costs:
        curves.setdefault(one.curve, []).append(one)
    plot(curves)
    lines = [
        "# Scale",
        "",
        "CPU time (the process and its workers; starting Python and loading what it needs takes 1 to 3 s of it) and "
        "the largest memory of one process. Over trials: tables at the same 49 conditions. Over conditions: 7 φ, three "
        "trials each. Over bags: one trial under so many names; a second call finds rows and hashes in "
        "`.table-cache.json`. `discover` with single effects only.",
        "",
        "| command, over | " + " | ".join(["size: CPU s (MB)"] * 4) + " | grows at the end as size to the |",
        "|---|---|---|---|---|---|",
    ]
    for name, found in curves.items():
        cells = [f"{one.size:,}: {one.cpu_s:.1f} ({one.memory_mb:.0f})" for one in found]
        lines.append(f"| {name} | {' | '.join([*cells, *[''] * (4 - len(cells))])} | {slope(found):.2f} |")
    load = f"Load average at the end {os.getloadavg()[0]:.0f} on {os.cpu_count()} cores."
    return "\n".join([*lines, "", "![CPU time over size](scale.png)", "", load])


def sample() -> list[Figure]:
    """Discovery at two sizes of the same conditions, and a campaign's bags twice."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        module, *options = COMMANDS["discover"]
        few, many = (
            cost("discover", size, module, campaign_csv(folder / "t.csv", 49, size // 49), *options, folder / "out")
            for size in (147, 14_700)
        )
        first, second = over_bags(folder, _trial(folder), (100,))
    return [
        Figure("discovery's CPU time, a hundred times the trials", "147 trials", many.cpu_s / few.cpu_s, "≤ 2 ×"),
        Figure("table of bags, the second call", "100 bags", 100 * second.cpu_s / first.cpu_s, "≤ 20 %"),
    ]


def _trial(folder: Path) -> Path:
    sys.path.insert(0, str(HERE.parent / "tests" / "unit" / "sandbot_record"))
    from bags import trial_bag

    return trial_bag(folder / "trial")


def main() -> str:
    """Measure; the section of the report, in Markdown."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        costs = over_bags(folder, _trial(folder), BAGS)
        return report([*costs, *over_tables(folder)])


if __name__ == "__main__":
    print(main())
