"""How a plate looks: journal widths, 8 point type, colours of φ and ω in order, the switch from walk to swim."""

from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any

import numpy as np
from plotly.colors import sample_colorscale

from sandbot_model.data.conditions import Floats
from sandbot_model.physics.observables import CM
from sandbot_model.physics.walking import Prediction
from sandbot_model.report.printed import FONT, matplotlib, rgb
from sandbot_model.report.theme import LIGHT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MM_PER_INCH = 25.4
S_IS_R_RAD = np.pi / 6
"""Angle of a leg that takes a step of R: s = 2R sin θ."""
TYPE = FONT | {
    "axes.labelsize": 8, "xtick.labelsize": 7, "ytick.labelsize": 7, "legend.fontsize": 6.5, "axes.linewidth": 0.6,
    "lines.linewidth": 1.2, "svg.fonttype": "none", "pdf.fonttype": 42,
}  # fmt: skip
INK, FAINT, ACCENT, GRID = LIGHT.ink, LIGHT.faint, LIGHT.accent, LIGHT.grid
MARKERS = "osD^vP*X"
SWITCH = {"linestyle": (0, (1, 1.5)), "linewidth": 0.9}
CONVENTION = "Where a step would carry the body slower than it swims, swimming is drawn; dots mark the switch."


def sheet(width_mm: float, height_mm: float, columns: int = 1) -> "tuple[Figure, list[Axes]]":
    """An empty figure of so many panels beside each other."""
    _, figure_class = matplotlib("atlas")
    figure = figure_class(figsize=(width_mm / MM_PER_INCH, height_mm / MM_PER_INCH), layout="constrained")
    panels = list(np.atleast_1d(figure.subplots(1, columns)))
    for panel in panels:
        panel.spines[["top", "right"]].set_visible(False)
        panel.tick_params(direction="out", length=2.5, width=0.6)
    return figure, panels


def typography() -> "AbstractContextManager[None]":
    """Draw and save within it: type and lines are as small as a journal has them."""
    context: AbstractContextManager[None] = matplotlib("atlas")[0](TYPE)
    return context


def key(panel: "Axes", title: str, columns: int = 1, **where: Any) -> None:
    """The legend, small, its title above."""
    panel.legend(
        title=title, title_fontsize=7, frameon=False, handletextpad=0.3, ncols=columns, columnspacing=0.8,
        labelspacing=0.25, handlelength=1.2, **where,
    )  # fmt: skip


ABOVE = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "borderaxespad": 0.0}
"""A legend above the panel."""


def phi_colours(count: int) -> list[tuple[float, ...]]:
    """One colour for each φ level, loosest first: as everywhere."""
    return [rgb(colour) for colour in LIGHT.phi_colours(count)]


def omega_colours(count: int) -> list[tuple[float, ...]]:
    """One colour for each leg frequency, slowest first."""
    at = np.linspace(0.0, 0.85, count) if count > 1 else [0.0]
    return [rgb(str(colour)) for colour in sample_colorscale("Viridis", list(at))]


def speed_line(panel: "Axes", x: Floats, found: Prediction, swim_m_s: float, **looks: Any) -> None:
    """Mean speed [cm/s] along x: walking and swimming as pieces, dotted where one becomes the other."""
    walks = np.asarray(found.walking) & (found.speed_m_s > swim_m_s)
    speed = CM * np.where(found.walking, np.maximum(found.speed_m_s, swim_m_s), found.speed_m_s)
    edges = np.flatnonzero(np.diff(walks.astype(int))) + 1
    for piece in np.split(np.arange(len(x)), edges):
        panel.plot(x[piece], speed[piece], **looks)
    for edge in edges:
        ends = slice(edge - 1, edge + 1)
        panel.plot(np.full(2, x[ends].mean()), speed[ends], **{**looks, **SWITCH})


def stepped_line(panel: "Axes", x: Floats, y: Floats, least: float, **looks: Any) -> None:
    """A line with jumps: where y changes by more than ``least`` within one step of the grid, a dotted upright."""
    edges = np.flatnonzero(np.abs(np.diff(y)) > least) + 1
    # Neighbouring steps that change are one jump; a grid point amid it belongs to neither side.
    jumps = [(run[0] - 1, run[-1]) for run in np.split(edges, np.flatnonzero(np.diff(edges) > 1) + 1) if len(run)]
    uprights = [(x[before] + x[after]) / 2 for before, after in jumps]
    starts, ends = [0, *(after for _, after in jumps)], [*(before for before, _ in jumps), len(x) - 1]
    sides = zip([None, *uprights], starts, ends, [*uprights, None], strict=True)
    for left, first, last, right in sides:
        piece = slice(first, last + 1)
        reach = [(left, y[first])] if left is not None else []
        onward = [(right, y[last])] if right is not None else []
        panel.plot(*np.array([*reach, *zip(x[piece], y[piece], strict=True), *onward]).T, **looks)
    for (before, after), upright in zip(jumps, uprights, strict=True):
        panel.plot([upright, upright], [y[before], y[after]], **{**looks, **SWITCH})
