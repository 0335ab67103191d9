"""``ros2 node``: list, info."""

import argparse
from collections.abc import Sequence

from rclpy.node import Node

from ros2cli_fallback import graph
from ros2cli_fallback.cover import Failure, verbs_parser


def main(argv: Sequence[str]) -> int:
    """``node VERB ...``."""
    parser, verbs = verbs_parser("node")
    verb = verbs.add_parser("list", help="output a list of available nodes")
    verb.add_argument("-a", "--all", action="store_true", help="hidden nodes as well")
    verb.add_argument("-c", "--count-nodes", action="store_true", help="only display the number of nodes")
    graph.add_arguments(verb)
    verb.set_defaults(run=listing)
    verb = verbs.add_parser("info", help="output information about a node")
    verb.add_argument("node_name", help="fully qualified node name")
    verb.add_argument("--include-hidden", action="store_true", help="hidden topics and services as well")
    graph.add_arguments(verb)
    verb.set_defaults(run=info)
    return parser.run(argv)


def listing(args: argparse.Namespace) -> int:
    """The fully qualified names."""
    with graph.node() as node:
        graph.settle(node, args.spin_time)
        names = graph.full_names(node, args.all)
    if args.count_nodes:
        print(len(names))
    elif names:
        print(*names, sep="\n")
    return 0


def info(args: argparse.Namespace) -> int:
    """What a node publishes, subscribes, serves and calls."""
    with graph.node() as node:
        try:
            wanted = graph.require_node(node, args.node_name)
        except Failure:
            raise Failure(f"Unable to find node '{args.node_name}'") from None
        graph.settle(node, args.spin_time)
        print(wanted)
        _endpoints(node, wanted, args.include_hidden)
    return 0


def _endpoints(node: Node, wanted: str, include_hidden: bool) -> None:
    space, _, name = wanted.rpartition("/")
    ask = {
        "Subscribers": node.get_subscriber_names_and_types_by_node,
        "Publishers": node.get_publisher_names_and_types_by_node,
        "Service Servers": node.get_service_names_and_types_by_node,
        "Service Clients": node.get_client_names_and_types_by_node,
    }
    for title, names_and_types in ask.items():
        found = graph.visible(names_and_types(name, space or "/"), include_hidden)
        print(f"  {title}:", *(f"    {one}: {', '.join(types)}" for one, types in found), sep="\n")
    # No node of the trackway has actions; the titles are there for those who parse the output.
    print("  Action Servers:\n\n  Action Clients:\n")
