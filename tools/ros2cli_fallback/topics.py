"""``ros2 topic``: list, echo, hz, info, type."""

import argparse
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data

from ros2cli_fallback import convert, graph
from ros2cli_fallback.cover import Failure, Parser, verbs_parser
from ros2cli_fallback.rate import Rate

TRUNCATE_LENGTH = 128
WINDOW = 10000
# Deep enough that 1 kHz topics are counted whole while a figure is being printed.
HZ_DEPTH = 2000


def main(argv: Sequence[str]) -> int:
    """``topic VERB ...``."""
    return _parser().run(argv)


def listing(args: argparse.Namespace) -> int:
    """Names, with types where asked for."""
    with graph.node() as node:
        graph.settle(node, args.spin_time)
        topics = graph.visible(node.get_topic_names_and_types(), args.include_hidden_topics)
    graph.print_names(topics, args.count_topics, args.show_types)
    return 0


def info(args: argparse.Namespace) -> int:
    """Type and how many publish and subscribe."""
    with graph.node() as node:
        types = graph.await_some(node, lambda: _types(node, args.topic_name))
        if types is None:
            raise Failure(f"Unknown topic '{args.topic_name}'")
        # The first endpoint to be seen need not be the last.
        graph.settle(node, args.spin_time)
        print(f"Type: {types[0] if len(types) == 1 else types}")
        print(f"Publisher count: {node.count_publishers(args.topic_name)}")
        print(f"Subscription count: {node.count_subscribers(args.topic_name)}")
    return 0


def type_(args: argparse.Namespace) -> int:
    """The type alone; exit 1 where the topic is unknown."""
    with graph.node() as node:
        types = graph.await_some(node, lambda: _types(node, args.topic_name))
    print(*(types or ()), sep="\n", end="\n" if types else "")
    return 0 if types else 1


def echo(args: argparse.Namespace) -> int:
    """Print messages as they come, until Ctrl-C (or the first, with --once)."""
    with graph.node() as node:
        kind = _echo_class(node, args)
        done = rclpy.Future()

        def on_message(message: Any) -> None:
            if not (args.once and done.done()):
                _print(args, message)
            if args.once and not done.done():
                done.set_result(True)

        node.create_subscription(kind, args.topic_name, _failing_into(done, on_message), _qos(node, args), raw=args.raw)
        rclpy.spin_until_future_complete(node, done, timeout_sec=args.timeout)
        if not rclpy.ok():
            raise KeyboardInterrupt
        if done.done():
            done.result()
        elif args.timeout is not None:
            return 1
    return 0


def hz(args: argparse.Namespace) -> int:
    """Print the receiving rate once a second, until Ctrl-C."""
    rate = Rate(args.window)
    with graph.node() as node:
        kind = _await_class(node, args.topic_name)
        qos = QoSProfile(depth=HZ_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        clock = node.get_clock()
        node.create_subscription(kind, args.topic_name, lambda _: rate.add(clock.now().nanoseconds), qos, raw=True)
        executor = rclpy.executors.SingleThreadedExecutor()
        executor.add_node(node)
        while rclpy.ok():
            executor.spin_once(timeout_sec=0.5)
            if (figures := rate.due()) is not None:
                print(figures)
    raise KeyboardInterrupt


def _print(args: argparse.Namespace, message: Any) -> None:
    if args.raw:
        print(message, end="\n---\n")
        return
    value = message if args.field is None else convert.field(message, args.field)
    options = {
        "truncate": None if args.full_length else args.truncate_length,
        "no_arr": args.no_arr,
        "no_str": args.no_str,
    }
    if not convert.is_message(value):
        print(value, end="\n" if args.csv else "\n---\n")
    elif args.csv:
        print(convert.to_csv(value, **options))
    else:
        print(convert.to_yaml(value, flow_style=args.flow_style, **options), end="---\n")


def _failing_into(done: Any, callback: Callable[[Any], None]) -> Callable[[Any], None]:
    # An exception out of a callback would be reported by the executor with a traceback.
    def guarded(message: Any) -> None:
        try:
            callback(message)
        except (Failure, BrokenPipeError) as error:
            done.set_exception(error)

    return guarded


def _types(node: Node, topic: str) -> list[str] | None:
    return dict(node.get_topic_names_and_types()).get(_full(node, topic))


def _full(node: Node, topic: str) -> str:
    try:
        return str(node.resolve_topic_name(topic))
    except Exception as error:  # rclpy has no one base for its name errors
        raise Failure(str(error).splitlines()[0]) from None


def _one_type(topic: str, types: list[str]) -> str:
    if len(types) > 1:
        raise Failure(f"Cannot echo topic '{topic}', as it contains more than one type: [{', '.join(types)}]")
    return types[0]


def _echo_class(node: Node, args: argparse.Namespace) -> Any:
    if args.message_type is not None:
        return convert.interface(args.message_type, "msg")
    types = graph.await_some(node, lambda: _types(node, args.topic_name))
    if types is None:
        print(f"WARNING: topic [{args.topic_name}] does not appear to be published yet")
        raise Failure("Could not determine the type for the passed topic")
    return convert.interface(_one_type(args.topic_name, types), "msg")


def _await_class(node: Node, topic: str) -> Any:
    types = graph.await_some(node, lambda: _types(node, topic), graph.QUIET_S)
    if types is None:
        print(f"WARNING: topic [{topic}] does not appear to be published yet")
        types = graph.await_some(node, lambda: _types(node, topic), float("inf"))
    if types is None:
        raise KeyboardInterrupt
    return convert.interface(_one_type(topic, types), "msg")


def _qos(node: Node, args: argparse.Namespace) -> QoSProfile:
    """Sensor data, made as strict as all publishers allow; what is given on the command line wins."""
    qos = QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=args.qos_depth or qos_profile_sensor_data.depth,
        reliability=ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.VOLATILE,
    )
    offered = [one.qos_profile for one in node.get_publishers_info_by_topic(_full(node, args.topic_name))]
    if offered and all(one.reliability == ReliabilityPolicy.RELIABLE for one in offered):
        qos.reliability = ReliabilityPolicy.RELIABLE
    if offered and all(one.durability == DurabilityPolicy.TRANSIENT_LOCAL for one in offered):
        qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
    if args.qos_reliability:
        qos.reliability = ReliabilityPolicy[args.qos_reliability.upper()]
    if args.qos_durability:
        qos.durability = DurabilityPolicy[args.qos_durability.upper()]
    return qos


def _natural(text: str) -> int:
    if not text.isdigit():
        raise argparse.ArgumentTypeError(f"{text!r} is not a non-negative integer")
    return int(text)


def _positive(text: str) -> int:
    if not text.isdigit() or int(text) == 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive integer")
    return int(text)


def _parser() -> Parser:
    parser, verbs = verbs_parser("topic")
    _list_arguments(verbs.add_parser("list", help="output a list of available topics"))
    _echo_arguments(verbs.add_parser("echo", help="output messages from a topic"))
    rate = verbs.add_parser("hz", help="print the average receiving rate")
    rate.add_argument("topic_name")
    rate.add_argument("-w", "--window", type=_positive, default=WINDOW, help="window size in messages")
    rate.add_argument("--wall-time", action="store_true", help="accepted; arrival times are wall time here")
    graph.add_arguments(rate)
    rate.set_defaults(run=hz)
    for name, run in (("info", info), ("type", type_)):
        verb = verbs.add_parser(name, help=run.__doc__)
        verb.add_argument("topic_name")
        graph.add_arguments(verb)
        verb.set_defaults(run=run)
    return parser


def _list_arguments(verb: Any) -> None:
    verb.add_argument("-t", "--show-types", action="store_true", help="additionally show the topic type")
    verb.add_argument("-c", "--count-topics", action="store_true", help="only display the number of topics")
    verb.add_argument("-a", "--include-hidden-topics", "--all", action="store_true", help="hidden topics as well")
    graph.add_arguments(verb)
    verb.set_defaults(run=listing)


def _echo_arguments(verb: Any) -> None:
    verb.add_argument("topic_name")
    verb.add_argument("message_type", nargs="?", help="needed where nobody publishes yet")
    verb.add_argument("--csv", action="store_true", help="all values separated by commas")
    verb.add_argument("--field", help="echo only a field, e.g. twist.twist.linear.x")
    verb.add_argument("-f", "--full-length", action="store_true", help="do not truncate")
    verb.add_argument("-l", "--truncate-length", type=_natural, default=TRUNCATE_LENGTH)
    verb.add_argument("--no-arr", action="store_true", help="don't print array fields")
    verb.add_argument("--no-str", action="store_true", help="don't print string fields")
    verb.add_argument("--flow-style", action="store_true", help="YAML in flow style")
    verb.add_argument("--raw", action="store_true", help="the bytes as they came")
    verb.add_argument("--once", action="store_true", help="print the first message and exit")
    verb.add_argument("--timeout", type=float, help="give up after this long [s]")
    verb.add_argument("--no-lost-messages", action="store_true", help="accepted; lost messages are not reported here")
    verb.add_argument("--qos-depth", type=_positive)
    verb.add_argument("--qos-reliability", choices=("reliable", "best_effort"))
    verb.add_argument("--qos-durability", choices=("volatile", "transient_local"))
    graph.add_arguments(verb)
    verb.set_defaults(run=echo)
