"""The force balance as a figure: force the ground gives and force the body needs against depth (Li09 Fig. 3c, 4a)."""

from dataclasses import dataclass

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.observables import CM
from sandbot_model.physics.walking import KCurve, depth_grid
from sandbot_model.report.figures import as_json, in_panel, legend_entry, model_name, panels
from sandbot_model.report.theme import LIGHT, Spec, Theme
from sandbot_model.report.view import Step, bands

DEPTH_POINTS = 90
HEADROOM = 1.5
"""Upper end of the force axes over the largest force needed; leaves room for text above the curves."""


@dataclass(frozen=True, eq=False)
class Forces:
    """Vertical forces on a leg against depth, and the depth at which it holds, for each band."""

    depth_m: Floats  # (depths,)
    given_n: Floats  # (n_bands, depths)
    needed_n: Floats  # (n_bands, depths)
    holds_m: Floats
    """NaN where it never holds, (n_bands,)."""


def forces(fit: Fit, omega_rad_s: float) -> Forces:
    """The force balance of every band at one leg frequency [rad/s]."""
    cells, walker = fit.cells, fit.model.walker
    first = np.array([band.cells[0] for band in bands(cells)])
    level = cells.level[first]
    inputs, params = fit.model.inputs(
        fit.point.theta,
        fit.k_n_per_m[level],
        omega_rad_s,
        cells.level_phi[level],
        cells.clock[first],
        KCurve(fit.level_phi, fit.k_n_per_m),
    )
    depth = depth_grid(fit.model.robot, DEPTH_POINTS)
    chain = walker.chain(inputs, params, depth, first_step=False)
    given, needed = (
        np.broadcast_to(force, (len(first), len(depth))) for force in (chain.force + chain.extra_force, chain.load)
    )
    return Forces(depth, given, needed, np.broadcast_to(walker.predict(inputs, params).depth_m, len(first)))


def force_balance(
    step: Step, omega_rad_s: float, base: Step | None = None, theme: Theme = LIGHT, columns: int = 4
) -> Spec:
    """Force given and force needed against depth at one leg frequency [rad/s], one panel per φ.

    The leg sinks until the ground first gives what is needed; where that never happens the robot swims. The base
    model's forces are drawn faintly behind.
    """
    rows = bands(step.fit.cells)
    shown = forces(step.fit, omega_rad_s)
    ghosts = None if base is None or base is step else forces(base.fit, omega_rad_s)
    top = HEADROOM * max(float(drawn.needed_n.max()) for drawn in (shown, ghosts) if drawn is not None)
    across = {"title": "depth (cm)", "range": [0, 1.04 * CM * float(shown.depth_m[-1])]}
    spec = panels(rows, theme, across, {"title": "force on a leg (N)", "range": [0, top]}, columns)
    colours = theme.phi_colours(len(step.fit.cells.level_phi))
    for i, band in enumerate(rows):
        traces = _crossing(shown, i, theme)
        traces = [*_curves(shown, i, f"{band.label}, {model_name(step)}", colours[band.level], theme.ink, 2.5), *traces]
        if ghosts is not None and base is not None:
            name = f"{band.label}, {model_name(base)}"
            traces = [*_curves(ghosts, i, name, theme.faint, theme.faint, 1.2), *traces]
        spec["data"] += in_panel(i, traces)
        spec["layout"]["annotations"].append(_outcome(float(shown.holds_m[i]), i, theme))
    spec["data"] += _legend(base if ghosts is not None else None, theme)
    return spec


def _curves(of: Forces, band: int, name: str, given: str, needed: str, width: float) -> list[Spec]:
    return [
        {"type": "scatter", "mode": "lines", "name": f"{name}, {verb}", "x": as_json(CM * of.depth_m),
         "y": as_json(force[band]), "line": {"color": colour, "width": width, "dash": dash},
         "showlegend": False, "hoverinfo": "skip"}
        for force, verb, colour, dash in
        ((of.given_n, "ground gives", given, "solid"), (of.needed_n, "body needs", needed, "dash"))
    ]  # fmt: skip


def _crossing(of: Forces, band: int, theme: Theme) -> list[Spec]:
    """The depth at which the leg holds, as a dot; nothing where it never does."""
    at = float(of.holds_m[band])
    if not np.isfinite(at):
        return []
    force = float(np.interp(at, of.depth_m, of.needed_n[band]))
    marker = {"color": theme.ink, "size": 10}
    return [
        {"type": "scatter", "mode": "markers", "name": "the leg holds", "x": [CM * at], "y": [force], "marker": marker,
         "showlegend": False, "hoverinfo": "skip"}
    ]  # fmt: skip


def _outcome(holds_m: float, band: int, theme: Theme) -> Spec:
    """The outcome in words, at the top of the panel."""
    key = "" if band == 0 else str(band + 1)
    words = f"d = {CM * holds_m:.2f} cm" if np.isfinite(holds_m) else "never holds: swims"
    return {
        "text": words, "xref": f"x{key} domain", "yref": f"y{key} domain", "x": 0.04, "y": 0.97, "xanchor": "left",
        "yanchor": "top", "showarrow": False, "font": {"size": 12, "color": theme.ink},
    }  # fmt: skip


def _legend(base: Step | None, theme: Theme) -> list[Spec]:
    entries = [
        legend_entry("force the ground gives", mode="lines", line={"color": theme.ink, "width": 2.5}),
        legend_entry("force the body needs", mode="lines", line={"color": theme.ink, "width": 2.5, "dash": "dash"}),
        legend_entry("the leg holds", mode="markers", marker={"color": theme.ink, "size": 10}),
    ]
    if base is not None:
        ghost = {"color": theme.faint, "width": 1.2}
        entries.append(legend_entry(f"{model_name(base)}, the same", mode="lines", line=ghost))
    return entries
