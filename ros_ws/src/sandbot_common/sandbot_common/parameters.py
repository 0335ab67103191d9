"""Parameters declared once: a frozen dataclass whose fields carry unit, bounds and meaning.

    @dataclass(frozen=True)
    class Gait:
        theta_s_rad: float = parameter(1.1, unit="rad", doc="span of the slow phase", low=0.0, high=6.28)

``from_mapping`` builds one from YAML and refuses invalid values; sandbot_common.ros.ros_parameters declares the same
fields as ROS parameters.
"""

import dataclasses
import math
import sys
import types
import typing
from collections.abc import Mapping
from typing import Any, TypeVar

from sandbot_common.errors import InputError
from sandbot_common.suggest import did_you_mean
from sandbot_common.typed import WORDS

T = TypeVar("T")
_KEY = "sandbot"
LARGEST = sys.float_info.max
"""The bound for integers, too: a larger one can't be converted to float."""


@dataclasses.dataclass(frozen=True)
class Spec:
    """Everything about one parameter except its value."""

    name: str
    type: type
    unit: str
    doc: str
    low: float
    high: float
    choices: tuple[Any, ...]

    @property
    def described(self) -> str:
        """Meaning, unit and choices in a line."""
        unit = f" [{self.unit}]" if self.unit else ""
        choices = f"; one of {', '.join(map(str, self.choices))}" if self.choices else ""
        return f"{self.doc}{unit}{choices}"


def parameter(
    default: Any = dataclasses.MISSING,
    *,
    unit: str = "",
    doc: str,
    low: float = -math.inf,
    high: float = math.inf,
    choices: tuple[Any, ...] = (),
) -> Any:
    """A dataclass field with unit, inclusive bounds and meaning. Numbers must be finite."""
    metadata = {_KEY: {"unit": unit, "doc": doc, "low": low, "high": high, "choices": choices}}
    if isinstance(default, list | dict):
        return dataclasses.field(default_factory=lambda: type(default)(default), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def specs(cls: type) -> tuple[Spec, ...]:
    """The specs of a parameter dataclass, in order."""
    hints = typing.get_type_hints(cls)
    return tuple(
        Spec(name=field.name, type=hints[field.name], **field.metadata[_KEY])
        for field in dataclasses.fields(cls)
        if _KEY in field.metadata
    )


def _exact(limit: float) -> str:
    return f"{limit:d}" if isinstance(limit, int) else f"{limit:g}"


def usage(program: str, about: str, cls: type) -> str:
    """The ``--help`` text of a node: its command line, what it does, its parameters with range and default."""
    lines = [f"usage: {program} [--ros-args [-p NAME:=VALUE ...] [--params-file FILE.yaml]]", "", about.strip(), ""]
    default = cls()
    for spec in specs(cls):
        bounded = math.isfinite(spec.low) or math.isfinite(spec.high)
        limits = f", {_exact(spec.low)} to {_exact(spec.high)}" if bounded else ""
        lines += [f"  {spec.name}", f"      {spec.described}{limits} (default: {getattr(default, spec.name)!r})"]
    return "\n".join(lines)


def from_mapping(cls: type[T], mapping: Any, where: str) -> T:
    """Build ``cls`` from a mapping; ``where`` (file and section) opens every error line.

    Raises InputError on an unknown key, a wrong type, a missing value, NaN or a value out of bounds.
    """
    values = given(cls, mapping, where)
    required = {f.name: f for f in dataclasses.fields(cls) if _required(f)}  # type: ignore[arg-type]
    if missing := sorted(required.keys() - values.keys()):
        raise InputError(f"{where}: missing key {missing[0]!r} ({required[missing[0]].metadata[_KEY]['doc']})")
    try:
        return cls(**values)
    except InputError as error:  # values that contradict each other
        said = str(error).removeprefix(f"{where}: ").removeprefix(f"{where.rpartition(': ')[2]}: ")
        raise InputError(f"{where}: {said}") from None


def given(cls: type, mapping: Any, where: str) -> dict[str, Any]:
    """The values of a mapping in which any may be missing, checked as in ``from_mapping``. Raises InputError."""
    if not isinstance(mapping, Mapping):
        raise InputError(f"{where}: expected a mapping of parameters, got {mapping!r}")
    known = {spec.name: spec for spec in specs(cls)}
    for key in mapping:
        if key not in known:
            raise InputError(f"{where}: unknown key {key!r}{did_you_mean(str(key), known)}")
    return {key: check(known[key], value, where) for key, value in mapping.items()}


def check(spec: Spec, value: Any, where: str) -> Any:
    """The value, converted to the spec's type, a mapping to a dataclass; InputError if it does not fit."""
    wanted = typing.get_origin(spec.type) or spec.type
    if wanted is typing.Union or wanted is types.UnionType:
        options = typing.get_args(spec.type)
        if value is None and type(None) in options:
            return None
        inner = next(option for option in options if option is not type(None))
        return check(dataclasses.replace(spec, type=inner), value, where)
    if wanted in (list, tuple):
        if not isinstance(value, list | tuple):
            raise InputError(f"{where}: {spec.name}: {value!r} is not a list")
        item_types = typing.get_args(spec.type)
        item = dataclasses.replace(spec, type=item_types[0] if item_types else object)
        return wanted(check(item, element, where) for element in value)
    if wanted is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(_bounded(spec, value, where))
    if wanted is int and isinstance(value, int) and not isinstance(value, bool):
        return _bounded(spec, value, where)
    if wanted in (str, bool) and isinstance(value, wanted):
        return _chosen(spec, value, where)
    if dataclasses.is_dataclass(wanted):
        return from_mapping(wanted, value, f"{where}: {spec.name}")
    if wanted in (object, Any) or (wanted is dict and isinstance(value, Mapping)):
        return value
    raise InputError(f"{where}: {spec.name}: {value!r} is not {WORDS.get(wanted, wanted)}")


def _bounded(spec: Spec, value: float, where: str) -> Any:
    if not -LARGEST <= value <= LARGEST:
        raise InputError(f"{where}: {spec.name}: {value} is not a finite number ({spec.doc})")
    if not spec.low <= value <= spec.high:
        unit = f" {spec.unit}" if spec.unit else ""
        raise InputError(f"{where}: {spec.name}: {value} is outside [{spec.low:g}, {spec.high:g}]{unit} ({spec.doc})")
    return _chosen(spec, value, where)


def _chosen(spec: Spec, value: Any, where: str) -> Any:
    if spec.choices and value not in spec.choices:
        allowed = ", ".join(str(choice) or "'' (empty)" for choice in spec.choices)
        raise InputError(f"{where}: {spec.name}: {value!r} is not one of {allowed}")
    return value


def _required(field: dataclasses.Field[Any]) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
