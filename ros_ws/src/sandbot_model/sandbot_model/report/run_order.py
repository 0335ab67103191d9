"""Residuals of single trials against run order: a bed that drifts or jumps shows here whatever the order of φ and ω."""

from typing import Any

import numpy as np

from sandbot_model.data.conditions import Floats, Ints, cell_of
from sandbot_model.data.quality import trend
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.observables import Observable
from sandbot_model.report import text
from sandbot_model.report.figures import as_json
from sandbot_model.report.theme import LIGHT, Theme, axis, layout
from sandbot_record.trials.table import Trials

FEWEST = 6
"""Trials whose place is known, below which nothing is drawn."""
SYMBOLS = ("circle", "square-open", "triangle-up-open", "diamond-open")


def residuals(trials: Trials, fit: Fit) -> tuple[Floats, Floats, Ints]:
    """Run order ``(n,)``, measured minus model ``(n, 4)`` in standard deviations of one trial, and the cell ``(n,)``.

    Of the trials that are in a cell and whose place in the campaign is known; NaN for what is not fitted in the cell.
    """
    cells, order = fit.cells, np.asarray(trials.run_order, dtype=float)
    cell = cell_of(trials, cells)
    used = (cell >= 0) & np.isfinite(order) & np.isin(np.asarray(trials.status, dtype=str), ["", "ok"])
    cell = cell[used]
    values = np.stack([np.asarray(getattr(trials, one.column), dtype=float)[used] for one in Observable], axis=1)
    values[~np.isfinite(cells.mean[cell])] = np.nan
    return order[used], (values - fit.predicted[cell]) / cells.noise, cell


def drawable(trials: Trials, fit: Fit) -> bool:
    """Whether the place of enough trials is known."""
    return len(residuals(trials, fit)[0]) >= FEWEST


def figure(trials: Trials, fit: Fit, theme: Theme = LIGHT) -> dict[str, Any]:
    """Residuals of every observable against run order."""
    order, z, _ = residuals(trials, fit)
    data = [
        {
            "type": "scatter", "mode": "markers", "name": one.label,
            "x": as_json(order), "y": as_json(z[:, one]),
            "marker": {"symbol": SYMBOLS[one], "size": 6, "color": theme.faint if one else theme.ink},
            "hovertemplate": f"trial %{{x:.0f}}: {one.label} %{{y:+.1f}} s.d.<extra></extra>",
        }
        for one in Observable
        if one.name in fit.cells.observables
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
    """What the test of a trend says of each observable."""
    order, z, cell = residuals(trials, fit)
    told = []
    for one in Observable:
        change, p = trend(z[:, one], order, cell)
        if np.isfinite(p):
            told.append(f"{one.label} {change:+.1f} (p {_probability(p)})".replace("-", "−"))
    if not told:
        return "Replicates were run in a row, or none were run: a drift can't be told from φ and ω by them."
    return (
        f"Change from first to last trial, in standard deviations of one: {', '.join(told)}. Tested by regression of "
        "trials about the mean of their condition, so that nothing of φ and ω comes in."
    )


def _probability(p: float) -> str:
    said = text.probability(p)
    return said if said.startswith("<") else f"= {said}"
