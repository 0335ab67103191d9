"""Figures of how walking ends: critical frequency and peak speed (Li09 Fig. 2b, c), and step length (Fig. 3d)."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.data.conditions import Cells
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.observables import CM, Observable
from sandbot_model.report.figures import SYMBOLS, as_json, bars, model_name
from sandbot_model.report.theme import LEGEND_ABOVE, LIGHT, Spec, Theme, axis, layout
from sandbot_model.report.view import Step, bands, measured, scatter, walks

PHI_POINTS = 60
OMEGA_POINTS = 80
FINE_POINTS = 24
"""Points between the last ω that walks and the first that swims."""


@dataclass(frozen=True)
class Collapse:
    """The end of walking in each band; all (n_bands,)."""

    last_walking_rad_s: Floats
    """Largest measured ω at which the robot still walks; NaN: none."""
    first_swimming_rad_s: Floats
    """Smallest measured ω above it at which it swims; NaN: none."""
    peak_speed_m_s: Floats
    """Largest mean speed over ω."""


def collapse(cells: Cells) -> Collapse:
    """The interval of ω in which walking collapses, and the largest mean speed, for each band."""
    walking = walks(cells)
    speed = measured(cells, "speed")
    rows = []
    for band in bands(cells):
        omega, walk = cells.omega[band.cells], walking[band.cells]
        last = float(omega[walk].max()) if walk.any() else np.nan
        above = omega[~walk & ~(omega <= last)]
        first = float(above.min()) if above.size else np.nan
        here = speed[band.cells]
        rows.append((last, first, float(np.nanmax(here)) if np.isfinite(here).any() else np.nan))
    return Collapse(*np.array(rows).T)


def critical(step: Step, theme: Theme = LIGHT) -> Spec:
    """Critical frequency ω_c and peak of mean speed against φ, measured and modelled (Li09 Fig. 2b, c)."""
    phi = np.array([band.phi for band in bands(step.fit.cells)])
    seen, (modelled_phi, omega_c, peak_m_s) = collapse(step.fit.cells), modelled_collapse(step.fit)
    line = {"type": "scatter", "mode": "lines", "line": {"color": theme.accent, "width": 2.5}}
    second = {"xaxis": "x2", "yaxis": "y2"}
    return {
        "data": [
            *_measured_ends(phi, seen, theme),
            {**line, "name": model_name(step), "x": as_json(modelled_phi), "y": as_json(omega_c)},
            _markers("largest mean speed, measured", phi, CM * seen.peak_speed_m_s, theme, showlegend=False, **second),
            {**line, "name": f"largest mean speed, {model_name(step)}", "x": as_json(modelled_phi),
             "y": as_json(CM * peak_m_s), "showlegend": False, **second},
            _markers("model at the ω measured", phi, CM * largest_at_measured(step.fit), theme, hoverinfo="skip",
                     marker={"color": theme.accent, "size": 11, "symbol": "circle-open", "line": {"width": 2}},
                     **second),
        ],
        "layout": layout(
            theme,
            420,
            xaxis=axis(theme, "φ", domain=[0, 0.46]),
            yaxis=axis(theme, "critical frequency ω<sub>c</sub> (rad/s)", rangemode="tozero"),
            xaxis2=axis(theme, "φ", domain=[0.56, 1], anchor="y2"),
            yaxis2=axis(theme, "largest mean speed (cm/s)", rangemode="tozero", anchor="x2"),
        ),
    }  # fmt: skip


def _measured_ends(phi: Floats, seen: Collapse, theme: Theme) -> list[Spec]:
    """The measured intervals of ω in which walking ends, and an arrow up where it does not."""
    last, first = seen.last_walking_rad_s, seen.first_swimming_rad_s
    never = np.isfinite(last) & ~np.isfinite(first)
    between = "measured: between the last ω that walks and the first that swims"
    up = {"color": theme.ink, "size": 10, "symbol": "triangle-up"}
    return [
        _markers(between, phi, 0.5 * (last + first), theme, error_y=bars(0.5 * (first - last), theme.ink)),
        _markers("walks at every ω measured", phi[never], last[never], theme, marker=up, showlegend=bool(never.any())),
    ]


def _markers(name: str, x: Floats, y: Floats, theme: Theme, **looks: Any) -> Spec:
    points: Spec = {"type": "scatter", "mode": "markers", "name": name, "x": as_json(x), "y": as_json(y)}
    return {**points, "marker": {"color": theme.ink, "size": 8}, **looks}


def step_ratio(step: Step, theme: Theme = LIGHT) -> Spec:
    """Step length over leg radius, s/R = πv̄/(ωR), against ω; walking ends near 0.9 to 1 (Li09 Fig. 3d)."""
    cells = step.fit.cells
    radius = step.fit.model.robot.leg_radius_m
    ratio, error = (np.pi * f(cells, "speed") / cells.omega / radius for f in (measured, scatter))
    colours = theme.phi_colours(len(cells.level_phi))
    data: list[Spec] = []
    for i, band in enumerate(bands(cells)):
        colour, at = colours[band.level], band.cells
        modelled = np.pi * step.speed_m_s[i] / step.omega_rad_s / radius
        marker = {"color": colour, "size": 8, "symbol": SYMBOLS[band.level % len(SYMBOLS)]}
        data += [
            {"type": "scatter", "mode": "lines", "x": as_json(step.omega_rad_s), "y": as_json(modelled),
             "name": f"{band.label}, {model_name(step)}", "line": {"color": colour, "width": 2},
             "showlegend": False, "hoverinfo": "skip"},
            {"type": "scatter", "mode": "markers", "name": band.label, "x": as_json(cells.omega[at]),
             "y": as_json(ratio[at]), "marker": marker,
             "customdata": np.stack([cells.n[at, Observable.speed], at], axis=-1).tolist(),
             "error_y": bars(error[at], colour)},
        ]  # fmt: skip
    threshold = {
        "type": "rect", "xref": "paper", "x0": 0, "x1": 1, "yref": "y", "y0": 0.9, "y1": 1.0,
        "fillcolor": theme.empty, "line": {"width": 0}, "layer": "below",
    }  # fmt: skip
    return {
        "data": data,
        "layout": layout(
            theme,
            440,
            xaxis=axis(theme, "ω (rad/s)"),
            yaxis=axis(theme, "step length over leg radius, s/R", rangemode="tozero"),
            shapes=[threshold],
            margin=LEGEND_ABOVE,
        ),
    }


def largest_at_measured(fit: Fit) -> Floats:
    """The model's largest mean speed over the ω measured [m/s], ``(n_bands,)``."""
    return np.array([fit.predicted[band.cells, Observable.speed].max() for band in bands(fit.cells)])


def modelled_collapse(fit: Fit) -> tuple[Floats, Floats, Floats]:
    """φ, ω_c [rad/s] and largest mean speed [m/s] of the model, between the outermost levels; (n,) each.

    ω_c is NaN where the model never walks, or still walks at the largest ω searched.
    """
    largest = float(fit.cells.omega.max())
    phi = np.linspace(fit.level_phi[0], fit.level_phi[-1], PHI_POINTS if len(fit.level_phi) > 1 else 1)
    omega = np.linspace(0.5, 1.3 * largest, OMEGA_POINTS)
    found = fit.predict(phi[:, None], omega[None, :])
    last = np.where(found.walking.any(axis=1), OMEGA_POINTS - 1 - np.argmax(found.walking[:, ::-1], axis=1), -1)
    ends = (last >= 0) & (last < OMEGA_POINTS - 1)
    step = omega[1] - omega[0]
    fine = omega[np.clip(last, 0, None)][:, None] + step * np.linspace(0, 1, FINE_POINTS)
    refined = fit.predict(phi[:, None], fine)
    omega_c = np.where(ends, np.max(np.where(refined.walking, fine, 0.0), axis=1), np.nan)
    peak_on_grid = np.where(omega <= largest, found.speed_m_s, 0.0).max(axis=1)
    peak_near_end = np.where(fine <= largest, refined.speed_m_s, 0.0).max(axis=1)
    return phi, omega_c, np.maximum(peak_on_grid, peak_near_end)
