"""The geometry lock as a Plotly spec: step length from speed against body lift."""

from collections.abc import Callable

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.data.conditions import Cells
from sandbot_model.physics.geometry import step_from_lift
from sandbot_model.physics.observables import CM
from sandbot_model.report.figures import SYMBOLS, as_json, bars, finite_max
from sandbot_model.report.theme import LEGEND_ABOVE, LIGHT, Spec, Theme, axis, layout
from sandbot_model.report.view import bands, measured, scatter, walks


def geometry_lock(cells: Cells, theme: Theme = LIGHT) -> Spec:
    """Step length from speed, πv̄/ω, against body lift; for points on the curve, geometry alone explains the speed."""
    # s grows as √Δz with infinite slope at 0; a quadratic grid draws it smoothly there.
    grid = max(finite_max(CM * measured(cells, "lift")) / CM * 1.15, 1e-3) * np.linspace(0.0, 1.0, 121) ** 2
    locked = step_from_lift(grid, cells.robot.leg_radius_m)
    curve: Spec = {
        "type": "scatter", "mode": "lines", "name": "s = 2√(Δz(2R − Δz)), nothing fitted", "hoverinfo": "skip",
        "x": as_json(CM * grid), "y": as_json(CM * locked),
        "line": {"color": theme.ink, "width": 1.5, "simplify": False},
    }  # fmt: skip
    return {
        "data": [curve, *_swimmers(cells, theme), *_walkers(cells, theme)],
        "layout": layout(
            theme,
            440,
            xaxis=axis(theme, "body lift Δz (cm)", rangemode="tozero"),
            yaxis=axis(theme, "step length πv̄/ω (cm)", rangemode="tozero"),
            margin=LEGEND_ABOVE,
        ),
    }


def _step_length_cm(cells: Cells, of_speed: Callable[[Cells, str], Floats]) -> Floats:
    """πv̄/ω, from the means or the scatter of speed."""
    return CM * np.pi * of_speed(cells, "speed") / cells.omega


def _swimmers(cells: Cells, theme: Theme) -> list[Spec]:
    lift = CM * measured(cells, "lift")
    swims = ~walks(cells) & np.isfinite(lift)
    faint = {"color": theme.faint, "size": 5, "symbol": "circle-open"}
    points = {
        "type": "scatter", "mode": "markers", "name": "swimming, any φ", "marker": faint, "hoverinfo": "skip",
        "x": as_json(lift[swims]), "y": as_json(_step_length_cm(cells, measured)[swims]),
    }  # fmt: skip
    return [points] if swims.any() else []


def _walkers(cells: Cells, theme: Theme) -> list[Spec]:
    """The walking cells of each band, with the scatter of single trials."""
    step_length, step_scatter = (_step_length_cm(cells, of) for of in (measured, scatter))
    lift, lift_scatter = (CM * of(cells, "lift") for of in (measured, scatter))
    walking, data = walks(cells), list[Spec]()
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
    return data
