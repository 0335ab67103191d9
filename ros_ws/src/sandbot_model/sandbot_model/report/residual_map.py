"""Where the model fails: standardised residuals over φ × ω, as Plotly specs."""

import math

import numpy as np
from numpy.typing import NDArray

from sandbot_model.data.conditions import Cells
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.goodness import FAIL_Z
from sandbot_model.report.figures import as_json, model_name
from sandbot_model.report.map_text import cell_labels
from sandbot_model.report.theme import LIGHT, Spec, Theme, category_axis, layout, note
from sandbot_model.report.view import Step, bands, frequencies, observable_label, residual_z

Z_COLOUR_END = 8.0
"""Residual maps share this colour range, so that steps of the ladder are comparable."""
MAX_LABELLED_COLUMNS = 10
UNTESTED = "can't be tested"
"""Said in place of the number of failing cells where the pure error is not known."""


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
        trace = _heatmap(drawn.fit, observable, theme, len(shown) == 1) | {"name": model_name(drawn)}
        axes = {"xaxis": f"x{key}", "yaxis": f"y{key}"}
        spec["data"].append(cell_labels(trace, trace["text"], theme) | axes)
        spec["data"].append(trace | axes | {"showscale": i == len(shown) - 1})
        spec["layout"][f"xaxis{key}"] = category_axis(theme, "ω (rad/s)", trace["x"], domain=across, anchor=f"y{key}")
        spec["layout"][f"yaxis{key}"] = category_axis(theme, "", trace["y"], showticklabels=i == 0, anchor=f"x{key}")
        words = f"<b>{observable_label(observable)}</b><br>{model_name(drawn)}: {_outcome(drawn.fit, observable)}"
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
        "x": [column_label(w) for w in omegas],
        "y": [band.label for band in rows],
        "z": as_json(np.clip(z, -Z_COLOUR_END, Z_COLOUR_END)),
        "customdata": np.stack([as_json(z), index], axis=-1).tolist(),
        "text": text.tolist(),
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
    """(column label, row label) of the residual map → cell."""
    omegas, columns = frequencies(cells)
    return {(column_label(omegas[columns[i]]), band.label): int(i) for band in bands(cells) for i in band.cells}


def column_label(omega_rad_s: float) -> str:
    """Label of a frequency's column in a map."""
    return f"{omega_rad_s:.3g}"


def _outcome(fit: Fit, observable: str) -> str:
    if not math.isfinite(fit.lack_of_fit_p):
        return UNTESTED
    number = int(failing_cells(fit, observable).sum())
    return "no cell fails" if number == 0 else f"{number} {'cell fails' if number == 1 else 'cells fail'}"


def failing_cells(fit: Fit, observable: str) -> NDArray[np.bool_]:
    """Whether each cell is among the fit's failing cells for this observable, (n,)."""
    marked = np.zeros(len(fit.cells), dtype=bool)
    for fail in fit.fails:
        if fail.observable == observable:
            marked[fail.cell] = True
    return marked


def _mark(z: float, failing: bool, with_number: bool) -> str:
    if not math.isfinite(z):
        return "–"
    if not failing:
        return ""
    arrow = "▲" if z > 0 else "▼"
    return f"{arrow} {abs(z):.0f}" if with_number else arrow


def _residual_bar(theme: Theme) -> Spec:
    end, fail = f"{Z_COLOUR_END:g}", f"{FAIL_Z:g}"
    return {
        "title": {"text": "measured − model<br>(standard errors)", "side": "right", "font": {"size": 12}},
        "thickness": 14, "outlinewidth": 0, "tickcolor": theme.faint,
        "tickvals": [-Z_COLOUR_END, -FAIL_Z, 0, FAIL_Z, Z_COLOUR_END],
        "ticktext": [f"≤ −{end}", f"−{fail}", "0", fail, f"≥ {end}"],
    }  # fmt: skip
