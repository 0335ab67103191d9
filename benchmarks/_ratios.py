"""Ratios to peers measured in one run: what ``make bench-quick`` holds and benchmarks/README.md shows."""

import importlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
STORED = HERE / "ratios.json"
MODULES = ("tracking", "recording")
"""Benchmarks with a ``quick() -> list[Ratio]`` of a few seconds."""
LOSS = 0.2


@dataclass(frozen=True)
class Ratio:
    """How many times better than a peer or a bound; more is better."""

    what: str
    peer: str
    value: float
    target: float

    @property
    def key(self) -> str:
        """What is compared from run to run."""
        return f"{self.what}, {self.peer}"

    @property
    def reached(self) -> bool:
        """Whether the aim is."""
        return self.value >= self.target


def measured() -> list[Ratio]:
    """All ratios, now."""
    return [ratio for name in MODULES for ratio in importlib.import_module(name).quick()]


def stored() -> list[Ratio]:
    """Those of the last whole run; none if there was none."""
    return [Ratio(**entry) for entry in json.loads(STORED.read_text(encoding="utf-8"))] if STORED.is_file() else []


def store(ratios: list[Ratio]) -> None:
    """Keep them for the next ``make bench-quick``."""
    STORED.write_text(json.dumps([asdict(ratio) for ratio in ratios], indent=1, ensure_ascii=False) + "\n", "utf-8")


def fallen(now: list[Ratio], before: list[Ratio]) -> list[str]:
    """One line for each ratio that lost more than LOSS of what it was, or is not measured any more."""
    values = {ratio.key: ratio.value for ratio in now}
    return [
        f"{old.key}: {values.get(old.key, 0.0):.2f}, was {old.value:.2f}"
        for old in before
        if values.get(old.key, 0.0) < (1 - LOSS) * old.value
    ]


def table(ratios: list[Ratio]) -> str:
    """Markdown."""
    lines = ["| what | compared with | ratio | aim | |", "|---|---|---|---|---|"]
    for one in ratios:
        reached = "reached" if one.reached else "**short**"
        lines.append(f"| {one.what} | {one.peer} | {one.value:.2f} | {one.target:.2f} | {reached} |")
    return "\n".join(lines)


def plot(ratios: list[Ratio], path: Path) -> None:
    """Each ratio in parts of its aim; the line at 1 is the aim."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7, 0.4 * len(ratios) + 1), layout="constrained")
    parts = [ratio.value / ratio.target for ratio in ratios]
    axes.barh([ratio.key for ratio in ratios], parts, color=["C0" if part >= 1 else "C3" for part in parts])
    axes.axvline(1.0, color="black", linewidth=1)
    axes.invert_yaxis()
    axes.set_xlabel("ratio / aim")
    figure.savefig(path, dpi=100)
    plt.close(figure)
