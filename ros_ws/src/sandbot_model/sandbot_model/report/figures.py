"""The figures of report and explorer, as Plotly specs.

Each is a function of plain data (view.py) and a theme; none computes physics beyond the geometry lock, and none reads
a file. Axes are in readers' units (cm, cm/s, rad/s). A point's ``customdata`` ends with the index of its cell, by which
the explorer identifies a click.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.data.conditions import Cells
from sandbot_model.physics.observables import CM, Observable
from sandbot_model.report.theme import LIGHT, Spec, Theme, axis, layout, note
from sandbot_model.report.view import (
    SHOWN_SDS,
    Band,
    Step,
    bands,
    is_ladder,
    measured,
    measured_name,
    readable,
    scatter,
)

NARROW = 2
LEGEND_PX, TITLE_PX = 48, 18
"""Panels in a row of a figure shown side by side with another, the height of its legend beyond one line, and the
height of a panel title."""
DIGITS = 6
"""Significant digits kept, relative to the largest number: more than a screen resolves, at half the bytes."""


def speed(
    step: Step, base: Step | None = None, theme: Theme = LIGHT, *, columns: int = 4, with_uncertainty: bool = True
) -> Spec:
    """Mean speed against ω, one panel per φ (Li09 Fig. 2a): replicate means ± s.d., the model with its uncertainty
    where its errors hold, and the base model, faint, for comparison.
    """
    cells = step.fit.cells
    rows = bands(cells)
    with_uncertainty &= step.fit.errors_hold
    colours = theme.phi_colours(len(cells.level_phi))
    spec = speed_panels([step], theme, columns)
    for i, band in enumerate(rows):
        colour = colours[band.level]
        traces = [line(step, i, {"color": colour, "width": 2.5}), points(cells, band, colour, theme)]
        if base is not None and base is not step:
            traces.insert(0, line(base, i, {"color": theme.faint, "width": 1.5, "dash": "dash"}))
        if with_uncertainty:
            traces.insert(0, _uncertainty(step, i, colour))
        spec["data"] += in_panel(i, traces)
    spec["data"] += _speed_legend(step, base, theme, with_uncertainty)
    return spec


def measured_speed(step: Step, theme: Theme = LIGHT) -> Spec:
    """The same without the model."""
    cells = step.fit.cells
    colours, spec = theme.phi_colours(len(cells.level_phi)), speed_panels([step], theme)
    for i, band in enumerate(bands(cells)):
        spec["data"] += in_panel(i, [points(cells, band, colours[band.level], theme)])
    spec["data"].append(_measured_entry(cells, theme))
    return spec


def speed_panels(steps: Sequence[Step], theme: Theme, columns: int = 4) -> Spec:
    """Empty panels, one per φ, with axes that span the measured and all modelled speeds."""
    cells = steps[0].fit.cells
    top = 1.12 * CM * max(finite_max(measured(cells, "speed")), *(finite_max(step.speed_m_s) for step in steps))
    across = {"title": "ω (rad/s)", "range": _range(steps[0].omega_rad_s, cells.omega)}
    return panels(bands(cells), theme, across, {"title": "speed (cm/s)", "range": [-0.02 * top, top]}, columns)


def panels(rows: Sequence[Band], theme: Theme, x: Spec, y: Spec, columns: int = 4) -> Spec:
    """An empty figure with one panel per band, titled by its φ; only outer axes have titles."""
    columns = _columns(len(rows), columns)
    spec = grid_of_panels([f"<b>{band.label}</b>" for band in rows], theme, columns)
    if columns <= NARROW:
        # The legend needs several lines.
        spec["layout"]["height"] += LEGEND_PX
        spec["layout"]["margin"]["t"] += LEGEND_PX
    for i in range(len(rows)):
        key = axis_key(i)
        x_title = x["title"] if i + columns >= len(rows) else ""
        spec["layout"][f"xaxis{key}"] |= axis(theme, x_title, range=x["range"], nticks=6)
        first = i % columns == 0
        y_title = y["title"] if first else ""
        spec["layout"][f"yaxis{key}"] |= axis(theme, y_title, range=y["range"], nticks=6, showticklabels=first)
    return spec


def grid_of_panels(titles: Sequence[str], theme: Theme, columns: int, height: int = 190) -> Spec:
    """An empty figure with a panel of ``height`` px below each title; its axes have only a position."""
    lines = math.ceil(len(titles) / columns)
    # Titles are annotations, which belong to no axis: the CSV export finds the panels' titles in ``meta``.
    meta = {"panels": list(titles)}
    spec: Spec = {"data": [], "layout": layout(theme, 110 + TITLE_PX + height * lines, annotations=[], meta=meta)}
    # Plotly places the legend above the paper however many lines it has; titles need their own space on the paper.
    top = 1 - TITLE_PX / (TITLE_PX + height * lines)
    for i, title in enumerate(titles):
        key, (row, column) = axis_key(i), divmod(i, columns)
        across, up = _panel(row, column, lines, columns)
        up = [top * end for end in up]
        spec["layout"][f"xaxis{key}"] = {"domain": across, "anchor": f"y{key}"}
        spec["layout"][f"yaxis{key}"] = {"domain": up, "anchor": f"x{key}"}
        above = note(title, across[1], up[1], xanchor="right", yanchor="bottom", font={"size": 13})
        spec["layout"]["annotations"].append(above)
    return spec


def in_panel(i: int, traces: Sequence[Spec]) -> list[Spec]:
    """The traces, assigned to the axes of panel ``i``."""
    return [trace | {"xaxis": f"x{axis_key(i)}", "yaxis": f"y{axis_key(i)}"} for trace in traces]


def legend_entry(name: str, **looks: Any) -> Spec:
    """A legend entry that belongs to no panel."""
    return {"type": "scatter", "name": name, "x": [None], "y": [None], "hoverinfo": "skip", "showlegend": True, **looks}


def _speed_legend(step: Step, base: Step | None, theme: Theme, with_uncertainty: bool) -> list[Spec]:
    """Entries in ink, since colours encode φ."""
    entries = [
        _measured_entry(step.fit.cells, theme),
        legend_entry(model_name(step), mode="lines", line={"color": theme.ink, "width": 2.5}),
    ]
    if with_uncertainty:
        square = {"color": _faded(theme.ink), "size": 14, "symbol": "square"}
        entries.append(legend_entry(f"± {SHOWN_SDS:g} standard errors of the model", mode="markers", marker=square))
    if base is not None and base is not step:
        ghost = {"color": theme.faint, "width": 1.5, "dash": "dash"}
        entries.append(legend_entry(model_name(base), mode="lines", line=ghost))
    return entries


def _measured_entry(cells: Cells, theme: Theme) -> Spec:
    return legend_entry(measured_name(cells), mode="markers", marker={"color": theme.ink, "size": 8})


def ladder(steps: tuple[Step, ...], noise_floor_m_s: float, current: int, theme: Theme = LIGHT) -> Spec:
    """Error of mean speed as effects are added: in sample, out of sample, and the noise floor."""
    in_sample = [CM * step.fit.rmse_m_s for step in steps]
    out_of_sample = [CM * step.fit.cv_rmse_m_s for step in steps]
    floor = CM * noise_floor_m_s
    places = list(range(len(steps)))
    last = places[-1]
    mode = {} if is_ladder(steps) else {"mode": "markers"}
    traces = [
        _rung("out of sample", places, out_of_sample, theme.accent, "circle", 11) | mode,
        _rung("in sample", places, in_sample, theme.faint, "circle-open", 9) | mode,
        *_noise_floor(floor, last, theme),
    ]
    shown = [out if math.isfinite(out) else inn for out, inn in zip(out_of_sample, in_sample, strict=True)]
    labels = [
        {"x": x, "y": y, "text": f"<b>{y:.2f}</b>", "showarrow": False, "yshift": 16}
        for x, y in zip(places, shown, strict=True)
        if math.isfinite(y)
    ]
    highlight = {
        "type": "rect", "xref": "x", "yref": "paper", "x0": current - 0.4, "x1": current + 0.4, "y0": 0, "y1": 1,
        "fillcolor": theme.empty, "line": {"width": 0}, "layer": "below",
    }  # fmt: skip
    top = 1.2 * finite_max(np.array([*in_sample, *out_of_sample, floor]))
    ticks = {
        "tickvals": places,
        "ticktext": [step.label.replace(" + ", "<br>+ ") for step in steps],
        "range": [-0.5, last + 0.5],
    }
    return {
        "data": traces,
        "layout": layout(
            theme,
            330,
            xaxis=axis(theme, "", showgrid=False, **ticks),
            yaxis=axis(theme, "r.m.s. error of mean speed (cm/s)", range=[0, top or 1.0]),
            annotations=labels,
            shapes=[highlight],
        ),
    }


def _noise_floor(floor: float, last: int, theme: Theme) -> list[Spec]:
    trace = {
        "type": "scatter", "mode": "lines", "name": f"noise floor, {floor:.2f} cm/s", "hoverinfo": "name",
        "x": [-0.5, last + 0.5], "y": [floor, floor], "line": {"color": theme.ink, "width": 1.5, "dash": "dot"},
    }  # fmt: skip
    return [trace] if math.isfinite(floor) else []


def model_name(step: Step) -> str:
    """The model's name in a legend."""
    return step.label if not step.fit.effects else f"with {', '.join(map(readable, step.fit.effects))}"


def as_json(values: Floats) -> list[Any]:
    """As a list for JSON, rounded to ``DIGITS`` digits of the largest value; NaN becomes None, a gap in Plotly."""
    largest = finite_max(np.abs(values))
    rounded = np.round(values, DIGITS - math.ceil(math.log10(largest)) if largest > 0 else 0)
    return np.where(np.isfinite(values), rounded, None).tolist()  # type: ignore[call-overload, no-any-return]


SYMBOLS = ("circle", "square", "diamond", "triangle-up", "cross", "star", "triangle-down", "hexagon")


def line(step: Step, band: int, look: Spec) -> Spec:
    """A model's curve in one panel."""
    return {
        "type": "scatter", "mode": "lines", "line": look, "hoverinfo": "skip", "showlegend": False,
        "name": f"{bands(step.fit.cells)[band].label}, {model_name(step)}",
        "x": as_json(step.omega_rad_s), "y": as_json(CM * step.speed_m_s[band]),
    }  # fmt: skip


def _uncertainty(step: Step, band: int, colour: str) -> Spec:
    """The area between the lower and the upper curve, as one closed polygon; it has no gap where the curve has one."""
    area = step.uncertainty
    omega = np.concatenate([area.omega_rad_s, area.omega_rad_s[::-1]])
    edge = np.concatenate([area.low_m_s[band], area.high_m_s[band][::-1]])
    drawn = np.isfinite(edge)
    return {
        "type": "scatter", "mode": "lines", "line": {"width": 0}, "fill": "toself", "fillcolor": _faded(colour),
        "hoverinfo": "skip", "showlegend": False,
        "name": f"{bands(step.fit.cells)[band].label}, {model_name(step)} ± {SHOWN_SDS:g} s.e.",
        "x": as_json(omega[drawn]), "y": as_json(CM * edge[drawn]),
    }  # fmt: skip


def _faded(colour: str) -> str:
    """A translucent version of a colour ``#rrggbb`` or ``rgb(r, g, b)``."""
    if colour.startswith("#"):
        colour = f"rgb({', '.join(str(int(colour[i : i + 2], 16)) for i in (1, 3, 5))})"
    return f"{colour.replace('rgb(', 'rgba(').removesuffix(')')}, 0.22)"


def axis_key(panel: int) -> str:
    """Suffix of a panel's axes as Plotly numbers them: x, x2, x3."""
    return "" if panel == 0 else str(panel + 1)


def points(cells: Cells, band: Band, colour: str, theme: Theme) -> Spec:
    """Measured mean speeds of one panel."""
    at = band.cells
    return {
        "type": "scatter", "mode": "markers", "showlegend": False, "name": f"{band.label}, measured",
        "x": as_json(cells.omega[at]), "y": as_json(CM * measured(cells, "speed")[at]),
        "error_y": bars(CM * scatter(cells, "speed")[at], colour),
        "marker": {"color": colour, "size": 8, "line": {"color": theme.paper, "width": 1}},
        "customdata": np.stack([cells.n[at, Observable.speed], at], axis=-1).tolist(),
        "hovertemplate": "ω %{x:.3g} rad/s<br>%{y:.2f} cm/s, %{customdata[0]} trials<extra></extra>",
    }  # fmt: skip


def _rung(name: str, x: list[int], y: list[float], colour: str, symbol: str, size: int) -> Spec:
    return {
        "type": "scatter", "mode": "lines+markers", "name": name, "x": x, "y": as_json(np.array(y)),
        "line": {"color": colour, "width": 2}, "marker": {"size": size, "symbol": symbol, "line": {"width": 2}},
        "hovertemplate": "%{y:.3f} cm/s<extra>" + name + "</extra>",
    }  # fmt: skip


def _columns(panels: int, most: int) -> int:
    """Number of columns that fills the rows most evenly: 5 panels as 3 + 2, 7 as 4 + 3."""
    return math.ceil(panels / math.ceil(panels / most))


def _panel(row: int, column: int, rows: int, columns: int) -> tuple[list[float], list[float]]:
    """x and y domain of one panel, row 0 on top; leaves space for a panel title above each."""
    gap_x, gap_y = 0.03, 0.28 / rows
    width = (1 - gap_x * (columns - 1)) / columns
    height = (1 - gap_y * (rows - 1)) / rows
    left = column * (width + gap_x)
    top = 1 - row * (height + gap_y)
    return [left, min(left + width, 1.0)], [max(top - height, 0.0), top - 0.04 / rows]


def _range(*arrays: Floats) -> list[float]:
    low, high = min(map(np.nanmin, arrays)), max(map(np.nanmax, arrays))
    edge = 0.04 * (high - low) or 1.0
    return [float(low - edge), float(high + edge)]


def finite_max(values: Floats) -> float:
    """The largest finite value, 0 without any."""
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else 0.0


def bars(sizes: Floats, colour: str) -> Spec:
    """Error bars with these half lengths."""
    return {"type": "data", "array": as_json(sizes), "color": colour, "thickness": 1.5, "width": 3, "visible": True}
