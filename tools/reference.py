"""``make docs``: the reference pages, written from the code they describe (docs/lookup/)."""

import argparse
import contextlib
import dataclasses
import io
import json
import math
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from importlib import import_module
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

from json_keys import MEANINGS

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "lookup"
MADE = "<!-- made by tools/reference.py from the code; change it there -->\n"
PACKAGES = (
    *("sandbot_model", "sandbot_record", "sandbot_bringup", "sandbot_tracking", "sandbot_lab", "sandbot_hardware"),
    *("sandbot_clock", "sandbot_bed"),
)
FILES = {
    "A plan (campaign.yaml)": ("sandbot_bringup.plan", "Plan"),
    "extra_trials of a plan": ("sandbot_bringup.plan", "ExtraTrials"),
    "bed of a plan": ("sandbot_bed.protocol", "ProtocolParameters"),
    "gait_parameters of a plan": ("sandbot_clock.gait", "Gait"),
    "robot.yaml": ("sandbot_common.robot", "Robot"),
    "accuracy in cameras.yaml": ("sandbot_common.accuracy", "Accuracy"),
    "world.yaml of the virtual lab": ("sandbot_lab.world", "World"),
    "noise in world.yaml": ("sandbot_lab.world", "Noise"),
    "week in world.yaml": ("sandbot_lab.week", "Week"),
    "resistive in world.yaml": ("sandbot_lab.resistive", "ResistiveGround"),
    "film in world.yaml": ("sandbot_lab.film", "Film"),
}
EXAMPLE = "examples/demo_trials.csv"


def main() -> int:
    """Write every page, printing its name."""
    FOLDER.mkdir(exist_ok=True)
    (FOLDER / "drawings").mkdir(exist_ok=True)
    for name, text in (*pages(), *drawings()):
        (FOLDER / name).write_text(text, encoding="utf-8")
        print(f"docs/lookup/{name}")
    return 0


def pages() -> Iterator[tuple[str, str]]:
    """Each page's file name and text."""
    yield "commands.md", commands()
    yield "files.md", files()
    yield "topics.md", all_topics()
    yield "formulas.md", formulas()
    yield "effects.md", all_effects()
    yield "json.md", schemas()


def drawings() -> Iterator[tuple[str, str]]:
    """The drawing of each effect that has one, and its file's name."""
    from sandbot_model.report.drawings import MOTIFS, drawing

    for name in MOTIFS:
        yield f"drawings/{name}.svg", drawing(name) or ""


def all_effects() -> str:
    """The catalogue as cards."""
    from sandbot_model.physics.effects import CATALOGUE
    from sandbot_model.physics.typeset import mathml_in_pieces
    from sandbot_model.report.effect_facts import range_of, words

    parts = [
        f"{MADE}# Effects\n\nWhat the walking models can lack. Drawn in colour: what the effect adds. "
        "`trackway effects NAME` computes where one would show; the explorer's cards (`/effects`) show "
        "it over φ and ω, and what each brings on your data.\n"
    ]
    for effect in CATALOGUE:
        name = effect.identifier
        facts = [f"acts on {effect.stage}", *map(range_of, effect.parameters)]
        facts += [f"control: {effect.control}"] * bool(effect.control) + [f"source: {effect.source}"]
        listed = "".join(f"<li>{escape(fact)}</li>" for fact in facts)
        parts.append(
            f"## {name}\n\n![{name.replace('_', ' ')}](drawings/{name}.svg)\n\n{words(effect)}.\n\n"
            f"<p>{mathml_in_pieces(effect.formula)}</p>\n<ul>{listed}</ul>\n"
        )
    return "\n".join(parts)


def commands() -> str:
    """--help of every executable."""
    parts = [f"{MADE}# Commands\n\nEach is `trackway NAME`, or, after `source env.sh`, `ros2 run PACKAGE NAME`.\n"]
    for package in PACKAGES:
        parts.append(f"## {package}\n")
        for entry in sorted(
            distribution(package).entry_points.select(group="console_scripts"), key=lambda one: one.name
        ):
            parts.append(f"### {entry.name}\n\n```text\n{help_of(entry.name, entry.load())}\n```\n")
    return "\n".join(parts)


def help_of(name: str, command: Any) -> str:
    """The output of ``--help``, in lines of 100 columns."""
    said, before = io.StringIO(), (sys.argv, os.environ.get("COLUMNS"))
    sys.argv, os.environ["COLUMNS"] = [name], "100"
    try:
        with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
            command(["--help"])
    finally:
        sys.argv = before[0]
        os.environ.pop("COLUMNS") if before[1] is None else os.environ.update(COLUMNS=before[1])
    return said.getvalue().strip()


def files() -> str:
    """The keys of every YAML file."""
    parts = [f"{MADE}# Keys of YAML files\n\nAn unknown key is an error; a key that is left out has its default.\n"]
    for title, (module, name) in FILES.items():
        parts.append(f"## {title}\n\n{keys(getattr(import_module(module), name))}\n")
    return "\n".join([*parts, lab_effects()])


def lab_effects() -> str:
    """The effects a world may contain."""
    from sandbot_lab.effects import EFFECTS

    rows = [
        (
            f"`{name}`",
            " or ".join(f"`{word}`" for word in (one.name, one.catalogue) if word),
            one.spec.unit or "–",
            f"{one.spec.low:g} to {one.spec.high:g}",
            f"`{one.default:g}`",
            one.spec.doc,
        )
        for name, effect in EFFECTS.items()
        for one in effect.parameters
    ]
    bare = ", ".join(f"`{name}`" for name, effect in EFFECTS.items() if not effect.parameters)
    return (
        "## effects in world.yaml\n\nAs in `effects: {stance_overlap: {eta: 0.15}}`; `{}` for all defaults. "
        "Where the catalogue has another name for a parameter, that is\n"
        "accepted too, in the catalogue's unit (`chi_rad` in rad). No effect named x_… is in the catalogue. Without a "
        "parameter: "
        f"{bare}.\n\n"
        f"{table(('effect', 'parameter', 'unit', 'range', 'default', 'meaning'), rows)}\n"
    )


def keys(cls: type) -> str:
    """The parameters of a dataclass as a table."""
    from sandbot_common.parameters import specs

    defaults = {field.name: _default(field) for field in dataclasses.fields(cls)}
    rows = [
        (f"`{spec.name}`", spec.unit or "–", _range(spec), f"`{defaults[spec.name]}`", spec.doc) for spec in specs(cls)
    ]
    return table(("key", "unit", "range", "default", "meaning"), rows)


def _default(field: "dataclasses.Field[Any]") -> str:
    if field.default is not dataclasses.MISSING:
        return repr(field.default)
    return "needed" if field.default_factory is dataclasses.MISSING else repr(field.default_factory())


def _range(spec: Any) -> str:
    if spec.choices:
        return ", ".join(map(str, spec.choices))
    low, high = ("" if math.isinf(end) else f"{end:g}" for end in (spec.low, spec.high))
    return f"{low} to {high}".strip() if low or high else "–"


def all_topics() -> str:
    """Names, types and QoS of the topics."""
    from sandbot_common import topics

    rows = [
        (f"`{topic.name}`", f"`{topic.type}`", "latched" if topic.latched else "–")
        for topic in (*topics.ALL, *topics.UNRECORDED)
    ]
    return f"{MADE}# Topics\n\n{table(('topic', 'type', 'QoS'), list(dict.fromkeys(rows)))}\n"


def formulas() -> str:
    """The language of formulas."""
    from sandbot_model.physics import formula, symbols

    rows = [(", ".join(f"`{s}`" for s in one.spellings), one.unit, one.stage, one.doc) for one in symbols.listed()]
    functions = ", ".join(f"`{name}`" for name in sorted({*formula.FUNCTIONS, *formula.SHORT}))
    return (
        f"{MADE}# The language of formulas\n\n"
        f"`--effect 'NAME: STAGE: FORMULA; parameter [unit] in LOW..HIGH; ...'`\n\n"
        f"A bare formula is the new value of its stage's quantity: "
        f"{', '.join(f'{stage} sets `{name}`' for stage, name in formula.MAIN.items())}. `X -> ...` or `X = ...` sets "
        "another one, `X *= ...`, `X /= ...`, `X += ...` and `X -= ...` change it, `X, Y *= ...` several alike; "
        "further formulas may follow, which act in turn: `s *= 1 - a; peak *= 1 - a/2; a [1] in 0..1`. Products are "
        "`*` or `·`, powers `^`, `**` or `²`; "
        f"comparisons are 1 or 0. Functions: {functions}; `pi`.\n\n"
        "LOW..HIGH is where a parameter is plausible. A fit searches half that width further to either side, and says "
        "so where it ends there; in Python `hard_low` and `hard_high` are never crossed. A parameter of a symbol's "
        "name stands in its place, unless the formula sets that symbol. Units are labels and are not checked.\n\n"
        "In search of a footing every depth `d` is tried, in the first step (`first`) as in all others, and the stages "
        f"run in the order {', '.join(symbols.READABLE)}: a quantity may be read and set from its own on. `σ` shows in "
        "what is fitted, which is averaged along the track. φ can't be set, as k does not follow it: `k -> K(phi + "
        "0.01)` is the ground at another φ; beyond the measured φ, that at the nearest of them. `g` is the robot's "
        "until balance, where it may be set.\n\n"
        f"{table(('symbol', 'unit', 'from stage', 'meaning'), rows)}\n"
    )


def schemas() -> str:
    """The keys of what compare and discover write, taken from results of the example and of parts of it."""
    parts = [
        f"{MADE}# Keys of JSON results\n\nAs written of {EXAMPLE}, whole, without replicates, with fewer observables, "
        "and with a first step that no effect explains; `[]` is one of a list, `*` a name of its own. What is not "
        "known or not there is null. What only other tables have, or leave unknown, is added.\n"
    ]
    for name, contents in results().items():
        parts.append(f"## {name} --json (`{contents[0]['schema']}`)\n")
        keys = merged(contents, OF_OTHER_TABLES[name])
        rows = [(f"`{key}`", kind, MEANINGS[key]) for key, kind in keys]
        parts.append(table(("key", "type", "meaning"), rows) + "\n")
    return "\n".join(parts)


def results() -> dict[str, list[dict[str, Any]]]:
    """Results by command; identified, untested, adequate, ambiguous and partial ones together have all keys."""
    from sandbot_model.data.conditions import cells_of
    from sandbot_model.data.quality import checked
    from sandbot_model.discovery.compare import compare
    from sandbot_model.discovery.discover import discover
    from sandbot_model.physics.effects import CATALOGUE
    from sandbot_record.trials.read import read
    from sandbot_record.trials.table import from_rows

    whole, overlap = read(ROOT / EXAMPLE), "stance_overlap"
    effects = {effect.identifier: effect for effect in CATALOGUE}

    def changed(*left_out: str, first_step: float = 1.0) -> Any:
        missing = dict.fromkeys(left_out, math.nan)
        rows = [dataclasses.replace(row, first_step_m=first_step * row.first_step_m) for row in whole.rows()]
        return from_rows([dataclasses.replace(row, **missing) for row in rows])

    once = from_rows([row for row in whole.rows() if row.replicate == 1])
    speed = changed("lift_m", "peak_speed_m_s", "first_step_m")
    tried = (
        (whole, (overlap, "cohesion", "inertial_drag")),
        (once, (overlap,)),
        (speed, (overlap, "leg_slip")),
        (changed("peak_speed_m_s", "first_step_m"), (overlap, "leg_slip", "cable_drag")),
        (changed(first_step=1.3), (overlap,)),
    )

    def written(found: Any, trials: Any) -> Any:
        content = found.to_dict()
        content["data"]["notes"] = checked(trials)
        return json.loads(json.dumps(content))

    return {
        "compare": [written(compare(cells_of(trials), effects, [overlap]), trials) for trials in (whole, once, speed)],
        "discover": [
            written(discover(cells_of(trials), {name: effects[name] for name in names}, max_effects=1), trials)
            for trials, names in tried
        ],
    }


NAMED = ("parameters", "rmse", "cv_rmse", "lack_of_fit", "noise_floor", "variants", "correlations")
"""Keys below which are names of parameters, observables or effects."""
_TYPES = {str: "text", bool: "true or false", int: "number", float: "number", type(None): "null"}


OF_STEPS = {
    "data.notes[]": "text",
    "steps[].at_bounds[]": "text",
    "steps[].implausible[]": "text",
    "steps[].variants.*": "text",
    "steps[].parameters.*.stderr": "null",
    "steps[].cv_rmse_m_s": "null",
}
OF_OTHER_TABLES: dict[str, dict[str, str]] = {
    "compare": OF_STEPS,
    "discover": OF_STEPS
    | {
        "candidates[].cv_rmse_m_s": "null",
        "controls.*": "text",
        "error_rates[].hidden[]": "text",
        "error_rates[].statuses.*": "number",
        **{f"error_rates[].{rate}.{key}": "number" for rate in ("named", "false_claims") for key in ("count", "of")},
        **{f"error_rates[].{rate}.at_95[]": "number" for rate in ("named", "false_claims")},
        "next_trials[].omega_rad_s": "null",
        "nuisances[].stderr": "null",
        "variants.*": "text",
    },
}
"""Keys that no result of the example has, and a type that some values of others have with other tables or options."""


def merged(contents: Sequence[dict[str, Any]], also: Mapping[str, str] | None = None) -> list[tuple[str, str]]:
    """Every key of several results and the types of its values in any of them, null first; ``also`` are more."""
    found: dict[str, set[str]] = {key: {kind} for key, kind in (also or {}).items()}
    for content in contents:
        for key, kind in _paths(content):
            found.setdefault(key, set()).add(kind)
    inner = {key for key in found if any(other.startswith((f"{key}.", f"{key}[]")) for other in found)}
    for key in inner:
        # The contents of a list or an object have separate lines.
        found[key] = {"null", "object"} if "null" in found[key] else set()
    for key in found.keys() - inner:
        # A value that is always null here is an unknown number.
        found[key] |= {"number"} if found[key] == {"null"} else set()
    return [
        (key, " or ".join(sorted(kinds, key=lambda kind: (kind != "null", kind))))
        for key, kinds in sorted(found.items())
        if kinds
    ]


def _paths(content: Any, above: str = "") -> Iterator[tuple[str, str]]:
    if isinstance(content, dict):
        if not content:
            yield above, "object"
        for key, value in content.items():
            own = "*" if above.split(".")[-1] in NAMED else key
            yield from _paths(value, f"{above}.{own}".lstrip("."))
    elif isinstance(content, list):
        if not content:
            yield above, "list"
        for value in content:
            yield from _paths(value, f"{above}[]")
    else:
        yield above, _TYPES[type(content)]


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of Markdown."""
    lines = [head, ["---"] * len(head), *([cell.replace("|", "\\|") for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    raise SystemExit(main())
