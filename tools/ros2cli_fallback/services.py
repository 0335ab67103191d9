"""``ros2 service``: list, type, call."""

import argparse
import os
import time
from collections.abc import Sequence

import yaml

from ros2cli_fallback import convert, graph
from ros2cli_fallback.cover import Failure, verbs_parser


def main(argv: Sequence[str]) -> int:
    """``service VERB ...``."""
    parser, verbs = verbs_parser("service")
    verb = verbs.add_parser("list", help="output a list of available services")
    verb.add_argument("-t", "--show-types", action="store_true", help="additionally show the service type")
    verb.add_argument("-c", "--count-services", action="store_true", help="only display the number of services")
    verb.add_argument("-a", "--include-hidden-services", action="store_true", help="hidden services as well")
    graph.add_arguments(verb)
    verb.set_defaults(run=listing)
    verb = verbs.add_parser("type", help="output a service's type")
    verb.add_argument("service_name")
    graph.add_arguments(verb)
    verb.set_defaults(run=type_)
    verb = verbs.add_parser("call", help="call a service")
    verb.add_argument("service_name", help="e.g. /bed/prepare")
    verb.add_argument("service_type", help="e.g. std_srvs/srv/Trigger")
    verb.add_argument("values", nargs="?", default="{}", help="the request in YAML, e.g. '{data: true}'")
    verb.add_argument("-r", "--rate", type=float, help="repeat at this rate [Hz]")
    verb.set_defaults(run=call)
    return parser.run(argv)


def listing(args: argparse.Namespace) -> int:
    """Names, with types where asked for."""
    with graph.node() as node:
        graph.settle(node, args.spin_time)
        services = graph.visible(node.get_service_names_and_types(), args.include_hidden_services)
    graph.print_names(services, args.count_services, args.show_types)
    return 0


def type_(args: argparse.Namespace) -> int:
    """The type alone; exit 1 where the service is unknown."""
    with graph.node() as node:
        types = graph.await_some(node, lambda: dict(node.get_service_names_and_types()).get(args.service_name))
    print(*(types or ()), sep="\n", end="\n" if types else "")
    return 0 if types else 1


def call(args: argparse.Namespace) -> int:
    """Call a service, once or at a rate, and print request and response."""
    if args.rate is not None and not args.rate > 0:
        raise Failure("rate must be greater than zero")
    kind = convert.interface(args.service_type, "srv")
    try:
        values = yaml.safe_load(args.values)
    except yaml.YAMLError as error:
        raise Failure(f"Failed to populate field: not YAML: {' '.join(str(error).split())}") from None
    # Messages of Jazzy check what is put into their lists only when told so.
    os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
    request = convert.fill(kind.Request(), values)
    with graph.node() as node:
        client = node.create_client(kind, args.service_name)
        if not client.service_is_ready():
            print("waiting for service to become available...")
            graph.await_some(node, lambda: True if client.service_is_ready() else None, float("inf"))
        while True:
            began = time.monotonic()
            print(f"requester: making request: {request!r}\n")
            response = graph.answer(node, client.call_async(request), args.service_name)
            print(f"response:\n{response!r}\n")
            if args.rate is None:
                return 0
            time.sleep(max(0.0, began + 1 / args.rate - time.monotonic()))
