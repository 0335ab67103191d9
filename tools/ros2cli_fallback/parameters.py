"""``ros2 param``: list, get, set, describe, dump."""

import argparse
import sys
from collections.abc import Iterable, Sequence
from typing import Any

import yaml
from rcl_interfaces.msg import Parameter, ParameterDescriptor, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.node import Node
from rclpy.parameter import get_parameter_value, parameter_value_to_python

from ros2cli_fallback import graph
from ros2cli_fallback.convert import to_plain
from ros2cli_fallback.cover import Failure, Parser, verbs_parser

_LABELS = {
    ParameterType.PARAMETER_BOOL: ("boolean", "Boolean value is:"),
    ParameterType.PARAMETER_INTEGER: ("integer", "Integer value is:"),
    ParameterType.PARAMETER_DOUBLE: ("double", "Double value is:"),
    ParameterType.PARAMETER_STRING: ("string", "String value is:"),
    ParameterType.PARAMETER_BYTE_ARRAY: ("byte array", "Byte values are:"),
    ParameterType.PARAMETER_BOOL_ARRAY: ("boolean array", "Boolean values are:"),
    ParameterType.PARAMETER_INTEGER_ARRAY: ("integer array", "Integer values are:"),
    ParameterType.PARAMETER_DOUBLE_ARRAY: ("double array", "Double values are:"),
    ParameterType.PARAMETER_STRING_ARRAY: ("string array", "String values are:"),
    ParameterType.PARAMETER_NOT_SET: ("not set", "Parameter not set."),
}


def main(argv: Sequence[str]) -> int:
    """``param VERB ...``."""
    return _parser().run(argv)


def listing(args: argparse.Namespace) -> int:
    """The parameters of one node, or of all that answer."""
    with graph.node() as node:
        if args.node_name:
            _print_names(node, graph.require_node(node, args.node_name), args, indent=False)
            return 0
        graph.settle(node, args.spin_time)
        services = dict(node.get_service_names_and_types())
        for name in graph.full_names(node, args.include_hidden_nodes):
            if f"{name}/list_parameters" in services:
                _print_names(node, name, args, indent=True)
    return 0


def get(args: argparse.Namespace) -> int:
    """One value with its type."""
    with graph.node() as node:
        (value,) = _values(node, graph.require_node(node, args.node_name), [args.parameter_name]) or (None,)
    if value is None:
        raise Failure("Parameter not set")
    if args.hide_type:
        print(parameter_value_to_python(value))
    else:
        print(*_labelled(value))
    return 0


def set_(args: argparse.Namespace) -> int:
    """Set one value or several; a refusal goes to stderr and, unlike with the real ros2, makes the exit code 1."""
    words = args.name_value
    if len(words) % 2:
        raise Failure(f"Parameters must be provided as name/value pairs: NAME VALUE [NAME VALUE ...], got {len(words)}")
    pairs = list(zip(words[::2], words[1::2], strict=True))
    wanted = [Parameter(name=name, value=get_parameter_value(string_value=value)) for name, value in pairs]
    with graph.node() as node:
        name = graph.require_node(node, args.node_name, args.timeout)
        response = graph.call(node, SetParameters, f"{name}/set_parameters", SetParameters.Request(parameters=wanted))
    refused = False
    for (parameter, _), result in zip(pairs, response.results, strict=True):
        outcome = "Set parameter successful" if result.successful else "Setting parameter failed"
        line = f"{outcome}: {result.reason}" if result.reason else outcome
        stream = sys.stdout if result.successful else sys.stderr
        print(f"{parameter}: {line}" if len(pairs) > 1 else line, file=stream)
        refused |= not result.successful
    return int(refused)


def describe(args: argparse.Namespace) -> int:
    """Type, meaning and bounds."""
    with graph.node() as node:
        for descriptor in _descriptors(node, graph.require_node(node, args.node_name), args.parameter_names):
            print(*_description(descriptor), sep="\n")
    return 0


def dump(args: argparse.Namespace) -> int:
    """All values as a parameter file that ``--params-file`` takes."""
    with graph.node() as node:
        name = graph.require_node(node, args.node_name)
        names = _names(node, name, ())
        values = [to_plain(parameter_value_to_python(value)) for value in _values(node, name, names)]
    content: dict[str, Any] = {}
    for parameter, value in zip(names, values, strict=True):
        *path, last = parameter.split(".")
        place = content
        for part in path:
            place = place.setdefault(part, {})
        place[last] = value
    print(yaml.safe_dump({name: {"ros__parameters": content}}, default_flow_style=False), end="")
    return 0


def _names(node: Node, name: str, prefixes: Iterable[str]) -> list[str]:
    request = ListParameters.Request(prefixes=list(prefixes))
    return sorted(graph.call(node, ListParameters, f"{name}/list_parameters", request).result.names)


def _values(node: Node, name: str, parameters: list[str]) -> list[ParameterValue]:
    request = GetParameters.Request(names=parameters)
    return list(graph.call(node, GetParameters, f"{name}/get_parameters", request).values)


def _descriptors(node: Node, name: str, parameters: list[str]) -> list[ParameterDescriptor]:
    request = DescribeParameters.Request(names=parameters)
    return list(graph.call(node, DescribeParameters, f"{name}/describe_parameters", request).descriptors)


def _print_names(node: Node, name: str, args: argparse.Namespace, *, indent: bool) -> None:
    if indent:
        print(f"{name}:")
    names = _names(node, name, args.param_prefixes)
    types = [f" (type: {_LABELS[one.type][0]})" for one in _descriptors(node, name, names)] if args.param_type else []
    for index, parameter in enumerate(names):
        print(f"  {parameter}{types[index] if types else ''}")


def _labelled(value: ParameterValue) -> tuple[Any, ...]:
    label = _LABELS[value.type][1]
    return (label,) if value.type == ParameterType.PARAMETER_NOT_SET else (label, parameter_value_to_python(value))


def _description(descriptor: ParameterDescriptor) -> list[str]:
    lines = [f"Parameter name: {descriptor.name}", f"  Type: {_LABELS[descriptor.type][0]}"]
    if descriptor.description:
        lines.append(f"  Description: {descriptor.description}")
    lines.append("  Constraints:")
    if descriptor.read_only:
        lines.append("    Read only: true")
    for bounds in [*descriptor.floating_point_range, *descriptor.integer_range][:1]:
        lines += [f"    Min value: {bounds.from_value}", f"    Max value: {bounds.to_value}"]
        if bounds.step:
            lines.append(f"    Step: {bounds.step}")
    if descriptor.additional_constraints:
        lines.append(f"    Additional constraints: {descriptor.additional_constraints}")
    return lines


def _parser() -> Parser:
    parser, verbs = verbs_parser("param")
    for name, run in (("list", listing), ("get", get), ("set", set_), ("describe", describe), ("dump", dump)):
        verb = verbs.add_parser(name, help=run.__doc__)
        verb.add_argument("node_name", nargs="?" if name == "list" else None)
        verb.add_argument("--include-hidden-nodes", action="store_true", help="hidden nodes as well")
        graph.add_arguments(verb)
        verb.set_defaults(run=run)
    choices = verbs.choices
    choices["list"].add_argument("--param-prefixes", nargs="+", default=[], help="only those with these prefixes")
    choices["list"].add_argument("--param-type", action="store_true", help="print types with names")
    choices["get"].add_argument("parameter_name")
    choices["get"].add_argument("--hide-type", action="store_true", help="the value alone")
    choices["set"].add_argument("name_value", nargs="+", metavar="NAME VALUE")
    choices["set"].add_argument("--timeout", type=float, default=graph.PATIENCE_S, help="patience for the node [s]")
    choices["describe"].add_argument("parameter_names", nargs="+")
    return parser
