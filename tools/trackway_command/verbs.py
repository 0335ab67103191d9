"""What there is: each verb's executable, what it does in a line, and what to look at afterwards."""

import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from sandbot_common.terminal import filled


@dataclass(frozen=True)
class Verb:
    """One command. In ``then``, {data} is what it was given, {out} what --out names, {given} all its arguments."""

    name: str
    says: str
    package: str = ""
    """Empty where it is no executable of its own."""
    then: tuple[str, ...] = ()
    takes: tuple[str, ...] = ()
    """Options that say what is analysed; as the command of a ``then``, it is given those of the verb before."""


SETTING = ("--robot", "--cameras", "--penetrometer", "--effects-from", "--effect")
BED = ("--bed-scatter", "--bed-drift")
FLAGS = ("--verbose", "--batch", "--config-folder", "--dry-run", "--loop", "-l", "--clock", "--decode-jpeg")
FLAGS += ("--with-commands", "--all", "-a", "--pause-images", "--fresh", "--end-with-stdin", "--fsync", "--quantities")
"""Options without a value, of the verbs with a ``then``."""
MANY = ("--attach", "--topics", "--remap")
"""Those with any number of values."""
NEW = ("--next",)
"""Those that name a file which must not be there yet."""

GROUPS = {
    "begin": (
        Verb("demo", "a blind campaign on the virtual lab, from trials to verdict", "", ("trackway explore {data}",)),
        Verb("doctor", "check this installation, and say what to do if it fails", "", ("trackway demo",)),
    ),
    "measure": (
        Verb(
            "campaign",
            "run the trials of a plan, live or --batch in the virtual lab",
            "sandbot_bringup",
            ("trackway compare {out}", "trackway discover {out}"),
        ),
        Verb("live", "all nodes, with the virtual lab (console:=true: and the page)"),
        Verb("lab", "the virtual lab's node alone: robot, bed and cameras", "sandbot_lab"),
        Verb("console", "the live page: STOP, queue, bed, cameras", "sandbot_bringup"),
        Verb("calibrate", "calibrate a camera, from points or a chessboard", "sandbot_tracking"),
        Verb("track_video", "track films: v_x(t) and the four observables", "sandbot_tracking"),
    ),
    "record": (
        Verb("record", "record topics to a bag", "sandbot_record", ("trackway info {out}", "trackway replay {out}")),
        Verb("replay", "publish the messages of a bag", "sandbot_record", ("trackway info {data}",)),
        Verb("info", "what a bag contains, and whether it is complete", "sandbot_record", ("trackway replay {data}",)),
        Verb("recover", "copy what is intact in a damaged bag to a new one", "sandbot_record"),
        Verb("table", "make the trials table from bags", "sandbot_record", ("trackway compare {data}",)),
    ),
    "understand": (
        Verb(
            "compare",
            "fit a model; its errors next to the scatter of replicates",
            "sandbot_model",
            ("trackway discover {data}", "trackway explore {data}"),
            (*SETTING, "--model"),
        ),
        Verb(
            "discover",
            "name the missing physical effect, or say that none is",
            "sandbot_model",
            ("trackway explore {data}", "trackway discover {given} --html report.html"),
            (*SETTING, *BED, "--model"),
        ),
        Verb(
            "explore",
            "a page: switch effects on and watch the error fall",
            "sandbot_model",
            takes=(*SETTING, *BED, "--selection"),
        ),
        Verb("export", "a trial for Rerun (.rrd) or as a clip (.mp4)", "sandbot_model"),
        Verb("atlas", "the paper's figures from any data", "sandbot_model", ("trackway explore {data}",)),
        Verb(
            "effects",
            "the catalogue of effects, and the symbols of formulas",
            "sandbot_model",
            ("trackway effects --quantities",),
        ),
        Verb("unseal", "open the virtual lab's truth, compare the verdict with it", "sandbot_bringup"),
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
    """What to look at after a verb was run with these arguments: commands that work as printed, in the same folder.

    None whose own options were given already.
    """
    data, options = _split(arguments)
    given = {name for name, *_ in options}
    out = [value for name, *values in options if name in ("--out", "-o") for value in values]
    again = [*data, *chain.from_iterable(option for option in options if option[0] not in NEW)]
    again = again if given & set(NEW) else list(arguments)
    known = {"{data}": _lasting(data), "{out}": _lasting(out), "{given}": again if _lasting(data) else []}
    lines = []
    for words in map(str.split, verb.then):
        if not given & set(words) and all(known.get(word, [word]) for word in words):
            takes = () if "{given}" in words else VERBS[words[1]].takes
            taken = [option for option in options if option[0] in takes]
            parts = [known.get(word, [word]) for word in words] + taken
            lines.append(shlex.join(chain.from_iterable(parts)))
    return lines


def _split(arguments: Sequence[str]) -> tuple[list[str], list[list[str]]]:
    """The words that are no option's, and every option with its values."""
    free: list[str] = []
    options: list[list[str]] = []
    room = 0.0
    for word in arguments:
        if word.startswith("-"):
            options.append(word.split("=", 1))
            room = 0 if "=" in word or word in FLAGS else math.inf if word in MANY else 1
        elif room:
            options[-1].append(word)
            room -= 1
        else:
            free.append(word)
    return free, options


def _lasting(paths: list[str]) -> list[str]:
    """These paths, if all are there to be read again; a pipe is not."""
    return paths if all(Path(path).exists() and not path.startswith("/dev/") for path in paths) else []
