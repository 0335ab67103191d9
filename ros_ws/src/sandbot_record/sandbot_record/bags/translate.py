"""Converts messages of another release to Jazzy's definition, the only one that subscribers to a replay know."""

from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys.base import normalize_fieldname

from sandbot_common.errors import InputError
from sandbot_record.bags import interfaces
from sandbot_record.bags.columns import DTYPES
from sandbot_record.bags.interfaces import Interface


def to_jazzy(cdr: memoryview, interface: Interface) -> memoryview:
    """The message with the fields of Jazzy's definition of its type; fields that it lacks are zero or empty.

    Messages that already have Jazzy's definition, or a type that Jazzy does not know, are returned unchanged. Raises
    InputError if the bytes are not a message of this type, or if a field has another type in Jazzy.
    """
    if not interface.known or interface.types is interfaces.store() or not interfaces.known(interface.type):
        return cdr
    message = interface.decode(bytes(cdr))
    try:
        return interfaces.store().serialize_cdr(_message(message, interface.type), interface.type)
    except Exception as error:  # rosbags passes on any error of numpy, struct or its generated code
        raise InputError(f"a {interface.type} does not fit Jazzy's definition ({type(error).__name__})") from None


def _message(given: Any, type_name: str) -> Any:
    types = interfaces.store()
    names = [(normalize_fieldname(name), description) for name, description in types.fielddefs[type_name][1]]
    fields = {name: _value(getattr(given, name, None), description) for name, description in names}
    return types.types[type_name](**fields)


def _value(given: Any, description: Any) -> Any:
    """A field's value as its description requires; ``given`` is None if the message has no such field."""
    kind, detail = description
    if kind == Nodetype.NAME:
        return _message(given, detail)
    if kind == Nodetype.BASE:
        return given if given is not None else "" if detail[0] == "string" else 0
    (element, name), bound = detail
    count = bound if kind == Nodetype.ARRAY else 0
    if element == Nodetype.NAME:
        return [_message(one, name) for one in (given if given is not None else [None] * count)]
    if name[0] == "string":
        return [""] * count if given is None else given
    return np.asarray([0] * count if given is None else given, DTYPES[name[0]])
