"""Publishers and subscriptions on the trackway's topics, with the QoS that each topic has."""

import math
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from sandbot_common import messages, topics

NAMELESS = "_NODE_NAME_UNKNOWN_"
"""ROS's name for the node of an endpoint it no longer knows, or not yet. A live commander renews under its own name."""


def qos(topic: topics.Topic, *, best_effort: bool = False, depth: int | None = None) -> QoSProfile:
    """The QoS of a topic: reliable unless ``best_effort``, transient local if latched, the topic's depth by default."""
    durability = DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE
    reliability = ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE
    return QoSProfile(depth=depth or topic.depth, reliability=reliability, durability=durability)


def publisher(node: Node, topic: topics.Topic) -> Publisher:
    """A publisher on a trackway topic; it offers the topic's deadline, which its subscriptions need not ask for."""
    offered = qos(topic)
    if math.isfinite(topic.deadline_s):
        # Manual: a publisher counts as alive while it commands, not while its process exists.
        offered.liveliness = LivelinessPolicy.MANUAL_BY_TOPIC
        offered.deadline = offered.liveliness_lease_duration = Duration(seconds=topic.deadline_s)
    return node.create_publisher(messages.message_class(topic.type), topic.relative, offered)


def subscription(
    node: Node,
    topic: topics.Topic,
    callback: Callable[[Any], None],
    *,
    raw: bool = False,
    best_effort: bool = False,
    depth: int | None = None,
) -> Subscription:
    """A subscription on a trackway topic; ``raw`` passes the serialized bytes to the callback.

    ``best_effort`` matches publishers of either reliability, but lost messages are not sent again.
    """
    delivery = qos(topic, best_effort=best_effort, depth=depth)
    return node.create_subscription(messages.message_class(topic.type), topic.relative, callback, delivery, raw=raw)


def reliabilities(node: Node, topic: topics.Topic) -> list[bool]:
    """Whether each publisher of a topic is reliable, as far as the graph is known."""
    found = node.get_publishers_info_by_topic(topic.relative)
    return [endpoint.qos_profile.reliability != ReliabilityPolicy.BEST_EFFORT for endpoint in found]


def unheard(node: Node, topic: topics.Topic, *, reliable: bool = False) -> str:
    """Why a publisher of a topic is not received, e.g. "rig publishes /bed/blower as std_msgs/msg/Float32, not
    std_msgs/msg/Float64"; empty if all are. ``reliable``: subscriptions to this topic are."""
    for one in node.get_publishers_info_by_topic(topic.relative):
        publishes = f"{one.node_name} publishes {topic.name}"
        if one.topic_type != topic.type:
            return f"{publishes} as {one.topic_type}, not {topic.type}"
        if reliable and one.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT:
            return f"{publishes} best effort, not reliable"
    return ""


def names_of(endpoints: Sequence[Any]) -> list[str]:
    """The names of the nodes behind publishers or subscriptions, each once."""
    return sorted({str(endpoint.node_name) for endpoint in endpoints})
