"""Message types without ROS: definition text, type hash and decoding, from rosbags' type stores.

A bag is read by its own definitions (``Interface``), because types change: sensor_msgs/Range, for example, has an
additional field since Iron. Where a file carries no definitions, those of the release that wrote it are used. Bags
written here use ROS 2 Jazzy's.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from typing import Any

from mcap.records import Schema
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from sandbot_common.errors import InputError

CDR, ROS2MSG, ROS2IDL = "cdr", "ros2msg", "ros2idl"
JAZZY = "jazzy"
_IDL_PART = "=" * 80 + "\nIDL: "
_IDL_INCLUDE = re.compile(r"^#include .*", re.MULTILINE)


def store(release: str = JAZZY) -> Typestore:
    """The type store of a ROS 2 release (loaded once, 0.2 s); Jazzy's for a release that rosbags does not know."""
    return _store(release if has_release(release) else JAZZY)


def has_release(name: str) -> bool:
    """Whether rosbags knows the types of a ROS 2 release such as ``humble``."""
    return f"ros2_{name}" in {one.value for one in Stores}


@cache
def _store(release: str) -> Typestore:
    return get_typestore(Stores(f"ros2_{release}"))


def known(type_name: str) -> bool:
    """Whether definition and hash of a type such as ``sensor_msgs/msg/JointState`` are known."""
    return type_name in store().fielddefs


@cache
def definition(type_name: str) -> str:
    """The ros2msg definition with all dependent definitions. Raises InputError if the type is unknown."""
    return str(_standard(type_name).types.generate_msgdef(type_name, ros_version=2)[0])


@cache
def type_hash(type_name: str) -> str:
    """The RIHS01 hash of a type. Raises InputError if the type is unknown."""
    return _standard(type_name).types.hash_rihs01(type_name)


def decode(cdr: bytes | memoryview, type_name: str) -> Any:
    """The message in ``cdr`` by Jazzy's definition. Raises InputError on any fault in the bytes."""
    return _standard(type_name).decode(cdr)


@dataclass(frozen=True)
class Interface:
    """A message type as one bag has it: the ``encoding`` of the bytes, and the ``schema`` from the file (None: the file
    has none, and the definition of the ``release`` applies).
    """

    type: str
    hash: str = ""
    encoding: str = CDR
    schema: Schema | None = None
    release: str = JAZZY

    def check_cdr(self) -> None:
        """Raise InputError if the messages are not CDR, the only supported encoding."""
        if self.encoding != CDR:
            raise InputError(f"messages are encoded as {self.encoding!r}; only {CDR} can be decoded")

    @property
    def known(self) -> bool:
        """Whether its messages can be decoded."""
        return self.encoding == CDR and self._types is not None

    @property
    def types(self) -> Typestore:
        """The store that defines the type as this bag does. Raises InputError if its messages can't be decoded."""
        self.check_cdr()
        if self._types is None:
            raise InputError(f"message type {self.type!r} is not one of ROS 2 Jazzy's standard types")
        return self._types

    @cached_property
    def _types(self) -> Typestore | None:
        # The hash covers the definition: if it is Jazzy's, a schema damaged by a flipped bit does no harm.
        if self.hash and known(self.type) and self.hash == type_hash(self.type):
            return store()
        own = _defined_by(self.type, self.schema.encoding, self.schema.data) if self.schema else None
        types = own or store(self.release)
        return types if self.type in types.fielddefs else None

    def decode(self, cdr: bytes | memoryview) -> Any:
        """The message in ``cdr``. Raises InputError on any fault in the bytes and on an unknown type or encoding."""
        little, big, make, types = self._decoders
        try:
            order = cdr[1]
            if cdr[0] or order > 1:
                raise ValueError
            message, end = (little if order else big)(cdr[4:], 0, make, types)
            if end + 7 < len(cdr):
                raise ValueError
        except Exception as error:  # rosbags passes on any error of numpy, struct or its generated code
            raise InputError(f"{len(cdr)} bytes are not a {self.type} ({type(error).__name__})") from None
        return message

    @cached_property
    def _decoders(self) -> tuple[Callable[..., Any], Callable[..., Any], Any, Typestore]:
        """rosbags' generated functions for both byte orders and the message's class, cached."""
        found = self.types.get_msgdef(self.type)
        return found.deserialize_cdr_le, found.deserialize_cdr_be, found.cls, self.types

    def described(self) -> "Interface":
        """The interface to write into another file: with its own schema, or with a generated one where that is missing
        or invalid. Unchanged if its messages can't be decoded.
        """
        if not self.known:
            return self
        types, schema = self.types, self.schema
        if schema is None or _defined_by(self.type, schema.encoding, schema.data) is not types:
            text = types.generate_msgdef(self.type, ros_version=2)[0]
            schema = Schema(id=0, name=self.type, encoding=ROS2MSG, data=text.encode())
        return replace(self, schema=schema, hash=types.hash_rihs01(self.type))


@cache
def _standard(type_name: str) -> Interface:
    """A type as Jazzy defines it."""
    return Interface(type_name)


@lru_cache(maxsize=512)
def _defined_by(type_name: str, encoding: str, text: bytes) -> Typestore | None:
    """A store with the types that a schema's text defines; Jazzy's own store if they are the same, None if the text is
    invalid.

    Types that the text leaves out are taken from Jazzy.
    """
    standard = store()
    if known(type_name) and text == definition(type_name).encode():  # true of every bag that BagWriter wrote
        return standard
    if not text.strip():
        return None
    own = Typestore()
    try:
        own.register(_parsed(type_name, encoding, text.decode()))
        if all(_fields(own, name) == _fields(standard, name) for name in own.fielddefs):
            return standard
        own.fielddefs = standard.fielddefs | own.fielddefs
        own.types = standard.types | own.types
        own.get_msgdef(type_name), own.hash_rihs01(type_name)
    except Exception:  # rosbags' parsers and generators raise errors of many kinds on an invalid text
        return None
    return own


def _parsed(type_name: str, encoding: str, text: str) -> dict[str, Any]:
    if encoding == ROS2MSG:
        return get_types_from_msg(text, type_name)
    if encoding != ROS2IDL:
        raise ValueError(encoding)
    # Each part begins with a line that names its type; included types have parts of their own.
    parts = [part.partition("\n")[2] for part in _IDL_INCLUDE.sub("", text).split(_IDL_PART)[1:]] or [text]
    return {name: found for part in parts for name, found in get_types_from_idl(part).items()}


def _fields(types: Typestore, name: str) -> list[Any] | None:
    return list(types.fielddefs[name][1]) if name in types.fielddefs else None
