"""The user's selection in the explorer: base model, effects, formulas, parameters held by hand, and the current view.

It is plain data that is written to the page's address and to a YAML file, and read back unchanged. The YAML also holds
the ``compare`` command line that gives the same numbers.
"""

import dataclasses
import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlencode

import yaml

from sandbot_common.errors import InputError
from sandbot_common.yaml_text import read_yaml
from sandbot_model.physics.observables import NAMES
from sandbot_model.physics.walking import BASES

SCHEMA = "sandbot.selection/1"
KEYS = ("model", "view", "observable", "effect", "formula", "hold", "cell", "against")
"""Keys of a query."""
BASE_QUERY = "?model=simple"
"""The query of the default selection."""
VIEWS = ("speed", "residuals", "critical", "step", "balance", "lock", "parameters")


MAX_DIGITS = 9
"""Limit on the number of a cell: Python refuses to parse thousands of digits."""


@dataclass(frozen=True)
class Condition:
    """The condition of a cell, by which an address names it even after more has been measured."""

    phi: float
    omega_rad_s: float
    gait: str


@dataclass(frozen=True)
class Selection:
    """One state of the explorer; ``effects`` are in the order in which they were switched on (that of the ladder)."""

    model: str = "simple"
    effects: tuple[str, ...] = ()
    formulas: tuple[str, ...] = ()
    """Effects given as a line of text (see ``formula``), switched on or not."""
    by_hand: tuple[tuple[str, float], ...] = ()
    """Shared parameters held at a value instead of the fitted one."""
    view: str = "speed"
    observable: str = "speed"
    cell: Condition | int | None = None
    """The condition whose trials are shown; in old addresses the index of its cell."""
    against: str = ""
    """The query of a model shown beside this one, as made by ``pin``."""

    @property
    def other(self) -> "Selection | None":
        """The selection shown beside this one; None if there is none."""
        if not self.against:
            return None
        pinned = from_query(self.against)
        return dataclasses.replace(
            pinned, formulas=tuple(dict.fromkeys((*pinned.formulas, *self.formulas))), view=self.view,
            observable=self.observable, cell=self.cell,
        )  # fmt: skip

    def pin(self) -> "Selection":
        """This view with the current model shown beside it."""
        plain = dataclasses.replace(self, view="speed", observable="speed", cell=None, against="")
        return dataclasses.replace(self, against=to_query(plain) or BASE_QUERY)

    def toggled(self, wanted: Sequence[str]) -> "Selection":
        """A copy with exactly the effects in ``wanted``: those already on keep their place, new ones come last."""
        kept = [name for name in self.effects if name in wanted]
        new = [name for name in wanted if name not in self.effects]
        effects = (*kept, *new)
        by_hand = tuple((n, v) for n, v in self.by_hand if "." not in n or n.split(".")[0] in effects)
        return dataclasses.replace(self, effects=effects, by_hand=by_hand)

    def held(self, name: str, value: float | None) -> "Selection":
        """A copy with one parameter held at ``value``, or fitted if that is None."""
        others = tuple((n, v) for n, v in self.by_hand if n != name)
        return dataclasses.replace(self, by_hand=others if value is None else (*others, (name, float(value))))


def with_formula(selection: Selection, text: str) -> Selection:
    """A copy with a formula added and switched on; one of the same name is replaced. Raises InputError if invalid."""
    # Imported here to keep the evaluation of formulas out of command-line parsing.
    from sandbot_model.physics.formula import formula_effect

    name = formula_effect(text).identifier
    others = tuple(formula for formula in selection.formulas if name_of(formula) != name)
    kept = selection.toggled([effect for effect in selection.effects if effect != name])
    return dataclasses.replace(kept, formulas=(*others, text), effects=(*kept.effects, name))


def name_of(formula: str) -> str:
    """The name a formula begins with."""
    return formula.split(":")[0].strip()


def to_query(selection: Selection) -> str:
    """The selection as a query string; defaults are omitted."""
    default = Selection()
    pairs: list[tuple[str, str]] = []
    for name in ("model", "view", "observable"):
        if getattr(selection, name) != getattr(default, name):
            pairs.append((name, getattr(selection, name)))
    pairs += [("effect", name) for name in selection.effects]
    pairs += [("formula", text) for text in selection.formulas]
    pairs += [("hold", f"{name}={value!r}") for name, value in selection.by_hand]
    if selection.cell is not None:
        pairs.append(("cell", cell_text(selection.cell)))
    if selection.against:
        pairs.append(("against", selection.against))
    return f"?{urlencode(pairs, safe=',')}" if pairs else ""


def from_query(query: str, *, nested: bool = False) -> Selection:
    """The selection in a query string; ``nested`` if that is itself the value of ``against``.

    Raises InputError for unknown keys and values; effects are checked when they are fitted.
    """
    found = Selection()
    for key, value in parse_qsl(query.lstrip("?"), keep_blank_values=True):
        match key:
            case "model" | "view" | "observable":
                found = dataclasses.replace(found, **{str(key): value})  # type: ignore[arg-type]
            case "effect" if value not in found.effects:
                found = dataclasses.replace(found, effects=(*found.effects, value))
            case "formula" if value not in found.formulas:
                found = dataclasses.replace(found, formulas=(*found.formulas, value))
            case "hold":
                found = held_by_text(found, value, "address: hold")
            case "cell":
                found = dataclasses.replace(found, cell=cell_of_text(value))
            case "against":
                if nested:
                    raise InputError("address: against: a model beside a model beside this one; there is room for one")
                from_query(value, nested=True)
                found = dataclasses.replace(found, against=value)
            case "effect" | "formula":
                pass
            case _:
                raise InputError(f"address: unknown key {key!r}; known: {', '.join(KEYS)}")
    return _checked(found, "address")


def cell_text(cell: Condition | int) -> str:
    """A condition as ``φ,ω,gait``, such as ``0.59,20,UNIFORM``; the index of a cell as it is."""
    if isinstance(cell, int):
        return str(cell)
    return f"{_shortest(cell.phi)},{_shortest(cell.omega_rad_s)},{cell.gait}"


def cell_of_text(text: str) -> Condition | int:
    """The inverse of ``cell_text``. Raises InputError for any other text."""
    if "," not in text:
        return _index(text)
    where = f"address: cell={_shortened(text)!r}: φ,ω,gait or a whole number is needed"
    phi, omega, *gait = text.split(",", 2)
    if not gait:
        raise InputError(where)
    return Condition(_finite(phi, where), _finite(omega, where), gait[0])


def held_by_text(selection: Selection, text: str, where: str) -> Selection:
    """A copy with the parameter of ``name=value`` held. Raises InputError for any other text."""
    name, _, number = text.partition("=")
    return selection.held(name, _finite(number, f"{where} {text!r}"))


def to_yaml(selection: Selection, data: Sequence[str], result: Mapping[str, float], options: Sequence[str] = ()) -> str:
    """The selection as YAML, with the command that reproduces it and its results (SI).

    ``options`` are further arguments of the command, such as files read in addition to the data.
    """
    command = ["compare", *data, *options, "--model", selection.model]
    command += ["--effects", ",".join(selection.effects)] if selection.effects else []
    for text in selection.formulas:
        # ``--effect`` switches a formula on, so those that are off are omitted.
        command += ["--effect", text] if name_of(text) in selection.effects else []
    for name, value in selection.by_hand:
        command += ["--hold", f"{name}={value!r}"]
    content = {
        "schema": SCHEMA,
        "command": shlex.join(command),
        "model": selection.model,
        "effects": list(selection.effects),
        "formulas": list(selection.formulas),
        "by_hand": dict(selection.by_hand),
        "result": {name: float(value) if math.isfinite(value) else None for name, value in result.items()},
    }
    # Escaped, since YAML reads a raw Unicode line separator back as a space.
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=False, width=1000)


def from_mapping(content: Mapping[str, Any], where: str) -> Selection:
    """The selection in the mapping of a saved YAML file. Raises InputError (file, key, what is expected)."""
    if content.get("schema") != SCHEMA:
        raise InputError(f"{where}: schema is {content.get('schema')!r}, expected {SCHEMA!r}")
    unknown = set(content) - {"schema", "command", "model", "effects", "formulas", "by_hand", "result"}
    if unknown:
        raise InputError(f"{where}: unknown key {min(unknown, key=str)!r}")
    effects, formulas = (_texts(content.get(key, []), f"{where}: {key}") for key in ("effects", "formulas"))
    found = Selection(str(content.get("model", "simple")), effects, formulas)
    by_hand = content.get("by_hand", {})
    if not isinstance(by_hand, Mapping):
        raise InputError(f"{where}: by_hand: expected parameter: value, got {by_hand!r}")
    for name, value in by_hand.items():
        found = found.held(str(name), _finite(value, f"{where}: by_hand: {name}"))
    return _checked(found, where)


def read_selection(path: Path) -> Selection:
    """The selection in a saved YAML file, with its formulas checked. Raises InputError."""
    # Imported here, as above.
    from sandbot_model.physics.formula import formula_effect

    found = from_mapping(read_yaml(path), str(path))
    for text in found.formulas:
        try:
            formula_effect(text)
        except InputError as error:
            raise InputError(f"{path}: formulas: {str(error).removeprefix('--effect ')}") from None
    return found


def _checked(selection: Selection, where: str) -> Selection:
    allowed = (("model", tuple(BASES)), ("view", VIEWS), ("observable", NAMES))
    for name, known in allowed:
        value = getattr(selection, name)
        if value not in known:
            raise InputError(f"{where}: {name} {value!r} is not one of {', '.join(known)}")
    return selection


def _finite(value: Any, where: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{where}: a finite number is needed")
    return number


def _index(value: str) -> int:
    if not value.isdecimal() or len(value) > MAX_DIGITS:
        raise InputError(
            f"address: cell={_shortened(value)!r}: φ,ω,gait or a whole number is needed, of at most {MAX_DIGITS} digits"
        )
    return int(value)


def _shortened(text: str) -> str:
    """A text cut to a length that fits into a message."""
    return text if len(text) <= 40 else f"{text[:40]}…"


def _shortest(number: float) -> str:
    """The shortest text that parses to the same number."""
    return repr(number).removesuffix(".0")


def _texts(value: Any, where: str) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
        raise InputError(f"{where}: expected a list of texts, got {value!r}")
    return tuple(dict.fromkeys(value))
