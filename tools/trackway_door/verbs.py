"""What there is: each verb's executable, what it does in a line, and what to look at afterwards."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from sandbot_common.terminal import filled


@dataclass(frozen=True)
class Verb:
    """One command. In ``then``, {data} is its first argument and {out} what --out names."""

    name: str
    says: str
    package: str = ""
    """Empty where it is no executable of its own."""
    then: tuple[str, ...] = ()


GROUPS = {
    "begin": (
        Verb(
            "demo", "a blind campaign on the virtual lab, from trials to verdict", "", ("trackway explore runs/demo",)
        ),
        Verb("doctor", "whether this installation works, and what to do if not", "", ("trackway demo",)),
    ),
    "measure": (
        Verb(
            "campaign",
            "run the trials of a plan, live or --batch in the virtual lab",
            "sandbot_bringup",
            ("trackway compare {out}", "trackway discover {out}"),
        ),
        Verb("live", "the whole trackway over DDS with the virtual lab (console:=true)"),
        Verb("lab", "the virtual lab's node alone: robot, bed and cameras", "sandbot_lab"),
        Verb("console", "the live page: STOP, queue, bed, cameras", "sandbot_bringup"),
        Verb("calibrate", "a camera, from points or a chessboard", "sandbot_tracking"),
        Verb("track_video", "films to v_x(t) and the four observables", "sandbot_tracking"),
    ),
    "record": (
        Verb("record", "topics into a bag", "sandbot_record", ("trackway info {out}", "trackway replay {out}")),
        Verb("replay", "publish what a bag holds", "sandbot_record", ("trackway info {data}",)),
        Verb("info", "what a bag holds, and whether it is whole", "sandbot_record", ("trackway replay {data}",)),
        Verb("recover", "what is intact of a torn bag into a whole one", "sandbot_record"),
        Verb("table", "bags to the trials table", "sandbot_record", ("trackway compare {data}",)),
    ),
    "understand": (
        Verb(
            "compare",
            "the model beside the measurements, over the noise floor",
            "sandbot_model",
            ("trackway discover {data}", "trackway explore {data}"),
        ),
        Verb(
            "discover",
            "which physical effect is missing, or that none is",
            "sandbot_model",
            ("trackway explore {data}", "trackway discover {data} --html report.html"),
        ),
        Verb("explore", "the page: switch effects on and watch the error fall", "sandbot_model"),
        Verb("export", "a trial for Rerun (.rrd) or as a clip (.mp4)", "sandbot_model"),
        Verb("atlas", "the paper's figures from any data", "sandbot_model", ("trackway explore {data}",)),
        Verb(
            "effects",
            "the catalogue of effects, and the symbols of formulas",
            "sandbot_model",
            ("trackway effects --quantities", "trackway compare DATA --effects NAME"),
        ),
        Verb("unseal", "open the virtual lab's truth, hold the verdict against it", "sandbot_bringup"),
        Verb("penetrometer", "press a leg into the virtual lab's ground", "sandbot_lab"),
    ),
}
VERBS = {verb.name: verb for group in GROUPS.values() for verb in group}


def usage(others: Sequence[str]) -> str:
    """All verbs, a line each; ``others`` are executables that are forwarded to, too."""
    width = max(map(len, VERBS))
    lines = ["usage: trackway VERB ...      (trackway VERB --help says what a verb takes)"]
    for title, verbs in GROUPS.items():
        lines += ["", f"{title}:", *(f"  {verb.name:<{width}}  {verb.says}" for verb in verbs)]
    return "\n".join([*lines, "", filled(f"one node each: {', '.join(others)}")])


def then(verb: Verb, arguments: Sequence[str]) -> list[str]:
    """What to look at after a verb was run with these arguments; nothing that would need a name not known."""
    out = next((after for name, after in pairwise(arguments) if name in ("--out", "-o")), "")
    known = {"data": _data(arguments), "out": out}
    unknown = [f"{{{name}}}" for name, value in known.items() if not value]
    quoted = {name: shlex.quote(value) for name, value in known.items()}
    return [line.format(**quoted) for line in verb.then if not any(name in line for name in unknown)]


def _data(arguments: Sequence[str]) -> str:
    """The first word that is no option's value; behind a flag (``--verbose DATA``) one that is a file or folder."""
    words = [(before, word) for before, word in pairwise(["", *arguments]) if not word.startswith("-")]
    free = [word for before, word in words if not before.startswith("-") or "=" in before]
    return next(iter([*free, *(word for _, word in words if Path(word).exists())]), "")
