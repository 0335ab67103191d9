"""What the layouts shipped for Foxglove and PlotJuggler show."""

import json
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from typing import Any

from sandbot_bringup.config import config_folder
from sandbot_common import topics

TYPES = {topic.name: topic.type for topic in (*topics.ALL, topics.SCENE, topics.FRAMES)}


def foxglove_panels() -> dict[str, Any]:
    """Its panels by name."""
    return json.loads((config_folder() / "foxglove_layout.json").read_text())["configById"]


def foxglove() -> list[dict[str, Any]]:
    """What its plots draw."""
    return [path for panel in foxglove_panels().values() for path in panel.get("paths", ())]


def plotjuggler(tag: str) -> list[ElementTree.Element]:
    """The elements of its layout."""
    return list(ElementTree.parse(config_folder() / "plotjuggler_layout.xml").iter(tag))


def curves() -> list[str]:
    """What its plots draw."""
    return [one.get("name", "") for one in plotjuggler("curve")]


def split(curve: str) -> tuple[str, ...]:
    """Topic and names of a curve."""
    topic = max((one for one in TYPES if curve.startswith(f"{one}/")), key=len)
    return topic, *curve.removeprefix(f"{topic}/").split("/")


def plotted() -> Iterator[tuple[str, ...]]:
    """Topic and names of all that either plots."""
    yield from (tuple(path["value"].split(".")) for path in foxglove())
    yield from map(split, curves())


def value(message: Any, *names: str) -> Any:
    """What a plot shows of a message; LookupError or AttributeError where it has no such thing.

    PlotJuggler names joints by their names, and figures of /diagnostics by node and key.
    """
    if hasattr(message, "status"):
        (node, key), all_of = names, message.status
        return next(pair.value for one in all_of if one.name == node for pair in one.values if pair.key == key)
    if names[0] in topics.LEGS:
        return getattr(message, names[1])[message.name.index(names[0])]
    for name in names:
        field, _, index = name.rstrip("]").partition("[")
        message = getattr(message, field)
        message = message[int(index)] if index else message
    return message
