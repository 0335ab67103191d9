"""The figures of report and explorer, as Plotly specs.

Each is a function of plain data (view.py) and a theme; none computes physics beyond the geometry lock, and none reads
a file. Axes carry the units a person reads (cm, cm/s, rad/s). A point's ``customdata`` ends with the index of its cell,
so that a page knows what was clicked.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbot_model.data.conditions import Cells, Floats
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.geometry import step_from_lift
from sandbot_model.physics.observables import CM, Observable
from sandbot_model.report.theme import LIGHT, Spec, Theme, axis, layout, note
from sandbot_model.report.view import (
    BAND_SDS,
    Band,
    Step,
    bands,
    frequencies,
    measured,
    observable_label,
    readable,
    residual_z,
    scatter,
    walks,
)

Z_FAIL = 3.0
"""Marked on the colour bar of residual maps; which cells fail is the fit's own list."""
Z_COLOUR_END = 8.0
"""Residual maps share this colour range, so that the steps of the ladder compare."""
MAX_LABELLED_COLUMNS = 10
NARROW = 2
LEGEND_PX = 48
"""Panels in a row of a figure that stands beside another one, and the room its legend takes beyond a line."""
DIGITS = 6
"""Significant digits of the largest number drawn: more than a screen shows, and half the bytes of them all."""


def speed(
    step: Step, base: Step | None = None, theme: Theme = LIGHT, *, columns: int = 4, with_band: bool = True
) -> Spec:
    """Mean speed against ω, one panel a φ: replicate means ± s.d., the model with its uncertainty, and the base model
    as a ghost (Li09 Fig. 2a).
    """
    cells = step.fit.cells
    rows = bands(cells)
    top = CM * max(_finite_max(measured(cells, "speed")), _finite_max(step.speed_m_s)) * 1.12
    colours = theme.phi_colours(len(cells.level_phi))
    across = {"title": "ω (rad/s)", "range": _range(step.omega_rad_s, cells.omega)}
    spec = panels(rows, theme, across, {"title": "speed (cm/s)", "range": [-0.02 * top, top]}, columns)
    for i, band in enumerate(rows):
        colour = colours[band.level]
        traces = [_line(step, i, {"color": colour, "width": 2.5}), _points(cells, band, colour, theme)]
        if base is not None and base is not step:
            traces.insert(0, _line(base, i, {"color": theme.faint, "width": 1.5, "dash": "dash"}))
        if with_band:
            traces.insert(0, _band(step, i, colour))
        spec["data"] += in_panel(i, traces)
    spec["data"] += _speed_legend(step, base, theme, with_band)
    return spec


def panels(rows: Sequence[Band], theme: Theme, x: Spec, y: Spec, columns: int = 4) -> Spec:
    """An empty figure with one panel a band, titled by its φ; titles stand on the outer axes only."""
    columns = _columns(len(rows), columns)
    lines = math.ceil(len(rows) / columns)
    spec: Spec = {"data": [], "layout": layout(theme, 110 + 190 * lines, annotations=[])}
    if columns <= NARROW:
        # The legend needs several lines.
        spec["layout"]["height"] += LEGEND_PX
        spec["layout"]["margin"]["t"] += LEGEND_PX
    for i, band in enumerate(rows):
        row, column = divmod(i, columns)
        key = _key(i)
        across, up = _panel(row, column, lines, columns)
        x_title = x["title"] if i + columns >= len(rows) else ""
        spec["layout"][f"xaxis{key}"] = axis(
            theme, x_title, domain=across, anchor=f"y{key}", range=x["range"], nticks=6
        )
        y_title = y["title"] if column == 0 else ""
        spec["layout"][f"yaxis{key}"] = axis(
            theme, y_title, domain=up, anchor=f"x{key}", range=y["range"], nticks=6, showticklabels=column == 0
        )
        title = note(f"<b>{band.label}</b>", across[1], up[1], xanchor="right", yanchor="bottom", font={"size": 13})
        spec["layout"]["annotations"].append(title)
    return spec


def in_panel(i: int, traces: Sequence[Spec]) -> list[Spec]:
    """Traces put on the axes of panel ``i``."""
    return [trace | {"xaxis": f"x{_key(i)}", "yaxis": f"y{_key(i)}"} for trace in traces]


def legend_entry(name: str, **looks: Any) -> Spec:
    """A line of the legend that belongs to no panel."""
    return {"type": "scatter", "name": name, "x": [None], "y": [None], "hoverinfo": "skip", "showlegend": True, **looks}


def _speed_legend(step: Step, base: Step | None, theme: Theme, with_band: bool) -> list[Spec]:
    """Entries in ink: the colours of the panels mean φ, not what kind of mark it is."""
    entries = [
        legend_entry("measured, mean ± s.d. of a trial", mode="markers", marker={"color": theme.ink, "size": 8}),
        legend_entry(model_name(step), mode="lines", line={"color": theme.ink, "width": 2.5}),
    ]
    if with_band:
        square = {"color": _faded(theme.ink), "size": 14, "symbol": "square"}
        entries.append(legend_entry(f"± {BAND_SDS:g} standard errors of the model", mode="markers", marker=square))
    if base is not None and base is not step:
        ghost = {"color": theme.faint, "width": 1.5, "dash": "dash"}
        entries.append(legend_entry(model_name(base), mode="lines", line=ghost))
    return entries


def residual_map(step: Step, observable: str, base: Step | None = None, theme: Theme = LIGHT) -> Spec:
    """Where the model fails: standardised residuals over φ × ω, the base model's map to the left for comparison.

    ▲ measured above the model, ▼ below, – not measured. Colour saturates at ±``Z_COLOUR_END``.
    """
    shown = [step] if base is None or base is step else [base, step]
    rows = len(bands(step.fit.cells))
    spec: Spec = {
        "data": [],
        "layout": layout(theme, 150 + max(28 * rows, 110), plot_bgcolor=theme.empty, showlegend=False, annotations=[]),
    }
    spec["layout"]["margin"] |= {"t": 68, "l": 84}
    for i, drawn in enumerate(shown):
        key = "" if i == 0 else "2"
        across = [0.0, 1.0] if len(shown) == 1 else [0.515 * i, 0.515 * i + 0.485]
        trace = _heatmap(drawn.fit, observable, theme, len(shown) == 1)
        spec["data"].append(trace | {"xaxis": f"x{key}", "yaxis": f"y{key}", "showscale": i == len(shown) - 1})
        spec["layout"][f"xaxis{key}"] = axis(
            theme, "ω (rad/s)", type="category", showgrid=False, ticks="", domain=across, anchor=f"y{key}"
        )
        spec["layout"][f"yaxis{key}"] = axis(
            theme, "", type="category", showgrid=False, ticks="", showticklabels=i == 0, anchor=f"x{key}"
        )
        failing = _count(failing_cells(drawn.fit, observable))
        words = f"<b>{observable_label(observable)}</b><br>{model_name(drawn)}: {failing}"
        spec["layout"]["annotations"].append(
            note(words, across[0], 1.0, xanchor="left", yanchor="bottom", yshift=6, align="left", font={"size": 13})
        )
    return spec


def _heatmap(fit: Fit, observable: str, theme: Theme, roomy: bool) -> Spec:
    cells = fit.cells
    rows = bands(cells)
    omegas, columns = frequencies(cells)
    failing = failing_cells(fit, observable)
    all_z = residual_z(fit, observable)
    z = np.full((len(rows), len(omegas)), np.nan)
    text = np.full(z.shape, "–", dtype=object)
    index = np.full(z.shape, None, dtype=object)
    numbers = len(omegas) <= MAX_LABELLED_COLUMNS * (2 if roomy else 1)
    for row, band in enumerate(rows):
        for cell in band.cells:
            z[row, columns[cell]], index[row, columns[cell]] = all_z[cell], int(cell)
            text[row, columns[cell]] = _mark(all_z[cell], bool(failing[cell]), numbers)
    return {
        "type": "heatmap",
        "x": [_column_label(w) for w in omegas],
        "y": [band.label for band in rows],
        "z": as_json(np.clip(z, -Z_COLOUR_END, Z_COLOUR_END)),
        "customdata": np.stack([as_json(z), index], axis=-1).tolist(),
        "text": text.tolist(),
        "texttemplate": "%{text}",
        "textfont": {"size": 12},
        "zmin": -Z_COLOUR_END,
        "zmax": Z_COLOUR_END,
        "colorscale": theme.residual_scale(),
        "xgap": 2,
        "ygap": 2,
        "hoverongaps": False,
        "hovertemplate": "%{y}, ω %{x} rad/s<br>residual %{customdata[0]:.1f} standard errors<extra></extra>",
        "colorbar": _residual_bar(theme),
    }


def map_cells(cells: Cells) -> dict[tuple[str, str], int]:
    """(column, row) of the residual map, as it is labelled → the cell there."""
    omegas, columns = frequencies(cells)
    return {(_column_label(omegas[columns[i]]), band.label): int(i) for band in bands(cells) for i in band.cells}


def _column_label(omega_rad_s: float) -> str:
    return f"{omega_rad_s:.3g}"


def _count(failing: NDArray[np.bool_]) -> str:
    number = int(failing.sum())
    return "no cell fails" if number == 0 else f"{number} {'cell fails' if number == 1 else 'cells fail'}"


def ladder(steps: tuple[Step, ...], noise_floor_m_s: float, current: int, theme: Theme = LIGHT) -> Spec:
    """Error of mean speed as effects are added: in sample, out of sample, and the noise floor no model can beat."""
    inside = [CM * step.fit.rmse_m_s for step in steps]
    outside = [CM * step.fit.cv_rmse_m_s for step in steps]
    floor = CM * noise_floor_m_s
    places = list(range(len(steps)))
    last = places[-1]
    traces = [
        _rung("out of sample", places, outside, theme.accent, "circle", 11),
        _rung("in sample", places, inside, theme.faint, "circle-open", 9),
    ]
    if math.isfinite(floor):
        traces.append(
            {
                "type": "scatter", "mode": "lines", "name": f"noise floor, {floor:.2f} cm/s", "hoverinfo": "name",
                "x": [-0.5, last + 0.5], "y": [floor, floor],
                "line": {"color": theme.ink, "width": 1.5, "dash": "dot"},
            }
        )  # fmt: skip
    shown = [out if math.isfinite(out) else inn for out, inn in zip(outside, inside, strict=True)]
    labels = [
        {"x": x, "y": y, "text": f"<b>{y:.2f}</b>", "showarrow": False, "yshift": 16}
        for x, y in zip(places, shown, strict=True)
        if math.isfinite(y)
    ]
    highlight = {
        "type": "rect", "xref": "x", "yref": "paper", "x0": current - 0.4, "x1": current + 0.4, "y0": 0, "y1": 1,
        "fillcolor": theme.empty, "line": {"width": 0}, "layer": "below",
    }  # fmt: skip
    top = 1.2 * _finite_max(np.array([*inside, *outside, floor]))
    ticks = {"tickvals": places, "ticktext": [_wrapped(step.label) for step in steps], "range": [-0.5, last + 0.5]}
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


def lock_curve(lift_m: Floats, radius_m: float) -> Floats:
    """Step length s = 2√(Δz(2R − Δz)) [m] of a leg of radius R that lifts its axle by Δz [m] (Li09, physics §2)."""
    return step_from_lift(lift_m, radius_m)


def geometry_lock(cells: Cells, theme: Theme = LIGHT) -> Spec:
    """Step length from speed, πv̄/ω, against body lift; on the curve the geometry alone explains the speed."""
    step_length, step_scatter = (CM * np.pi * f(cells, "speed") / cells.omega for f in (measured, scatter))
    lift, lift_scatter = (CM * f(cells, "lift") for f in (measured, scatter))
    grid = np.linspace(0.0, max(_finite_max(lift) / CM * 1.15, 1e-3), 121)
    locked = lock_curve(grid, cells.robot.leg_radius_m)
    data: list[Spec] = [
        {
            "type": "scatter", "mode": "lines", "name": "s = 2√(Δz(2R − Δz))<br>nothing fitted", "hoverinfo": "skip",
            "x": as_json(CM * grid), "y": as_json(CM * locked), "line": {"color": theme.ink, "width": 1.5},
        }
    ]  # fmt: skip
    walking = walks(cells)
    swims = ~walking & np.isfinite(lift)
    if swims.any():
        faint = {"color": theme.faint, "size": 5, "symbol": "circle-open"}
        data.append(
            {
                "type": "scatter", "mode": "markers", "name": "swimming, any φ", "marker": faint, "hoverinfo": "skip",
                "x": as_json(lift[swims]), "y": as_json(step_length[swims]),
            }
        )  # fmt: skip
    colours = theme.phi_colours(len(cells.level_phi))
    for band in bands(cells):
        at = band.cells[walking[band.cells]]
        if not at.size:
            continue
        colour = colours[band.level]
        data.append(
            {
                "type": "scatter", "mode": "markers", "name": band.label,
                "x": as_json(lift[at]), "y": as_json(step_length[at]),
                "error_x": _bars(lift_scatter[at], colour), "error_y": _bars(step_scatter[at], colour),
                "marker": {"color": colour, "size": 8, "symbol": SYMBOLS[band.level % len(SYMBOLS)]},
                "customdata": [[float(cells.omega[i]), int(i)] for i in at],
                "hovertemplate": f"{band.label}, ω %{{customdata[0]:.3g}} rad/s<br>"
                "lift %{x:.2f} cm, step %{y:.2f} cm<extra></extra>",
            }
        )  # fmt: skip
    beside = {"x": 1.02, "y": 1, "xanchor": "left", "yanchor": "top", "orientation": "v", "yref": "paper"}
    return {
        "data": data,
        "layout": layout(
            theme,
            440,
            xaxis=axis(theme, "body lift Δz (cm)", rangemode="tozero"),
            yaxis=axis(theme, "step length πv̄/ω (cm)", rangemode="tozero"),
            legend=beside,
        ),
    }


def failing_cells(fit: Fit, observable: str) -> NDArray[np.bool_]:
    """Which cells stand in the fit's list of failing cells for this observable, (n,)."""
    marked = np.zeros(len(fit.cells), dtype=bool)
    for fail in fit.fails:
        if fail.observable == observable:
            near = np.abs(fit.cells.phi - fail.phi) + np.abs(fit.cells.omega - fail.omega_rad_s)
            marked[int(np.argmin(near))] = True
    return marked


def model_name(step: Step) -> str:
    """The model's name in a legend."""
    return step.label if not step.fit.effects else f"with {', '.join(map(readable, step.fit.effects))}"


def as_json(values: Floats) -> list[Any]:
    """As a list for JSON, to ``DIGITS`` digits of the largest: NaN becomes None, which Plotly leaves out."""
    largest = _finite_max(np.abs(values))
    rounded = np.round(values, DIGITS - math.ceil(math.log10(largest)) if largest > 0 else 0)
    return np.where(np.isfinite(values), rounded, None).tolist()  # type: ignore[call-overload, no-any-return]


SYMBOLS = ("circle", "square", "diamond", "triangle-up", "cross", "star", "triangle-down", "hexagon")


def _line(step: Step, band: int, line: Spec) -> Spec:
    return {
        "type": "scatter", "mode": "lines", "line": line, "hoverinfo": "skip", "showlegend": False,
        "name": f"{bands(step.fit.cells)[band].label}, {model_name(step)}",
        "x": as_json(step.omega_rad_s), "y": as_json(CM * step.speed_m_s[band]),
    }  # fmt: skip


def _band(step: Step, band: int, colour: str) -> Spec:
    """The area between the low and the high curve, as one closed outline."""
    area = step.band
    omega = np.concatenate([area.omega_rad_s, area.omega_rad_s[::-1]])
    edge = np.concatenate([area.low_m_s[band], area.high_m_s[band][::-1]])
    return {
        "type": "scatter", "mode": "lines", "line": {"width": 0}, "fill": "toself", "fillcolor": _faded(colour),
        "hoverinfo": "skip", "showlegend": False,
        "name": f"{bands(step.fit.cells)[band].label}, {model_name(step)} ± {BAND_SDS:g} s.e.",
        "x": as_json(omega), "y": as_json(CM * edge),
    }  # fmt: skip


def _faded(colour: str, opacity: float = 0.22) -> str:
    """A colour ``#rrggbb`` or ``rgb(r, g, b)`` that lets what is below shine through."""
    if colour.startswith("#"):
        colour = f"rgb({', '.join(str(int(colour[i : i + 2], 16)) for i in (1, 3, 5))})"
    return f"{colour.replace('rgb(', 'rgba(').removesuffix(')')}, {opacity:g})"


def _key(panel: int) -> str:
    """How Plotly counts axes: x, x2, x3."""
    return "" if panel == 0 else str(panel + 1)


def _points(cells: Cells, band: Band, colour: str, theme: Theme) -> Spec:
    at = band.cells
    return {
        "type": "scatter", "mode": "markers", "showlegend": False, "name": f"{band.label}, measured",
        "x": as_json(cells.omega[at]), "y": as_json(CM * measured(cells, "speed")[at]),
        "error_y": _bars(CM * scatter(cells, "speed")[at], colour),
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


def _bars(sizes: Floats, colour: str) -> Spec:
    return {"type": "data", "array": as_json(sizes), "color": colour, "thickness": 1.5, "width": 3, "visible": True}


def _columns(panels: int, most: int) -> int:
    """As many columns as fill the rows evenly: 5 panels in 3 + 2, 7 in 4 + 3."""
    return math.ceil(panels / math.ceil(panels / most))


def _panel(row: int, column: int, rows: int, columns: int) -> tuple[list[float], list[float]]:
    """x and y domain of one panel, row 0 on top; room for a panel title above each."""
    gap_x, gap_y = 0.03, 0.28 / rows
    width = (1 - gap_x * (columns - 1)) / columns
    height = (1 - gap_y * (rows - 1)) / rows
    left = column * (width + gap_x)
    top = 1 - row * (height + gap_y)
    return [left, min(left + width, 1.0)], [max(top - height, 0.0), top - 0.04 / rows]


def _mark(z: float, failing: bool, with_number: bool) -> str:
    if not math.isfinite(z):
        return "–"
    if not failing:
        return ""
    arrow = "▲" if z > 0 else "▼"
    return f"{arrow} {abs(z):.0f}" if with_number else arrow


def _residual_bar(theme: Theme) -> Spec:
    end, fail = f"{Z_COLOUR_END:g}", f"{Z_FAIL:g}"
    return {
        "title": {"text": "measured − model<br>(standard errors)", "side": "right", "font": {"size": 12}},
        "thickness": 14, "outlinewidth": 0, "tickcolor": theme.faint,
        "tickvals": [-Z_COLOUR_END, -Z_FAIL, 0, Z_FAIL, Z_COLOUR_END],
        "ticktext": [f"≤ −{end}", f"−{fail}", "0", fail, f"≥ {end}"],
    }  # fmt: skip


def _wrapped(label: str) -> str:
    return label.replace(" + ", "<br>+ ")


def _range(*arrays: Floats) -> list[float]:
    low, high = min(map(np.nanmin, arrays)), max(map(np.nanmax, arrays))
    edge = 0.04 * (high - low) or 1.0
    return [float(low - edge), float(high + edge)]


def _finite_max(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else 0.0
