"""YAML in and out: duplicate keys are errors, and every error is one line that says where."""

from collections.abc import Callable, Iterable
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml

from sandbot_common.errors import InputError
from sandbot_common.files import read_text


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Uses libyaml where available, which is ten times as fast as the Python loader. A duplicate key is an error, as
    the YAML standard says; PyYAML silently takes the last.
    """

    def flatten_mapping(self, node: Any) -> None:
        # Checked once, before `<<` merges in keys that the mapping's own may override.
        if not hasattr(node, "checked"):
            node.checked = True
            _refuse_duplicates(key for key, _ in node.value if isinstance(key, yaml.ScalarNode))
        super().flatten_mapping(node)


def _refuse_duplicates(keys: Iterable[yaml.ScalarNode]) -> None:
    seen: set[tuple[str, str]] = set()
    for key in keys:
        if (key.tag, key.value) in seen:
            raise yaml.YAMLError(f"line {key.start_mark.line + 1}: key {key.value!r} is there twice")
        seen.add((key.tag, key.value))


def load_yaml(text: str) -> Any:
    """The content of a YAML text."""
    return yaml.load(text, Loader=_Loader)


@lru_cache(maxsize=16)
def shared_yaml(text: str) -> Any:
    """A cached ``load_yaml`` for a text that many bags carry; do not modify the result."""
    return load_yaml(text)


def dump_yaml(content: Any) -> str:
    """YAML text in the order of the mapping's keys, by libyaml where available."""
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    return str(yaml.dump(content, Dumper=dumper, sort_keys=False, allow_unicode=True))


def parse_yaml(text: str, where: str, load: Callable[[str], Any] = load_yaml) -> Any:
    """The content of a YAML text; ``where`` opens the error."""
    try:
        return load(text)
    except yaml.YAMLError as error:
        raise InputError(f"{where}: not YAML: {_yaml_trouble(error, text)}") from None
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        # Raised by PyYAML if a scalar does not match its tag or form: month 13, an empty !!int.
        raise InputError(f"{where}: not YAML: {type(error).__name__}: {' '.join(str(error).split())}") from None


def _yaml_trouble(error: yaml.YAMLError, text: str) -> str:
    """What PyYAML says, opened by the line and not by its own name for the text."""
    if not (isinstance(error, yaml.MarkedYAMLError) and (mark := error.problem_mark)):
        return " ".join(str(error).split())
    is_tab = text[mark.index : mark.index + 1] == "\t"
    problem = "a tab; indent by spaces" if is_tab else ": ".join(filter(None, (error.context, error.problem)))
    return f"line {mark.line + 1}, column {mark.column + 1}: {' '.join(problem.split())}"


def read_yaml(path: Path) -> dict[str, Any]:
    """The mapping in a YAML file."""
    content = parse_yaml(read_text(path, "a YAML file"), str(path))
    if not isinstance(content, dict):
        empty = "is empty; " if content is None else ""
        raise InputError(f"{path}: {empty}lines 'key: value' are needed")
    return content
