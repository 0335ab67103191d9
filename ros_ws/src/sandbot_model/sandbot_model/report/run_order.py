"""Residuals of single trials against run order: they reveal a bed that drifts or jumps, in any order of φ and ω."""

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
SYMBOLS = ("circle", "square-open", "triangle-up-open", "diamond-open")


def residuals(trials: Trials, fit: Fit) -> tuple[Floats, Floats, Ints]:
    """Run order ``(n,)``, measured minus model ``(n, 4)`` in standard deviations of one trial, and the cell ``(n,)``.

    Only trials in a cell and with known run order are returned; NaN for an observable that the cell's fit does not use.
    """
    cells, order = fit.cells, np.asarray(trials.run_order, dtype=float)
    cell = cell_of(trials, cells)
    used = (cell >= 0) & np.isfinite(order) & np.isin(np.asarray(trials.status, dtype=str), ["", "ok"])
    cell = cell[used]
    values = np.stack([np.asarray(getattr(trials, o.column), dtype=float)[used] for o in Observable], axis=1)
    values[~np.isfinite(cells.mean[cell])] = np.nan
    return order[used], (values - fit.predicted[cell]) / cells.noise, cell


def drawable(trials: Trials, fit: Fit) -> bool:
    """Whether the run order of enough trials is known."""
    return len(residuals(trials, fit)[0]) >= MIN_TRIALS


def figure(trials: Trials, fit: Fit, theme: Theme = LIGHT) -> dict[str, Any]:
    """Residuals of every observable against run order."""
    order, z, _ = residuals(trials, fit)
    data = [
        {
            "type": "scatter", "mode": "markers", "name": observable.label,
            "x": as_json(order), "y": as_json(z[:, observable]),
            "marker": {"symbol": SYMBOLS[observable], "size": 6, "color": theme.faint if observable else theme.ink},
            "hovertemplate": f"trial %{{x:.0f}}: {observable.label} %{{y:+.1f}} s.d.<extra></extra>",
        }
        for observable in Observable
        if observable.name in fit.cells.observables
    ]  # fmt: skip
    ink = {"color": theme.ink, "width": 1}
    zero = {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": 0, "y1": 0, "line": ink}
    return {
        "data": data,
        "layout": layout(
            theme,
            360,
            shapes=[zero],
            xaxis=axis(theme, "place in the campaign"),
            yaxis=axis(theme, "measured − model (s.d. of one trial)"),
        ),
    }


def caption(trials: Trials, fit: Fit) -> str:
    """Caption: the trend of each observable and its p-value."""
    order, z, cell = residuals(trials, fit)
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
