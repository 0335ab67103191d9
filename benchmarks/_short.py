"""Aims that are missed, what was measured instead, and why, for benchmarks/README.md."""

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
        "markers followed, compared with SimpleBlobDetector",
        "≥ 40 ×",
        "35 to 40 × ([tracking](tracking.md))",
        "the fit of three rims takes 16 to 22 µs a frame on every machine; by medians on a busy machine the ratio is "
        "46 to 61 ×, by the fastest fifth of the calls, which is the fairer measure, 35 to 40 ×",
    ),
    Short(
        "a tracker's first frame, compared with SimpleBlobDetector",
        "≥ 3 ×",
        "2.1 to 2.5 × ([tracking](tracking.md))",
        "it consists of the search of the whole frame (4.2 ×) and the first fit of each disc, which has no start "
        "from an earlier frame",
    ),
    Short(
        "columns of a topic",
        "≥ 1.5 M messages/s",
        "0.6 to 1.2 M/s; 15 to 18 × rosbags ([recording](recording.md))",
        "on this machine rosbags itself runs at a third of its earlier rate; the code is the one that reached the aim",
    ),
    Short(
        "batch campaign through film",
        "≥ 2 × the earlier speed",
        "1.6 ×",
        "0.52 s of CPU per trial of 690 frames: half for the lab's drawing, 30 % for the tracker, 20 % for the bag, "
        "and no single function takes a tenth; rows equal the earlier ones to 1e-13, not to the byte",
    ),
    Short(
        "table of 147 trials without images",
        "< 2 s",
        "3.0 to 4.5 s of CPU on each of two cores; second call 0.25 to 0.34 s ([commands](commands.md))",
        "37 ms per bag (64 before): a third is the fit of the widest window of a step without a kink, compiled; a "
        "tenth its YAML; machines differ (as the time of any `--help` shows)",
    ),
    Short(
        "discover, 147 trials",
        "≤ 4 s of CPU",
        "4.5 s, 5.8 s before ([commands](commands.md)); 3.3 and 3.7 s of wall time",
        "every discovery takes 1.1 s of it (imports, loading compiled code, the base model); a quarter of the rest is "
        "the search for the legs' footing",
    ),
    Short(
        "explorer: click to figure, first page",
        "95 % < 300 ms, < 1.5 s",
        "243 to 358 ms, 1.8 to 2.4 s ([explorer](explorer.md))",
        "depends on the machine's speed, as above; 1.2 s of the first page is the browser's own work on plotly.js and "
        "two figures; loading it earlier changed nothing",
    ),
    Short(
        "live latency of the virtual lab",
        "≤ 5 ms median, ≤ 15 ms at 99 %",
        "13 to 17 and 27 to 78 ms ([live](live.md))",
        "two drivers with pictures drawn in advance reach the aim (3.7 and 6.1 ms); the lab draws a frame at the next "
        "set-point after its exposure, up to 5 ms later, on the same two cores that run the tracker",
    ),
    Short(
        "truth in the named set",
        "≥ 99 %",
        "98.7 % of 154 ([hidden](hidden.md))",
        "one of six similar losses of step, and one φ that varies along the track, are no larger than the scatter of "
        "replicates: adequate",
    ),
)


def lines() -> list[str]:
    """The table, in Markdown."""
    head = ["Missed, and why:", "", "| what | aim | measured | why |", "|---|---|---|---|"]
    return head + [f"| {one.what} | {one.aim} | {one.measured} | {one.why} |" for one in ALL]
