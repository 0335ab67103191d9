"""Equal-length messages of one topic as numpy columns, many at a time.

In CDR the offset of a field depends only on the strings and array lengths before it. So one message is parsed with its
type's definition, and the numbers of all messages with the same strings and lengths are extracted at once, as a view.
Messages that differ (another frame name, another number of joints) form a group of their own.
"""

import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

from sandbot_common.errors import InputError
from sandbot_record.bags.interfaces import Interface

Bytes = NDArray[np.uint8]
_MAX_GROUPS = 64
DTYPES = {
    "bool": "u1", "byte": "u1", "char": "u1", "octet": "u1", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip


@dataclass(frozen=True)
class Field:
    """Where the numbers of a field lie in the message."""

    offset: int
    dtype: np.dtype[Any]
    count: int
    scalar: bool


@dataclass(frozen=True)
class Layout:
    """Layout of a message: numeric fields by dotted name, and the bytes (strings, counts) that determine it."""

    fields: dict[str, Field]
    structure: NDArray[np.int64]


def layout_of(cdr: bytes | memoryview, interface: Interface) -> Layout:
    """The layout of one message. Raises InputError if the bytes are not a message of this type."""
    types = interface.types
    if len(cdr) < 4 or cdr[0] or cdr[1] > 1:
        raise InputError(f"{len(cdr)} bytes are not a {interface.type}: no plain CDR header")
    walker = _Walker(cdr, "<" if cdr[1] else ">", types)
    walker.message(interface.type, "")
    return Layout(walker.found, np.array(walker.structure, dtype=np.int64))


def gather(rows: Bytes, interface: Interface, names: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    """The named fields of messages of equal length, ``rows`` (n, length): arrays (n,) or, for array fields, (n, k).

    Raises InputError if a message is not of this type, lacks a field, or has another number of values than the first.
    """
    result: dict[str, NDArray[Any]] = {}
    unread, groups = np.arange(len(rows)), 0
    while len(unread):
        layout = layout_of(rows[unread[0]].tobytes(), interface)
        if groups < _MAX_GROUPS:
            structure = rows[unread[:, None], layout.structure] if groups else rows[:, layout.structure]
            alike = (structure == structure[0]).all(axis=1)
        else:  # each is different: comparing them all would be quadratic
            alike = np.arange(len(unread)) == 0
        _take(rows, unread[alike], layout, names, result)
        unread, groups = unread[~alike], groups + 1
    return result


def _take(
    rows: Bytes, which: NDArray[np.int64], layout: Layout, names: tuple[str, ...], out: dict[str, NDArray[Any]]
) -> None:
    for name in names:
        if (field := layout.fields.get(name)) is None:
            raise InputError(f"no numeric field {name!r}; there are: {', '.join(layout.fields)}")
        size = field.count * field.dtype.itemsize
        part = rows[:, field.offset : field.offset + size]
        part = np.ascontiguousarray(part if len(which) == len(rows) else part[which])
        values = part.view(field.dtype).reshape(len(which), -1)
        values = values[:, 0] if field.scalar else values
        if name not in out:
            shape = (len(rows),) if field.scalar else (len(rows), field.count)
            out[name] = np.empty(shape, field.dtype.newbyteorder("="))
        if not field.scalar and out[name].shape[1] != field.count:
            raise InputError(f"field {name} has {field.count} values in some messages, {out[name].shape[1]} in others")
        out[name][which] = values


class _Walker:
    """Parses one message by its type's definition and notes where the numbers are."""

    def __init__(self, cdr: bytes | memoryview, order: str, types: Typestore) -> None:
        self._cdr, self._order, self._types, self._at = cdr, order, types, 4
        self._endian = "little" if order == "<" else "big"
        self.found: dict[str, Field] = {}
        self.structure: list[int] = [0, 1]

    def message(self, type_name: str, prefix: str) -> None:
        for name, description in self._types.fielddefs[type_name][1]:
            self._field(prefix + name, description)

    def _field(self, name: str, description: Any) -> None:
        kind, detail = description
        if kind == Nodetype.BASE:
            self._base(name, detail[0], None)
        elif kind == Nodetype.NAME:
            self.message(detail, f"{name}.")
        else:
            element, bound = detail
            count = bound if kind == Nodetype.ARRAY else self._count()
            self._many(name, element, count)

    def _many(self, name: str, element: Any, count: int) -> None:
        if count > len(self._cdr):
            raise InputError(f"field {name}: {count} elements do not fit into {len(self._cdr)} bytes")
        kind, detail = element
        if kind == Nodetype.BASE and detail[0] != "string":
            self._base(name, detail[0], count)
        else:
            for index in range(count):
                self._field(f"{name}.{index}", element)

    def _base(self, name: str, base: str, count: int | None) -> None:
        if base == "string":
            length = self._count()
            start = self._at
            self._skip(length)
            self.structure += range(start, self._at)
            return
        if base not in DTYPES:
            raise InputError(f"field {name}: type {base} is not supported")
        dtype = np.dtype(self._order + DTYPES[base])
        if count != 0:
            self._align(dtype.itemsize)
        self.found[name] = Field(self._at, dtype, 1 if count is None else count, count is None)
        self._skip(dtype.itemsize * (1 if count is None else count))

    def _count(self) -> int:
        self._align(4)
        start = self._at
        self._skip(4)
        self.structure += range(start, start + 4)
        return int.from_bytes(self._cdr[start : start + 4], self._endian)  # type: ignore[arg-type]

    def _align(self, size: int) -> None:
        self._at += -(self._at - 4) % size

    def _skip(self, size: int) -> None:
        self._at += size
        if self._at > len(self._cdr) or size > sys.maxsize:
            raise InputError(f"{len(self._cdr)} bytes are too short for the message's type")
