"""Aims that are missed, what was measured where, and why: what benchmarks/README.md says beside the ratios."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Short:
    """One aim."""

    what: str
    aim: str
    measured: str
    why: str


ALL = (
    Short(
        "markers followed, beside SimpleBlobDetector",
        "≥ 40 ×",
        "35 to 40 × ([tracking](tracking.md))",
        "the fit of three rims takes 16 to 22 µs a frame, on one machine as on another; medians on a busy one say 46 "
        "to 61 ×, the fastest fifth of the calls, which flatters nobody, 35 to 40 ×",
    ),
    Short(
        "a tracker's first frame, beside SimpleBlobDetector",
        "≥ 3 ×",
        "2.1 to 2.5 × ([tracking](tracking.md))",
        "it is the search of the whole frame (4.2 ×) and then the first fit of each disc, which no frame before has "
        "prepared",
    ),
    Short(
        "columns of a topic",
        "≥ 1.5 M messages/s",
        "0.6 to 1.2 M/s; 15 to 18 × rosbags ([recording](recording.md))",
        "rosbags itself runs at a third of its rate of then: the machine, not the code, which is that which reached it",
    ),
    Short(
        "batch campaign through film",
        "≥ 2 × the speed of before",
        "1.6 ×",
        "0.52 s of CPU a trial of 690 frames: half of it the lab's drawing, 30 % the tracker's, 20 % the bag's, and no "
        "function of them has a tenth; rows equal those of before to 1e-13, not to the byte",
    ),
    Short(
        "table of 147 trials without images",
        "< 2 s",
        "3.0 to 4.5 s of CPU on each of two cores; again 0.25 to 0.34 s ([commands](commands.md))",
        "37 ms a bag (64 before): a third is the fit of the widest window of a step that has no kink, compiled; a "
        "tenth its YAML; machines differ (every `--help` says by how much)",
    ),
    Short(
        "discover, 147 trials",
        "≤ 4 s of CPU",
        "4.5 s, 5.8 s before ([commands](commands.md)); 3.3 and 3.7 s of wall time",
        "1.1 s of it any discovery takes (imports, compiled code read, the base model); a quarter of the rest is the "
        "search for the legs' footing",
    ),
    Short(
        "explorer: click to figure, first page",
        "95 % < 300 ms, < 1.5 s",
        "243 to 358 ms, 1.8 to 2.4 s ([explorer](explorer.md))",
        "by the machine's speed, as above; 1.2 s of the first page is the browser's own work on plotly.js and two "
        "figures; fetching it earlier changed nothing",
    ),
    Short(
        "live latency of the virtual lab",
        "≤ 5 ms median, ≤ 15 ms at 99 %",
        "13 to 17 and 27 to 78 ms ([live](live.md))",
        "two drivers with pictures drawn before are within the aim (3.7 and 6.1 ms); the lab draws a frame at the next "
        "set-point after its exposure, up to 5 ms later, on the two cores that track it",
    ),
    Short(
        "truth in the named set",
        "≥ 99 %",
        "98.7 % of 154 ([hidden](hidden.md))",
        "one of six losses of step that are alike, and one φ that varies along the track, are as small as what "
        "replicates scatter: adequate",
    ),
)


def lines() -> list[str]:
    """The table, in Markdown."""
    head = ["Missed, and why:", "", "| what | aim | measured | why |", "|---|---|---|---|"]
    return head + [f"| {one.what} | {one.aim} | {one.measured} | {one.why} |" for one in ALL]
