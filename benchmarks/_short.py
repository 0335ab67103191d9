"""Why aims are missed: below the tables of benchmarks/README.md, of the rows that are short there."""

from collections.abc import Sequence

from _figures import Figure
from _ratios import Ratio

_MACHINE = "depends on the machine's speed; "
_LIVE = (
    "two drivers with pictures drawn in advance reach the aim; the lab draws a frame at the next set-point after its "
    "exposure, up to 5 ms later, on the same two cores that run the tracker"
)
WHY = {
    "markers followed": "the fit of three rims takes 16 to 22 µs a frame on every machine; by medians on a busy "
    "machine the ratio is 46 to 61 ×, by the fastest fifth of the calls, which is the fairer measure, 35 to 40 ×",
    "a tracker's first frame": "it consists of the search of the whole frame and the first fit of each disc, which "
    "has no start from an earlier frame",
    "table of 147 trials without images, CPU time a core": f"{_MACHINE}37 ms per bag: a third is the fit of the "
    "widest window of a step without a kink, compiled; a tenth its YAML",
    "discover, 147 trials, CPU time": f"{_MACHINE}every discovery takes 1.1 s of it (imports, loading compiled code, "
    "the base model); a quarter of the rest is the search for the legs' footing",
    "page: click to updated figure, 95 %": f"{_MACHINE}loading plotly.js earlier changed nothing",
    "page: first page": f"{_MACHINE}1.2 s of it is the browser's own work on plotly.js and two figures",
    "exposure to /speed, the virtual lab's cameras, median": _LIVE,
    "exposure to /speed, the virtual lab's cameras, 99 %": _LIVE,
    "truth in the named set (separable, alike, pairs)": "one of six similar losses of step, and one φ that varies "
    "along the track, are no larger than the scatter of replicates: adequate",
    "verdicts right in the paper's world in a real week": "four are adequate although an effect is hidden, seven "
    "unexplained (all in strong doses), one partial; one leaves out one of three effects to be found at once (k fell "
    "by 3 %)",
}
"""Reasons by a row's ``what``. A row that machines reach or miss keeps its reason while it is reached."""


def lines(ratios: Sequence[Ratio], figures: Sequence[Figure]) -> list[str]:
    """The short rows, each with its reason, in Markdown; nothing if every aim is reached."""
    short = [one.what for one in (*ratios, *figures) if not one.reached]
    if not short:
        return []
    rows = [f"| {what} | {WHY.get(what, '**no reason given yet: benchmarks/_short.py**')} |" for what in short]
    return ["Short, and why:", "", "| what | why |", "|---|---|", *rows, ""]
