"""Colours and layout of figures, light and dark: a sequential palette for φ, a diverging one for residuals."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from plotly.colors import sample_colorscale

FONT = "Helvetica, Arial, 'DejaVu Sans', sans-serif"
Spec = dict[str, Any]
"""A Plotly figure, trace or layout as plain data: what plotly.js, Dash and ``plotly.graph_objects.Figure`` all take."""


@dataclass(frozen=True)
class Theme:
    """Colours of one appearance. All palettes remain distinguishable with common colour-vision deficiencies."""

    ink: str
    faint: str
    grid: str
    paper: str
    accent: str
    empty: str
    phi_span: tuple[float, float]
    """Positions of the loosest and the closest packing on the plasma scale; closer packing stands out more."""
    diverging: tuple[str, str, str]
    """Measured below the model, equal, above."""
    model_palette: tuple[str, ...]
    """For overlaid models, which also differ in dash."""

    def model_colours(self, count: int) -> list[str]:
        """One colour for each of ``count`` models; the base model, first, is faint."""
        return [self.faint, *(self.model_palette[i % len(self.model_palette)] for i in range(count - 1))]

    def gap_scale(self) -> list[list[Any]]:
        """Colour scale from no difference to a clear one."""
        return [[0.0, self.diverging[1]], [1.0, self.diverging[2]]]

    def phi_colours(self, count: int) -> list[str]:
        """One colour for each of ``count`` φ levels, loosest first."""
        low, high = self.phi_span
        step = (high - low) / max(count - 1, 1)
        return [str(c) for c in sample_colorscale("Plasma", [low + step * i for i in range(count)])]

    def residual_scale(self) -> list[list[Any]]:
        """The diverging colour scale of standardised residuals."""
        below, equal, above = self.diverging
        return [[0.0, below], [0.5, equal], [1.0, above]]


LIGHT = Theme(
    ink="#1b1f24",
    faint="#767d86",
    grid="#e6e8eb",
    paper="#ffffff",
    accent="#0b63a5",
    empty="#f2f3f5",
    phi_span=(0.78, 0.0),
    diverging=("#1f5fa8", "#f6f6f4", "#c25a00"),
    model_palette=("#0b63a5", "#c25a00", "#12704f", "#8b3a8b", "#7a6400"),
)
DARK = Theme(
    ink="#e8eaed",
    faint="#9aa1aa",
    grid="#343a42",
    paper="#171a1f",
    accent="#6cb6f5",
    empty="#22262c",
    phi_span=(0.35, 0.97),
    diverging=("#5fa4ee", "#2a2f36", "#f09142"),
    model_palette=("#6cb6f5", "#f09142", "#5fc9a0", "#d795d7", "#e0c65a"),
)
THEMES = {"light": LIGHT, "dark": DARK}


LEGEND_ABOVE = {"l": 64, "r": 24, "t": 84, "b": 56}
"""Margins of a figure whose legend needs several lines on a narrow screen."""


def layout(theme: Theme, height: int, **more: Any) -> Spec:
    """The layout every figure starts from."""
    return {
        "height": height,
        "paper_bgcolor": theme.paper,
        "plot_bgcolor": theme.paper,
        "font": {"family": FONT, "size": 13, "color": theme.ink},
        "margin": {"l": 64, "r": 24, "t": 36, "b": 56},
        "hoverlabel": {"font": {"family": FONT, "size": 13}},
        "showlegend": True,
        "legend": {"orientation": "h", "x": 0, "xanchor": "left", "y": 1, "yanchor": "top", "yref": "container"},
        **more,
    }


def axis(theme: Theme, title: str = "", **more: Any) -> Spec:
    """A readable axis: outside ticks, a line, a faint grid, title with its unit."""
    return {
        "title": {"text": title, "standoff": 8, "font": {"size": 13}},
        "showline": True,
        "linecolor": theme.faint,
        "ticks": "outside",
        "ticklen": 4,
        "tickcolor": theme.faint,
        "gridcolor": theme.grid,
        "zeroline": False,
        "exponentformat": "none",
        **more,
    }


def category_axis(theme: Theme, title: str, labels: Sequence[str], **more: Any) -> Spec:
    """A map axis with its labels in this order; by default Plotly orders them by their appearance in the traces."""
    order = {"type": "category", "categoryorder": "array", "categoryarray": list(labels)}
    return axis(theme, title, showgrid=False, **(order | {"ticks": ""} | more))


def note(text: str, x: float, y: float, **more: Any) -> Spec:
    """Text at a position on the paper, (0, 0) lower left to (1, 1) upper right."""
    return {"text": text, "x": x, "y": y, "xref": "paper", "yref": "paper", "showarrow": False, **more}
