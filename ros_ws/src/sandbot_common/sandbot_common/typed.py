"""Run-time checks of types: of arguments of the Python API, whose users may run no type checker, and of what other
programs send.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from numbers import Integral, Real
from textwrap import shorten
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin

from sandbot_common.errors import InputError

_NUMBERS: dict[object, type] = {int: Integral, float: Real}
WORDS = {NoneType: "None", Callable: "a function", int: "a whole number", float: "a number", str: "a string"}
WORDS |= {bool: "true or false", dict: "a mapping"}
"""What a value of each type is called in a message."""
_LONGEST = 60
"""The most characters of a value in a message."""


def number_or_nan(said: object) -> float:
    """What another program says is a number, such as a value of /diagnostics; NaN if it is none."""
    try:
        return float(str(said))
    except ValueError:
        return math.nan


def check_types(function: Callable[..., Any], given: Mapping[str, Any]) -> None:
    """Raises InputError for the first argument that does not match its annotation; quoted annotations are skipped."""
    for name, kind in function.__annotations__.items():
        if name in given and not isinstance(kind, str) and not is_a(given[name], kind):
            value = given[name]
            if isinstance(value, str) and _origin(kind) is Sequence:
                raise InputError(f"{name}: {value!r} is one string; a list is needed, [{value!r}]")
            raise InputError(f"{name}: {shorten(repr(value), _LONGEST)}; {_words(kind)} is needed")


def is_a(value: Any, kind: Any) -> bool:
    """Whether a value matches an annotation. True is no number; any collection but a string counts as a list."""
    origin, of = _origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return any(is_a(value, option) for option in of)
    if origin is Sequence:
        several = isinstance(value, Collection) and not isinstance(value, str | bytes | Mapping)
        return several and all(is_a(item, of[0]) for item in value)
    if origin is Mapping:
        return isinstance(value, Mapping) and all(is_a(item, of[1]) for item in value.values())
    if origin in _NUMBERS:
        return isinstance(value, _NUMBERS[origin]) and not isinstance(value, bool)
    return isinstance(value, origin)


def _words(kind: Any) -> str:
    origin, of = _origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return f"{', '.join(map(_words, of[:-1]))} or {_words(of[-1])}"
    if origin is Sequence:
        return f"a list ({_words(of[0])} each)"
    if origin is Mapping:
        return f"a mapping to {_words(of[1])}"
    return WORDS.get(origin) or str(origin.__name__)


def _origin(kind: Any) -> Any:
    """``Sequence`` for ``Sequence[str]``; a plain class itself."""
    return get_origin(kind) or kind
