"""The geometry lock as a Plotly spec: step length from speed against body lift."""

import numpy as np

from sandbot_model.data.conditions import Cells
from sandbot_model.physics.geometry import step_from_lift
from sandbot_model.physics.observables import CM
from sandbot_model.report.figures import SYMBOLS, as_json, bars, finite_max
from sandbot_model.report.theme import LEGEND_ABOVE, LIGHT, Spec, Theme, axis, layout
from sandbot_model.report.view import bands, measured, scatter, walks


def geometry_lock(cells: Cells, theme: Theme = LIGHT) -> Spec:
    """Step length from speed, πv̄/ω, against body lift; for points on the curve, geometry alone explains the speed."""
    step_length, step_scatter = (CM * np.pi * f(cells, "speed") / cells.omega for f in (measured, scatter))
    lift, lift_scatter = (CM * f(cells, "lift") for f in (measured, scatter))
    # s grows as √Δz with infinite slope at 0; a quadratic grid draws it smoothly there.
    grid = max(finite_max(lift) / CM * 1.15, 1e-3) * np.linspace(0.0, 1.0, 121) ** 2
    locked = step_from_lift(grid, cells.robot.leg_radius_m)
    data: list[Spec] = [
        {
            "type": "scatter", "mode": "lines", "name": "s = 2√(Δz(2R − Δz)), nothing fitted", "hoverinfo": "skip",
            "x": as_json(CM * grid), "y": as_json(CM * locked),
            "line": {"color": theme.ink, "width": 1.5, "simplify": False},
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
                "error_x": bars(lift_scatter[at], colour), "error_y": bars(step_scatter[at], colour),
                "marker": {"color": colour, "size": 8, "symbol": SYMBOLS[band.level % len(SYMBOLS)]},
                "customdata": [[float(cells.omega[i]), int(i)] for i in at],
                "hovertemplate": f"{band.label}, ω %{{customdata[0]:.3g}} rad/s<br>"
                "lift %{x:.2f} cm, step %{y:.2f} cm<extra></extra>",
            }
        )  # fmt: skip
    return {
        "data": data,
        "layout": layout(
            theme,
            440,
            xaxis=axis(theme, "body lift Δz (cm)", rangemode="tozero"),
            yaxis=axis(theme, "step length πv̄/ω (cm)", rangemode="tozero"),
            margin=LEGEND_ABOVE,
        ),
    }
