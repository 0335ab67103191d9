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
        "35 to 36 × ([tracking](tracking.md))",
        "the fit of three rims takes 16 to 22 µs a frame; medians on a busy machine say 46 to 61 ×, the fastest "
        "fifth of the calls, which flatters nobody, 35 to 36 ×",
    ),
    Short(
        "a tracker's first frame, beside SimpleBlobDetector",
        "≥ 3 ×",
        "2.5 × ([tracking](tracking.md))",
        "it is the search of the whole frame (4.2 ×) and then the first fit of each disc, which no frame before has "
        "prepared",
    ),
    Short(
        "columns of a topic",
        "≥ 1.5 M messages/s",
        "0.7 to 1.2 M/s on a busy machine; 15 × rosbags ([recording](recording.md))",
        "not measured on a quiet one since; the code is that which reached it",
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
        "5.9 s of CPU on 2 cores, 0.34 s again ([commands](commands.md))",
        "37 ms a bag (64 before): a third is the fit of the widest window of a step that has no kink, compiled; a "
        "tenth its YAML",
    ),
    Short(
        "explorer's first page",
        "< 1.5 s",
        "1.82 s ([explorer](explorer.md))",
        "1.2 s of it is the browser's own work on plotly.js and two figures; fetching it earlier changed nothing",
    ),
    Short(
        "live latency of the virtual lab",
        "≤ 5 ms median, ≤ 15 ms at 99 %",
        "14 to 17 and 27 to 77 ms ([live](live.md))",
        "two drivers with pictures drawn before are within the aim; the lab draws a frame at the next set-point after "
        "its exposure, up to 5 ms later, on the two cores that track it",
    ),
)


def lines() -> list[str]:
    """The table, in Markdown."""
    head = ["Missed, and why:", "", "| what | aim | measured | why |", "|---|---|---|---|"]
    return head + [f"| {one.what} | {one.aim} | {one.measured} | {one.why} |" for one in ALL]
