"""Messages to YAML and CSV as the real ros2 prints them, and YAML to messages. No ROS is started here.

rosidl_runtime_py, which the real ros2 uses, is not among the wheels. A message is known by its
``get_fields_and_field_types()`` alone.
"""

import array
import sys
from collections.abc import Mapping
from importlib import import_module
from typing import Any

import numpy as np
import yaml

from ros2cli_fallback.cover import Failure

_MORE = "..."


def interface(name: str, kind: str) -> Any:
    """The class of ``package/kind/Name`` or ``package/Name``, ``kind`` being ``msg`` or ``srv``.

    Raises Failure with the real ros2's words where there is none.
    """
    word = "message" if kind == "msg" else "service"
    parts = name.split("/")
    if len(parts) == 2:
        parts.insert(1, kind)
    if len(parts) != 3 or parts[1] != kind or not all(part.isidentifier() for part in parts):
        raise Failure(f"The passed {word} type is invalid")
    try:
        return getattr(import_module(f"{parts[0]}.{kind}"), parts[2])
    except (AttributeError, ModuleNotFoundError):
        raise Failure(f"The passed {word} type is invalid") from None


def is_message(value: Any) -> bool:
    """Whether ``value`` is a message (not one of its plain values)."""
    return hasattr(value, "get_fields_and_field_types")


def to_plain(value: Any, truncate: int | None = None, no_arr: bool = False, no_str: bool = False) -> Any:
    """A message, or a value in one, as plain values; what is longer than ``truncate`` is cut and ends in "..."."""
    if is_message(value):
        fields = value.get_fields_and_field_types()
        return {name: _field(getattr(value, name), kind, truncate, no_arr, no_str) for name, kind in fields.items()}
    if isinstance(value, bytes):
        value = "".join(map(chr, value))
        return value if truncate is None or len(value) <= truncate else value[:truncate] + _MORE
    if isinstance(value, str):
        if no_str:
            return f"<string length: <{len(value)}>>"
        return value if truncate is None or len(value) <= truncate else value[:truncate] + _MORE
    if isinstance(value, list | tuple | array.array | np.ndarray):
        items = [to_plain(one, truncate, no_arr, no_str) for one in value[:truncate]]
        return items if len(items) == len(value) else [*items, _MORE]
    return value.item() if isinstance(value, np.generic) else value


def to_yaml(message: Any, *, flow_style: bool = False, **options: Any) -> str:
    """The message as a YAML document (options as in ``to_plain``)."""
    return yaml.dump(
        to_plain(message, **options),
        allow_unicode=True,
        width=sys.maxsize,
        default_flow_style=flow_style,
        sort_keys=False,
    )


def to_csv(message: Any, **options: Any) -> str:
    """All values of the message, depth first, separated by commas (options as in ``to_plain``)."""
    return ",".join(str(value) for value in _leaves(to_plain(message, **options)))


def field(message: Any, path: str) -> Any:
    """What stands at a dotted path such as ``twist.twist.linear.x``; Failure if there is no such field."""
    value = message
    for name in path.split("."):
        if not is_message(value) or name not in value.get_fields_and_field_types():
            raise Failure(f"Invalid field '{path}': {type(value).__name__} has no field {name!r}")
        value = getattr(value, name)
    return value


def fill(message: Any, values: Any) -> Any:
    """Set the fields of a message from a mapping (parsed YAML) and return it; Failure names the field that won't."""
    if values is None:
        return message
    if not isinstance(values, Mapping):
        raise Failure(f"Failed to populate field: expected a mapping such as '{{data: true}}', got {values!r}")
    fields = message.get_fields_and_field_types()
    for name, value in values.items():
        if name not in fields:
            raise Failure(
                f"Failed to populate field: {type(message).__name__} has no field {name!r}; it has: {', '.join(fields)}"
            )
        now = getattr(message, name)
        if is_message(now):
            fill(now, value)
            continue
        # YAML writes 1 for 1.0; a float field must not refuse it.
        wanted = float(value) if isinstance(now, float) and type(value) is int else value
        if isinstance(now, bool | int | float | str) and type(wanted) is not type(now):
            raise Failure(f"Failed to populate field: {name}: {value!r} is not of type {type(now).__name__}")
        try:
            setattr(message, name, wanted)
        except (AssertionError, TypeError, ValueError) as error:
            raise Failure(f"Failed to populate field: {name}: {' '.join(str(error).split())}") from None
    return message


def _field(value: Any, kind: str, truncate: int | None, no_arr: bool, no_str: bool) -> Any:
    if no_arr and isinstance(value, list | tuple | array.array | np.ndarray):
        if kind.startswith("sequence<"):
            return f"<sequence type: {kind[len('sequence<') : -1]}, length: {len(value)}>"
        return f"<array type: {kind}>"
    return to_plain(value, truncate, no_arr, no_str)


def _leaves(value: Any) -> Any:
    if isinstance(value, dict):
        value = list(value.values())
    if not isinstance(value, list):
        yield value
        return
    for one in value:
        yield from _leaves(one)
