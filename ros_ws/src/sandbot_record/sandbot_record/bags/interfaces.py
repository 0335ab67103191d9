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
    _check(type_name)
    try:
        return store().deserialize_cdr(cdr, type_name)
    except Exception as error:  # rosbags raises whatever numpy, struct or its generated code stumbles over
        raise InputError(f"{len(cdr)} bytes are not a {type_name} ({type(error).__name__})") from None


def _check(type_name: str) -> None:
    if not known(type_name):
        raise InputError(f"message type {type_name!r} is not one of ROS 2 Jazzy's standard types")
