"""Message types without ROS: definition text, type hash and decoding, from rosbags' type store for ROS 2 Jazzy."""

from functools import cache
from typing import Any

from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from sandbot_common.errors import InputError


@cache
def store() -> Typestore:
    """The type store (loaded once, 0.2 s)."""
    return get_typestore(Stores.ROS2_JAZZY)


def known(type_name: str) -> bool:
    """Whether definition and hash of a type such as ``sensor_msgs/msg/JointState`` are known."""
    return type_name in store().fielddefs


@cache
def definition(type_name: str) -> str:
    """The ros2msg definition with all dependent definitions. Raises InputError if the type is unknown."""
    _check(type_name)
    return store().generate_msgdef(type_name, ros_version=2)[0]


@cache
def type_hash(type_name: str) -> str:
    """The RIHS01 hash of a type. Raises InputError if the type is unknown."""
    _check(type_name)
    return store().hash_rihs01(type_name)


def decode(cdr: bytes | memoryview, type_name: str) -> Any:
    """The message in ``cdr``; any fault in the bytes is an InputError."""
    little, big, make = _decoders(type_name)
    try:
        order = cdr[1]
        if cdr[0] or order > 1:
            raise ValueError
        message, end = (little if order else big)(cdr[4:], 0, make, store())
        if end + 7 < len(cdr):
            raise ValueError
    except Exception as error:  # rosbags raises whatever numpy, struct or its generated code stumbles over
        raise InputError(f"{len(cdr)} bytes are not a {type_name} ({type(error).__name__})") from None
    return message


@cache
def _decoders(type_name: str) -> tuple[Any, Any, type]:
    """rosbags' generated functions for both byte orders and the message's class: found once, not once a message."""
    _check(type_name)
    definition = store().get_msgdef(type_name)
    return definition.deserialize_cdr_le, definition.deserialize_cdr_be, definition.cls


def _check(type_name: str) -> None:
    if not known(type_name):
        raise InputError(f"message type {type_name!r} is not one of ROS 2 Jazzy's standard types")
