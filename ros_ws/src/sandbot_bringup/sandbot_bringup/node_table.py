"""The node table: which processes make up the trackway, with which parameters, and when each is wanted.

config/nodes.yaml is the single source; ``launch/trackway.launch.py`` (a full ROS 2) and the fallback ``ros2 launch`` of
a host without one both start what ``selected`` returns.
"""

import dataclasses
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import yaml

from sandbot_common import cli
from sandbot_common.config import config_file
from sandbot_common.errors import InputError
from sandbot_common.parameters import from_mapping, parameter, specs
from sandbot_common.typed import WORDS
from sandbot_common.yaml_text import read_yaml

PACKAGE = "sandbot_bringup"
LAUNCH_FILE = "trackway.launch.py"
CONFIG = "config"
"""``${config}`` is the folder of the node table."""

NAMESPACE = "namespace"
"""The launch argument that puts every node, topic and service into a ROS namespace."""

LAB = "lab"
"""The launch argument that chooses between the virtual lab (true) and the hardware (false)."""

_TRUE, _FALSE = "true", "false"
_SPACE = re.compile(r"(/?[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*)?")
_REFERENCE = re.compile(r"\$\{(\w+)\}")


@dataclass(frozen=True)
class LaunchArgument:
    """A ``name:=value`` of the launch file, of the same type as its default ("0" is text, 0 a number)."""

    default: Any = parameter(doc="value if none is given: text, number, true or false")
    doc: str = parameter(doc="what it does")
    choices: tuple[str, ...] = parameter((), doc="allowed values; empty: any")
    name: str = ""

    @property
    def default_text(self) -> str:
        """The default as it would be typed."""
        return self.default if isinstance(self.default, str) else _flow(self.default)


@dataclass(frozen=True)
class NodeEntry:
    """One process of the trackway."""

    package: str = parameter(doc="ROS package")
    executable: str = parameter(doc="executable of the package")
    name: str = parameter(doc="node name")
    wanted: str = parameter(
        "both", doc="with the virtual lab, with the hardware, or both", choices=("lab", "hardware", "both")
    )
    only_if: str = parameter("", doc="launch argument that must be true as well, or `name=choice`; empty: none")
    required: bool = parameter(True, doc="everything stops when this process ends")
    parameters: dict[str, Any] = parameter({}, doc="ROS parameters; ${argument} is replaced by its value")
    settings: str = parameter(
        "", doc="module:class of its parameters, against which given ones are checked; empty: by the node"
    )
    namespace: str = parameter("", doc="ROS namespace; empty: that of the launch argument `namespace`, or none")

    def ros_arguments(self) -> list[str]:
        """The command line that gives a node its name and parameters."""
        arguments = ["--ros-args", "-r", f"__node:={self.name}"]
        if self.namespace:
            arguments += ["-r", f"__ns:={self.namespace}"]
        for key, value in self.parameters.items():
            arguments += ["-p", f"{key}:={_flow(value)}"]
        return arguments


@dataclass(frozen=True)
class NodeTable:
    """The launch arguments and the nodes, checked against each other."""

    where: str
    arguments: Mapping[str, LaunchArgument]
    nodes: tuple[NodeEntry, ...]


def table_path() -> Path:
    """Path of the installed node table."""
    return config_file("nodes.yaml")


def read_table(path: Path) -> NodeTable:
    """The node table in a YAML file. Raises InputError with file, entry and value."""
    content = read_yaml(path)
    for key in content:
        if key not in ("arguments", "nodes"):
            raise InputError(f"{path}: unknown key {key!r}; known: arguments, nodes")
    arguments = _arguments(content.get("arguments", {}), path)
    entries = content.get("nodes")
    if not isinstance(entries, list) or not entries:
        raise InputError(f"{path}: nodes: expected a list of nodes, got {entries!r}")
    nodes = tuple(from_mapping(NodeEntry, entry, f"{path}: nodes[{index}]") for index, entry in enumerate(entries))
    seen: set[str] = set()
    for index, node in enumerate(nodes):
        where = f"{path}: nodes[{index}]"
        if node.name in seen:
            raise InputError(f"{where}: name: {node.name!r} is taken by another node of the table")
        seen.add(node.name)
        _check_node(node, arguments, where)
    return NodeTable(str(path), arguments, nodes)


def parse_arguments(words: Sequence[str]) -> dict[str, str]:
    """``name:=value`` words as a mapping. Raises InputError for any other word."""
    given: dict[str, str] = {}
    for word in words:
        name, separator, value = word.partition(":=")
        if not separator or not name:
            raise InputError(f"malformed launch argument {word!r}, expected format '<name>:=<value>'")
        given[name] = value
    return given


def selected(table: NodeTable, given: Mapping[str, str]) -> tuple[NodeEntry, ...]:
    """The nodes wanted under these launch arguments, with their parameters.

    A name is a launch argument of the table or ``node.parameter``, which sets one parameter of one node. Raises
    InputError for an unknown name, a parameter that the node does not have, an invalid value, or an argument that none
    of these nodes uses.
    """
    values: dict[str, Any] = {CONFIG: str(Path(table.where).parent)}
    values |= {name: argument.default for name, argument in table.arguments.items()}
    own: dict[str, dict[str, str]] = {node.name: {} for node in table.nodes}
    for name, value in given.items():
        node, _, key = name.partition(".")
        if key and node in own:
            own[node][key] = value
        else:
            values[name] = _chosen(table, name, value)
    nodes = {node.name: {**node.parameters, **_checked(node, own[node.name])} for node in table.nodes}
    space = _namespace(values.get(NAMESPACE, ""))
    for name, value in given.items():
        # The real launch passes every argument, those not typed with their defaults.
        if name not in table.arguments or value != table.arguments[name].default_text:
            _check_used(table, name, values)
    return tuple(
        dataclasses.replace(
            entry,
            namespace=entry.namespace or space,
            parameters={k: _substituted(v, values) for k, v in nodes[entry.name].items()},
        )
        for entry in table.nodes
        if not _missing(entry, values)
    )


def _check_used(table: NodeTable, name: str, values: Mapping[str, Any]) -> None:
    """Raise InputError, naming the missing switches, if no started node uses a given argument."""
    missing = [_missing(entry, values, name) for entry in table.nodes if _uses(entry, name)]
    if missing and all(missing):
        raise InputError(f"launch argument {name}: no started node uses it; it needs {' '.join(missing[0])}")


def _uses(entry: NodeEntry, name: str) -> bool:
    """Whether a launch argument is for a node: one of its parameters, referenced by one, or the node's switch."""
    referenced = {found for value in entry.parameters.values() for found in _REFERENCE.findall(str(value))}
    return name in referenced or name.startswith(f"{entry.name}.") or name == _switch(entry)[0]


def _missing(entry: NodeEntry, values: Mapping[str, Any], except_for: str = "") -> list[str]:
    """The ``name:=value`` switches that would have to be given to start a node; empty if it is started."""
    lab = {"lab": _TRUE, "hardware": _FALSE}
    wanted = [(LAB, lab[entry.wanted])] if entry.wanted in lab else []
    switch = [_switch(entry)] if entry.only_if else []
    return [f"{name}:={value}" for name, value in wanted + switch if name != except_for and values[name] != value]


def _switch(entry: NodeEntry) -> tuple[str, str]:
    """The launch argument that starts a node, and the value it needs."""
    name, _, choice = entry.only_if.partition("=")
    return name, choice or _TRUE


def _chosen(table: NodeTable, name: str, value: str) -> Any:
    if name not in table.arguments:
        known = ", ".join(table.arguments)
        raise InputError(f"unknown launch argument {name!r}; known: {known}, and node.parameter for every node's own")
    argument = table.arguments[name]
    if argument.choices and value not in argument.choices:
        raise InputError(f"launch argument {name}: {value!r} is not one of {', '.join(argument.choices)}")
    if isinstance(argument.default, str):
        return value
    wanted, given = type(argument.default), _plain(value)
    if type(given) is not wanted and not (wanted is float and type(given) is int):
        raise InputError(f"launch argument {name}: {value!r} is not {WORDS[wanted]}")
    return wanted(given)


def _checked(node: NodeEntry, given: Mapping[str, str]) -> dict[str, Any]:
    """The parameters given to a node, converted to the types that it declares."""
    plain = {name: _plain(text) for name, text in given.items()}
    if not node.settings or not given:
        return plain
    module, _, name = node.settings.partition(":")
    cls = getattr(import_module(module), name)
    text = {spec.name for spec in specs(cls) if spec.type is str}
    ours = {key: given[key] if key in text else plain[key] for key in plain if not key.startswith(cli.OF_EVERY_NODE)}
    made = from_mapping(cls, ours, f"launch arguments of {node.name}")
    return plain | {key: getattr(made, key) for key in ours}


def _namespace(text: str) -> str:
    """A namespace with its leading slash; empty if there is none."""
    if not _SPACE.fullmatch(text):
        raise InputError(f"launch argument {NAMESPACE}: {text!r} is not a ROS namespace such as robot1")
    return text and "/" + text.removeprefix("/")


def _arguments(content: Any, path: Path) -> dict[str, LaunchArgument]:
    if not isinstance(content, Mapping):
        raise InputError(f"{path}: arguments: expected a mapping of launch arguments, got {content!r}")
    arguments = {}
    for name, given in content.items():
        where = f"{path}: arguments: {name}"
        argument = dataclasses.replace(from_mapping(LaunchArgument, given, where), name=name)
        if not isinstance(argument.default, bool | int | float | str):
            raise InputError(f"{where}: default: {argument.default!r} is not text, a number, true or false")
        if argument.choices and argument.default not in argument.choices:
            raise InputError(f"{where}: default: {argument.default!r} is not one of {', '.join(argument.choices)}")
        arguments[name] = argument
    if LAB not in arguments or not _is_switch(arguments[LAB]):
        raise InputError(f"{path}: arguments: {LAB!r} with the choices true and false is needed")
    return arguments


def _check_node(node: NodeEntry, arguments: Mapping[str, LaunchArgument], where: str) -> None:
    name, choice = _switch(node)
    if name and (name not in arguments or choice not in arguments[name].choices):
        raise InputError(f"{where}: only_if: {node.only_if!r} is not a launch argument with the choice {choice}")
    for key, value in node.parameters.items():
        if not isinstance(key, str):
            raise InputError(f"{where}: parameters: {key!r} is not a name")
        items = value if isinstance(value, list) else [value]
        if not all(isinstance(item, bool | int | float | str) for item in items):
            raise InputError(
                f"{where}: parameters: {key}: {value!r} is not a number, text, true, false or a list of them"
            )
        for name in _REFERENCE.findall(value) if isinstance(value, str) else ():
            if name not in arguments and name != CONFIG:
                raise InputError(f"{where}: parameters: {key}: {value!r}: no launch argument {name!r}")


def _is_switch(argument: LaunchArgument) -> bool:
    return set(argument.choices) == {_TRUE, _FALSE}


def _substituted(value: Any, values: Mapping[str, Any]) -> Any:
    if not isinstance(value, str):
        return value
    whole = _REFERENCE.fullmatch(value)
    result = values[whole[1]] if whole else _REFERENCE.sub(lambda found: str(values[found[1]]), value)
    # A launch argument's own value may refer to the folder of the table.
    return result.replace(f"${{{CONFIG}}}", values[CONFIG]) if isinstance(result, str) else result


def _plain(text: str) -> Any:
    """The text as launch parses it: 7 is a number, true a boolean, [1, 2] a list, everything else stays text."""
    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError:
        return text
    return value if isinstance(value, bool | int | float | list) else text


def _flow(value: Any) -> str:
    """One line of YAML; text is quoted, so that "1" stays text."""
    text = isinstance(value, str) or (isinstance(value, list) and any(isinstance(item, str) for item in value))
    line = yaml.safe_dump(value, default_flow_style=True, default_style='"' if text else None, width=10**6)
    # PyYAML ends a bare value with an end-of-document mark.
    return line.removesuffix("\n").removesuffix("\n...")
