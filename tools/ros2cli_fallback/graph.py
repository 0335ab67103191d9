"""A short-lived node to look at the graph with, and patience for discovery."""

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, TypeVar

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden

from ros2cli_fallback.cover import Failure, Parser
from sandbot_common.dead_ports import fresh_participant_number

T = TypeVar("T")

QUIET_S = 2.0
"""Measured on two busy cores: up to 1.7 s pass between one node's being discovered and the next one's."""

PATIENCE_S = 4.0
LONGEST_S = 30.0
ASK_AGAIN_S = 1.0
_UNKNOWN = "_NODE_NAME_UNKNOWN_"
NamesAndTypes = list[tuple[str, list[str]]]


def add_arguments(parser: Parser) -> None:
    """The flags every graph command of the real ros2 takes. There is no daemon here to do without."""
    parser.add_argument("--spin-time", type=float, default=QUIET_S, help="how long discovery must be quiet [s]")
    parser.add_argument("-s", "--use-sim-time", action="store_true", help="accepted; times here are arrival times")
    parser.add_argument("--no-daemon", action="store_true", help="accepted; there is no daemon")


@contextmanager
def node() -> Iterator[Node]:
    """A hidden node (its name begins with an underscore); Ctrl-C inside becomes KeyboardInterrupt, cleaned up."""
    pressed = _noting_ctrl_c()
    rclpy.init(args=[])
    with fresh_participant_number(rclpy.get_default_context().get_domain_id()):
        made = rclpy.create_node(f"_ros2cli_{os.getpid()}", start_parameter_services=False)
    try:
        yield made
    except ExternalShutdownException:
        raise KeyboardInterrupt from None
    except RuntimeError:
        # Where rclpy makes a message just then, "Unable to convert call argument" is what becomes of a Ctrl-C.
        if pressed.is_set():
            raise KeyboardInterrupt from None
        raise
    finally:
        made.destroy_node()
        rclpy.try_shutdown()


def _noting_ctrl_c() -> threading.Event:
    """Set by Ctrl-C, which goes on to be a KeyboardInterrupt; left alone where it is ignored or somebody else's."""
    pressed = threading.Event()

    def note(number: int, frame: FrameType | None) -> None:
        pressed.set()
        signal.default_int_handler(number, frame)

    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, note)
    return pressed


def settle(on: Node, quiet_s: float) -> None:
    """Wait until the graph has not changed for ``quiet_s``, at most ``PATIENCE_S`` more.

    The real ros2 has a daemon that has known the graph all along; one wait of fixed length misses nodes on a busy host.
    """
    seen: Any = None
    now = time.monotonic()
    limit, changed = now + quiet_s + PATIENCE_S, now
    while now < limit and (seen is None or now - changed < quiet_s or _half_known(on)):
        graph = (on.get_topic_names_and_types(), on.get_node_names_and_namespaces(), on.get_service_names_and_types())
        now = time.monotonic()
        if graph != seen:
            seen, changed = graph, now
        time.sleep(0.02)


def _half_known(on: Node) -> bool:
    # Every node publishes on /rosout; that is seen before the node's name is, which comes on a topic of its own.
    return any(one.node_name == _UNKNOWN for one in on.get_publishers_info_by_topic("/rosout"))


def await_some(on: Node, look: Callable[[], T | None], patience_s: float = PATIENCE_S) -> T | None:
    """What ``look`` finds, asked again until it is not None or patience ends.

    Patience is counted from the last node that appeared, and does not end while one is half known, up to ``LONGEST_S``:
    on a busy host discovery may take longer than any patience that a wrong name deserves.
    """
    seen, now = -1, time.monotonic()
    limit, longest = now + patience_s, now + max(LONGEST_S, patience_s)
    while (found := look()) is None and now < min(limit, longest) and rclpy.ok():
        time.sleep(0.02)
        now, known = time.monotonic(), len(full_names(on, True))
        if known != seen or _half_known(on):
            seen, limit = known, now + patience_s
    return found


def visible(names_and_types: NamesAndTypes, include_hidden: bool) -> NamesAndTypes:
    """Sorted by name; hidden names (a part beginning with an underscore) only where asked for."""
    return sorted((n, t) for n, t in names_and_types if include_hidden or not topic_or_service_is_hidden(n))


def print_names(found: NamesAndTypes, count_only: bool, show_types: bool) -> None:
    """One name a line, with its types where asked for; or only how many there are."""
    if count_only:
        print(len(found))
        return
    for name, types in found:
        print(f"{name} [{', '.join(types)}]" if show_types else name)


def full_names(on: Node, include_hidden: bool) -> list[str]:
    """The fully qualified names of the nodes, sorted."""
    names = on.get_node_names_and_namespaces()
    return sorted(f"{space.rstrip('/')}/{name}" for name, space in names if include_hidden or not name.startswith("_"))


def absolute(name: str) -> str:
    """A node name with its leading slash."""
    return name if name.startswith("/") else f"/{name}"


def require_node(on: Node, name: str, patience_s: float = PATIENCE_S) -> str:
    """The absolute name of a node that is there; Failure with the real ros2's words if it does not appear."""
    wanted = absolute(name)
    if await_some(on, lambda: True if wanted in full_names(on, True) else None, patience_s) is None:
        raise Failure("Node not found")
    return wanted


def call(on: Node, kind: Any, name: str, request: Any, patience_s: float = 5.0) -> Any:
    """Ask a service that may be asked twice and return its response; Failure where it does not answer in time."""
    client = on.create_client(kind, name)
    if not client.wait_for_service(timeout_sec=patience_s):
        raise Failure("Wait for service timed out")
    # A server may hear a new client before it knows where to answer, and gives the answer up: ask again.
    asked = []
    for _ in range(max(1, round(patience_s / ASK_AGAIN_S))):
        asked.append(client.call_async(request))
        rclpy.spin_until_future_complete(on, asked[-1], timeout_sec=ASK_AGAIN_S)
        if done := [future for future in asked if future.done()]:
            return answer(on, done[0], name)
    raise Failure(f"No response from service {name} within {patience_s:g} s")


def answer(on: Node, future: Any, name: str, patience_s: float | None = None) -> Any:
    """Spin until the response is there; Failure where it failed or took too long."""
    rclpy.spin_until_future_complete(on, future, timeout_sec=patience_s)
    if not rclpy.ok():
        raise KeyboardInterrupt
    if not future.done():
        raise Failure(f"No response from service {name} within {patience_s:g} s")
    if (error := future.exception()) is not None:
        raise Failure(f"Exception while calling service {name}: {error}")
    return future.result()
