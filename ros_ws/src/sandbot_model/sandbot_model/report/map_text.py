"""Text labels on the cells of a map, black or white, whichever contrasts more with the cell's colour."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from sandbot_model.report.theme import Spec, Theme

Rgb = tuple[float, float, float]
BLACK, WHITE = "#000000", "#ffffff"


def cell_labels(heat: Spec, text: Sequence[Sequence[str]], theme: Theme) -> Spec:
    """A trace with a text label on each cell of a heatmap; clicks pass through to the map below."""
    cells = [
        (x, y, label, ink(value, heat, theme))
        for y, row, values in zip(heat["y"], text, heat["z"], strict=True)
        for x, label, value in zip(heat["x"], row, values, strict=True)
        if label
    ]
    xs, ys, labels, inks = ([list(column) for column in zip(*cells, strict=True)] or [[]] * 4)[:4]
    return {
        "type": "scatter", "mode": "text", "x": xs, "y": ys, "text": labels, "textfont": {"size": 12, "color": inks},
        "hoverinfo": "skip", "showlegend": False, "name": "",
    }  # fmt: skip


def ink(value: float | None, heat: Spec, theme: Theme) -> str:
    """Black or white for a cell of this value; a cell without value has the background colour."""
    colour = theme.empty if value is None else colour_at(value, heat)
    return max((BLACK, WHITE), key=lambda ink_colour: contrast(ink_colour, colour))


def colour_at(value: float, heat: Spec) -> str:
    """The colour of a value on the map's scale, as Plotly draws it: linear between the scale's colours."""
    share = min(max((value - heat["zmin"]) / (heat["zmax"] - heat["zmin"]), 0.0), 1.0)
    for (low, first), (high, second) in pairwise(heat["colorscale"]):
        if share <= high:
            at = (share - low) / (high - low)
            mixed = (a + at * (b - a) for a, b in zip(_rgb(first), _rgb(second), strict=True))
            return "#" + "".join(f"{round(255 * part):02x}" for part in mixed)
    raise ValueError(f"{heat['colorscale']!r} does not end at 1")


def contrast(first: str, second: str) -> float:
    """Contrast ratio of two colours, 1 to 21 (WCAG 2.2, relative luminance)."""
    light, dark = sorted((_luminance(first), _luminance(second)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def _luminance(colour: str) -> float:
    linear = (part / 12.92 if part <= 0.04045 else math.pow((part + 0.055) / 1.055, 2.4) for part in _rgb(colour))
    return sum(weight * part for weight, part in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def _rgb(colour: Any) -> Rgb:
    red, green, blue = (int(str(colour)[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return red, green, blue
