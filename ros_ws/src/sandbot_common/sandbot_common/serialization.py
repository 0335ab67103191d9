"""ROS messages to CDR bytes, with rclpy's converter alone: no node, no DDS, nothing to shut down."""

from typing import Any

from rclpy.serialization import serialize_message


def to_cdr(message: Any) -> bytes:
    """The message as it is sent over the wire (CDR, little endian, with its four-byte header)."""
    return bytes(serialize_message(message))
