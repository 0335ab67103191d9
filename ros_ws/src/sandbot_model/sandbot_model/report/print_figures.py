"""Matplotlib figures for print and notebooks; those of the page are Plotly's (``figures``)."""

import io
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sandbot_common.errors import InputError
from sandbot_model.physics.observables import CM
from sandbot_model.report.theme import LIGHT
from sandbot_model.report.view import Band, Step, bands, measured, measured_name, scatter

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH_IN = 178 / 25.4
"""Two columns of a journal page."""
PANEL_HEIGHT_IN = 1.55
COLUMNS = 3
FONT = {"font.size": 8, "axes.titlesize": 8, "legend.fontsize": 8, "font.family": "sans-serif"}


def speed(steps: Sequence[Step]) -> "Figure":
    """Mean speed against ω, one panel per φ: cell means ± s.d. of one trial, the last step's model, the first faint.

    The figure is independent of pyplot; ``savefig`` writes it. Raises InputError without Matplotlib.
    """
    rc_context, figure_class = matplotlib("plot")
    with rc_context(FONT):
        return _drawn(figure_class, steps)


def _drawn(figure_class: type["Figure"], steps: Sequence[Step]) -> "Figure":
    rows = bands(steps[-1].fit.cells)
    figure, panels = _panels(figure_class, len(rows))
    colours = [rgb(colour) for colour in LIGHT.phi_colours(len(steps[-1].fit.cells.level_phi))]
    top = 1.1 * CM * float(max(np.nanmax(measured(steps[-1].fit.cells, "speed")), np.nanmax(steps[-1].speed_m_s)))
    for number, (band, panel) in enumerate(zip(rows, panels, strict=True)):
        if len(steps) > 1:
            _line(panel, steps[0], number, color=LIGHT.faint, linewidth=1.0, linestyle="--")
        _line(panel, steps[-1], number, color=colours[band.level], linewidth=1.6)
        _points(panel, steps[-1], band, colours[band.level])
        panel.set_title(band.label, loc="right")
        panel.set_ylim(-0.02 * top, top)
    figure.supxlabel("ω (rad/s)", fontsize=8)
    figure.supylabel("mean speed (cm/s)", fontsize=8)
    figure.legend(
        handles=_legend(steps), loc="outside upper left", ncols=3, frameon=False, borderaxespad=0.2, handlelength=2.0
    )
    return figure


def matplotlib(asker: str) -> tuple[Any, type["Figure"]]:
    """Matplotlib's ``rc_context``, and a figure class that notebooks display without pyplot.

    Raises InputError, naming the ``asker``, where Matplotlib is not installed.
    """
    try:
        from matplotlib import rc_context
        from matplotlib.figure import Figure
    except ImportError:
        raise InputError(f"{asker}: Matplotlib is not installed; pip install matplotlib") from None

    class Picture(Figure):
        def _repr_png_(self) -> bytes:
            content = io.BytesIO()
            self.savefig(content, format="png", dpi=144)
            return content.getvalue()

    return rc_context, Picture


def _panels(figure_class: type["Figure"], count: int) -> tuple["Figure", "list[Axes]"]:
    """A figure with ``count`` panels on shared axes."""
    columns = min(COLUMNS, count)
    lines = math.ceil(count / columns)
    figure = figure_class(figsize=(WIDTH_IN, 0.6 + PANEL_HEIGHT_IN * lines), layout="constrained")
    grid = figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False)
    panels = list(grid.flat)
    for spare in panels[count:]:
        spare.set_visible(False)
    for number, panel in enumerate(panels[:count]):
        panel.spines[["top", "right"]].set_visible(False)
        panel.grid(color=LIGHT.grid, linewidth=0.6)
        # In a column that ends early, the last panel carries the tick labels.
        panel.tick_params(labelbottom=number + columns >= count, direction="out", length=2.5)
    return figure, panels[:count]


def _line(panel: "Axes", step: Step, number: int, **looks: Any) -> None:
    panel.plot(step.omega_rad_s, CM * step.speed_m_s[number], **looks)


def _points(panel: "Axes", step: Step, band: Band, colour: Any) -> None:
    cells = step.fit.cells
    panel.errorbar(
        cells.omega[band.cells],
        CM * measured(cells, "speed")[band.cells],
        CM * scatter(cells, "speed")[band.cells],
        fmt="o",
        markersize=3.5,
        color=colour,
        elinewidth=0.9,
        capsize=1.5,
        zorder=3,
    )


def _legend(steps: Sequence[Step]) -> list[Any]:
    """Entries in ink, since colours encode φ."""
    from matplotlib.lines import Line2D

    entries = [
        Line2D(
            [], [], color=LIGHT.ink, marker="o", markersize=3.5, linestyle="", label=measured_name(steps[0].fit.cells)
        ),
        Line2D([], [], color=LIGHT.ink, linewidth=1.6, label=steps[-1].label),
    ]
    if len(steps) > 1:
        entries.append(Line2D([], [], color=LIGHT.faint, linewidth=1.0, linestyle="--", label=steps[0].label))
    return entries


def rgb(colour: str) -> tuple[float, ...]:
    """A Plotly colour, ``rgb(r, g, b)``, in Matplotlib's form."""
    red, green, blue = (float(part) / 255 for part in colour.removeprefix("rgb(").removesuffix(")").split(","))
    return red, green, blue
