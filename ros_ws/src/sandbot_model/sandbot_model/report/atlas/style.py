"""Style of the plates: journal widths, 8 point type, sequential colours of φ and ω, the switch to swimming."""

from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any

import numpy as np
from plotly.colors import sample_colorscale

from sandbot_common.arrays import Floats
from sandbot_model.physics.observables import CM
from sandbot_model.physics.walking import Prediction
from sandbot_model.report.curves import drawn
from sandbot_model.report.print_figures import FONT, matplotlib, rgb
from sandbot_model.report.theme import LIGHT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MM_PER_INCH = 25.4
S_IS_R_RAD = np.pi / 6
"""Stance angle at which the step is R: s = 2R sin θ."""
TYPE = FONT | {
    "axes.labelsize": 8, "xtick.labelsize": 7, "ytick.labelsize": 7, "legend.fontsize": 6.5, "axes.linewidth": 0.6,
    "lines.linewidth": 1.2, "svg.fonttype": "none", "pdf.fonttype": 42,
}  # fmt: skip
INK, FAINT, ACCENT, GRID = LIGHT.ink, LIGHT.faint, LIGHT.accent, LIGHT.grid
MARKERS = "osD^vP*X"
SWITCH = {"linestyle": (0, (1, 1.5)), "linewidth": 0.9}
CONVENTION = "Where walking would be slower than swimming, swimming is drawn; dots mark the switch."


def sheet(width_mm: float, height_mm: float, columns: int = 1) -> "tuple[Figure, list[Axes]]":
    """An empty figure with ``columns`` panels side by side."""
    _, figure_class = matplotlib("atlas")
    figure = figure_class(figsize=(width_mm / MM_PER_INCH, height_mm / MM_PER_INCH), layout="constrained")
    panels = list(np.atleast_1d(figure.subplots(1, columns)))
    for panel in panels:
        panel.spines[["top", "right"]].set_visible(False)
        panel.tick_params(direction="out", length=2.5, width=0.6)
    return figure, panels


def typography() -> "AbstractContextManager[None]":
    """Context for drawing and saving, with type and line sizes of a journal."""
    context: AbstractContextManager[None] = matplotlib("atlas")[0](TYPE)
    return context


def key(panel: "Axes", title: str, columns: int = 1, **where: Any) -> None:
    """A small legend with its title above."""
    panel.legend(
        title=title, title_fontsize=7, frameon=False, handletextpad=0.3, ncols=columns, columnspacing=0.8,
        labelspacing=0.25, handlelength=1.2, **where,
    )  # fmt: skip


ABOVE = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "borderaxespad": 0.0}
"""A legend above the panel."""


def phi_colours(count: int) -> list[tuple[float, ...]]:
    """One colour for each φ level, loosest first, as on the page."""
    return [rgb(colour) for colour in LIGHT.phi_colours(count)]


def omega_colours(count: int) -> list[tuple[float, ...]]:
    """One colour for each leg frequency, slowest first."""
    at = np.linspace(0.0, 0.85, count) if count > 1 else [0.0]
    return [rgb(str(colour)) for colour in sample_colorscale("Viridis", list(at))]


def speed_line(panel: "Axes", x: Floats, found: Prediction, swim_m_s: float, **looks: Any) -> None:
    """Mean speed [cm/s] along x: walking and swimming as separate pieces, with a dotted line at each switch."""
    speed_m_s, walks = drawn(found, swim_m_s)
    speed = CM * speed_m_s
    edges = np.flatnonzero(np.diff(walks.astype(int))) + 1
    for piece in np.split(np.arange(len(x)), edges):
        panel.plot(x[piece], speed[piece], **looks)
    for edge in edges:
        ends = slice(edge - 1, edge + 1)
        panel.plot(np.full(2, x[ends].mean()), speed[ends], **{**looks, **SWITCH})


def stepped_line(panel: "Axes", x: Floats, y: Floats, threshold: float, **looks: Any) -> None:
    """A line with jumps: a dotted vertical where y changes by more than ``threshold`` within one grid step."""
    edges = np.flatnonzero(np.abs(np.diff(y)) > threshold) + 1
    # Consecutive large changes are one jump; grid points within it belong to neither side.
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
