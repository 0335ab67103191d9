"""Legs of a bag by name, as the bag may list them in another order than the robot's own."""

from collections.abc import Sequence
from dataclasses import replace

from sandbot_common.errors import InputError
from sandbot_record.bags.reader import Bag, Columns


def leg_columns(bag: Bag, topic: str, order: Sequence[str], *names: str) -> Columns:
    """Fields of joint states, in leg order; see ``in_leg_order``."""
    return in_leg_order(bag, topic, bag.columns(topic, *names), order)


def in_leg_order(bag: Bag, topic: str, columns: Columns, order: Sequence[str]) -> Columns:
    """The same columns; those with one value per joint as ``(n, legs)`` in the robot's leg ``order``.

    Joints that are not legs are left out; messages without names are assumed to be in that order. Raises InputError
    naming a leg that is missing.
    """
    recorded = joint_names(bag, topic)
    joints = len(recorded or order)
    if odd := [values.shape[1] for values in columns.fields.values() if values.ndim == 2 and values.shape[1] != joints]:
        raise InputError(f"{topic}: {odd[0]} values for {joints} {'joints' if recorded else 'legs'}")
    if not recorded or recorded == list(order):
        return columns
    if missing := [name for name in order if name not in recorded]:
        raise InputError(f"{topic}: no leg {missing[0]!r} (leg_order of the robot) among {', '.join(recorded)}")
    at = [recorded.index(name) for name in order]
    fields = {name: value[:, at] if value.ndim == 2 else value for name, value in columns.fields.items()}
    return replace(columns, fields=fields)


def joint_names(bag: Bag, topic: str) -> list[str]:
    """The names of the joints in a topic's messages; empty if it gives none."""
    message = next(bag.messages([topic]), None)
    return [] if message is None else [str(name) for name in message.decode().name]
