"""Residuals of single trials against run order: they reveal a bed that drifts or jumps, in any order of φ and ω."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from sandbot_common.arrays import Floats, Ints
from sandbot_model.data.conditions import cell_of
from sandbot_model.data.quality import trend
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.observables import Observable
from sandbot_model.report import text
from sandbot_model.report.figures import as_json
from sandbot_model.report.theme import LIGHT, Theme, axis, layout
from sandbot_record.trials.table import Trials

MIN_TRIALS = 6
"""Fewest trials of known run order for a figure."""
LABELS = tuple(observable.label for observable in Observable)
END_SD = 6.0
INSIDE = 0.98
"""The axis reaches to ± ``END_SD``, further where more than 1 - ``INSIDE`` of the points lie beyond."""
MOST_NAMED = 3
SYMBOLS = ("circle", "square-open", "triangle-up-open", "diamond-open")


def residuals(trials: Trials, fit: Fit) -> tuple[Floats, Floats, Ints]:
    """Run order ``(n,)``, measured minus model ``(n, 4)`` in standard deviations of one trial, and the cell ``(n,)``.

    Only trials in a cell and with known run order are returned; NaN for an observable that the cell's fit does not use.
    """
    cells, order = fit.cells, np.asarray(trials.run_order, dtype=float)
    cell = _cells(trials, fit)
    used = cell >= 0
    cell = cell[used]
    values = np.stack([np.asarray(getattr(trials, o.column), dtype=float)[used] for o in Observable], axis=1)
    values[~np.isfinite(cells.mean[cell])] = np.nan
    return order[used], (values - fit.predicted[cell]) / cells.noise, cell


def _cells(trials: Trials, fit: Fit) -> Ints:
    """The cell of each trial whose run order is known, (n,); -1 if it is in none, or its order unknown."""
    known = np.isfinite(np.asarray(trials.run_order, dtype=float))
    fine = np.isin(np.asarray(trials.status, dtype=str), ["", "ok"])
    return np.where(known & fine, cell_of(trials, fit.cells), -1)


def drawable(trials: Trials, fit: Fit) -> bool:
    """Whether the run order of enough trials is known."""
    return len(residuals(trials, fit)[0]) >= MIN_TRIALS


def figure(trials: Trials, fit: Fit, theme: Theme = LIGHT) -> dict[str, Any]:
    """Residuals of every observable against run order."""
    order, z, _ = residuals(trials, fit)
    end = _end(z)
    data = [
        {
            "type": "scatter", "mode": "markers", "name": observable.label,
            "x": as_json(order), "y": as_json(np.where(np.abs(z[:, observable]) > end, np.nan, z[:, observable])),
            "marker": {"symbol": SYMBOLS[observable], "size": 6, "color": theme.faint if observable else theme.ink},
            "hovertemplate": f"trial %{{x:.0f}}: {observable.label} %{{y:+.1f}} s.d.<extra></extra>",
        }
        for observable in Observable
        if observable.name in fit.cells.observables
    ]  # fmt: skip
    data += _edge(order, z, end, theme)
    ink = {"color": theme.ink, "width": 1}
    zero = {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": 0, "y1": 0, "line": ink}
    return {
        "data": data,
        "layout": layout(
            theme,
            360,
            shapes=[zero],
            xaxis=axis(theme, "place in the campaign"),
            yaxis=axis(theme, "measured − model (s.d. of one trial)", range=[-1.1 * end, 1.1 * end]),
        ),
    }


def _end(z: Floats) -> float:
    """Residual up to which the axis reaches: one far trial must not flatten all others."""
    return max(END_SD, float(np.nanquantile(np.abs(z), INSIDE)))


def _beyond(z: Floats, names: Sequence[str]) -> str:
    """The trials of these ``names`` beyond the axis, the furthest first; empty without any."""
    end = _end(z)
    found = np.argwhere(np.abs(z) > end)
    found = found[np.argsort(-np.abs(z[tuple(found.T)]))]
    named = [f"{names[i]} ({LABELS[column]} {z[i, column]:+.0f})".replace("-", "−") for i, column in found[:MOST_NAMED]]
    more = f" and {len(found) - MOST_NAMED} more" if len(found) > MOST_NAMED else ""
    return f" Beyond ±{end:.2g}, at the edge (▲▼), and used: {', '.join(named)}{more}." if named else ""


def _edge(order: Floats, z: Floats, end: float, theme: Theme) -> list[dict[str, Any]]:
    """Triangles at the edge of the axis, towards what lies beyond; none if nothing does."""
    trial, column = np.nonzero(np.abs(z) > end)
    far = z[trial, column]
    trace = {
        "type": "scatter", "mode": "markers", "name": f"beyond ±{end:.2g}", "x": as_json(order[trial]),
        "y": as_json(np.copysign(end, far)), "customdata": as_json(far),
        "marker": {"symbol": np.where(far > 0.0, "triangle-up", "triangle-down").tolist(), "size": 11,
                   "color": theme.accent},
        "text": [LABELS[one] for one in column],
        "hovertemplate": "trial %{x:.0f}: %{text} %{customdata:+.1f} s.d.<extra></extra>",
    }  # fmt: skip
    return [trace] if len(far) else []


def caption(trials: Trials, fit: Fit) -> str:
    """Caption: the trend of each observable and its p-value, and the trials beyond the axis."""
    order, z, cell = residuals(trials, fit)
    return _trends(order, z, cell) + _beyond(z, trials.trial_id[_cells(trials, fit) >= 0].tolist())


def _trends(order: Floats, z: Floats, cell: Ints) -> str:
    trends = []
    for observable in Observable:
        change, p = trend(z[:, observable], order, cell)
        if np.isfinite(p):
            trends.append(f"{observable.label} {change:+.1f} (p {_probability(p)})".replace("-", "−"))
    if not trends:
        return "There are no replicates, or they were run in a row: a drift can't be separated from φ and ω."
    return (
        f"Change from first to last trial, in standard deviations of one: {', '.join(trends)}. Tested by regression "
        "of trials about the mean of their condition, so that φ and ω have no influence."
    )


def _probability(p: float) -> str:
    said = text.probability(p)
    return said if said.startswith("<") else f"= {said}"
