"""Mean speed against φ (Li09 Fig. 1e), against ω (Fig. 2a), and by the simple and the full model (Fig. 4b)."""

from typing import TYPE_CHECKING, Any

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.data.clustering import OMEGA_TOLERANCE, same_within
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.observables import CM
from sandbot_model.report.atlas.material import Material, determined, nearest
from sandbot_model.report.atlas.style import (
    ABOVE,
    CONVENTION,
    FAINT,
    INK,
    MARKERS,
    key,
    omega_colours,
    phi_colours,
    sheet,
    speed_line,
)
from sandbot_model.report.curves import swim_m_s
from sandbot_model.report.view import bands, frequencies, readable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

POINTS = 600
POINT: dict[str, Any] = {"linestyle": "none", "markersize": 2.6, "markeredgewidth": 0.5, "alpha": 0.85}
GHOST: dict[str, Any] = {"color": FAINT, "linewidth": 0.7, "linestyle": (0, (4, 2))}


def against_phi(material: Material, width_mm: float) -> "tuple[Figure, str]":
    """Fig. 1e."""
    figure, (panel,) = sheet(width_mm, 0.85 * width_mm)
    omegas, _ = frequencies(material.cells)
    phi_panel(panel, material, columns=5, **ABOVE)
    return figure, _phi_caption(material, omegas)


def phi_panel(panel: "Axes", material: Material, **legend: Any) -> None:
    """Mean speed against φ: one line and colour per leg frequency; points are trials at their measured φ."""
    trials, cells = material.trials, material.cells
    omegas, _ = frequencies(cells)
    phi = np.linspace(cells.level_phi[0] - 0.001, cells.level_phi[-1] + 0.001, POINTS)
    column = nearest(trials.omega_rad_s, omegas)
    for number, (omega, colour) in enumerate(zip(omegas, omega_colours(len(omegas)), strict=True)):
        found = material.fit.predict(phi, np.full_like(phi, omega))
        speed_line(panel, phi, found, swim_m_s(material.fit), color=colour)
        here = column == number
        panel.plot(
            trials.phi[here], CM * trials.speed_m_s[here], MARKERS[number % len(MARKERS)], color=colour,
            label=f"{omega:g}", **POINT,
        )  # fmt: skip
    _published_points(panel, material, "phi")
    panel.set_xlabel("volume fraction φ")
    panel.set_ylabel("mean speed (cm/s)")
    panel.set_ylim(bottom=0)
    key(panel, "ω (rad/s)", **legend)


def against_omega(material: Material, width_mm: float) -> "tuple[Figure, str]":
    """Fig. 2a; dashed: the simple model, fitted as in the paper, if these data determine it."""
    figure, (panel,) = sheet(width_mm, 0.8 * width_mm)
    first = None if material.simple.undetermined else material.simple
    omega_panel(panel, material, first=first)
    dashes = ", grey dashes: simple model, fitted to mean speeds up to the largest of each φ, as in the paper"
    best = [float(np.nanmax(material.cells.mean[band.cells, 0])) for band in bands(material.cells)]
    return figure, (
        f"Mean speed against leg frequency; points: trials, lines: {_model_name(material.fit)}"
        f"{dashes if first else ''}. The largest mean speed rises from "
        f"{CM * best[0]:.1f} cm/s at φ {material.cells.level_phi[0]:.3f} to {CM * best[-1]:.1f} cm/s at "
        f"{material.cells.level_phi[-1]:.3f}. {CONVENTION}"
    )


def omega_panel(panel: "Axes", material: Material, first: Fit | None = None) -> None:
    """Mean speed against ω: one line and colour per φ; ``first`` is dashed."""
    _lines(panel, material, material.fit, first=first)
    _points(panel, material)
    _published_points(panel, material, "omega_rad_s")
    _omega_axes(panel, material)
    key(panel, "φ", loc="upper left")


def simple_and_full(material: Material, width_mm: float) -> "tuple[Figure, str]":
    """Fig. 4b: both base models, fitted as in the paper, and the line s = R."""
    fits = [determined(fit) for fit in (material.simple, material.full)]
    figure, (panel,) = sheet(width_mm, 0.8 * width_mm)
    _lines(panel, material, material.full)
    _lines(panel, material, material.simple, linestyle=(0, (1.5, 1.2)))
    _points(panel, material)
    omega = np.array([0.0, 1.05 * material.cells.omega.max()])
    panel.plot(omega, CM * material.robot.leg_radius_m * omega / np.pi, **GHOST)
    _omega_axes(panel, material)
    simple, full = (fit.parameters["delta_t_s"] for fit in fits)
    return figure, (
        f"The simple (dotted, Δt = {simple.value:.2f} s) and the full model (solid, Δt = {full.value:.2f} s), each "
        f"fitted to mean speeds up to the largest of each φ, as in the paper; grey dashes: s = R. {CONVENTION}"
    )


def _lines(panel: "Axes", material: Material, fit: Fit, first: Fit | None = None, **looks: Any) -> None:
    cells = material.cells
    omega = np.linspace(0.5, 1.05 * cells.omega.max(), POINTS)
    colours = phi_colours(len(cells.level_phi))
    for band in bands(cells):
        for which, how in ((first, GHOST), (fit, {"color": colours[band.level], **looks})):
            if which is not None:
                found = which.predict(np.full_like(omega, band.phi), omega, cells.clock[band.cells[0]])
                speed_line(panel, omega, found, swim_m_s(which), **how)


def _points(panel: "Axes", material: Material) -> None:
    trials, cells = material.trials, material.cells
    level = nearest(trials.phi, cells.level_phi)
    for number, colour in enumerate(phi_colours(len(cells.level_phi))):
        here = level == number
        panel.plot(
            trials.omega_rad_s[here], CM * trials.speed_m_s[here], MARKERS[number % len(MARKERS)], color=colour,
            label=f"{cells.level_phi[number]:.3f}", **POINT,
        )  # fmt: skip


def _published_points(panel: "Axes", material: Material, along: str) -> None:
    """Published points, as open circles."""
    if material.published is not None:
        panel.plot(
            getattr(material.published, along), CM * material.published.speed_m_s, "o", linestyle="none", markersize=4,
            markerfacecolor="none", markeredgecolor=INK, markeredgewidth=0.7, label=material.published.source,
        )  # fmt: skip


def _omega_axes(panel: "Axes", material: Material) -> None:
    omegas, _ = frequencies(material.cells)
    panel.set_xlabel("leg frequency ω (rad/s)")
    panel.set_ylabel("mean speed (cm/s)")
    panel.set_xticks(omegas, [f"{omega:g}" for omega in omegas])
    panel.set_xlim(0, 1.05 * omegas.max())
    panel.set_ylim(0, 1.12 * CM * float(np.nanmax(material.trials.speed_m_s)))


def _phi_caption(material: Material, omegas: Floats) -> str:
    """Caption of Fig. 1e, with the largest relative loss of speed between two neighbouring φ."""
    cells = material.cells
    column = same_within(cells.omega, OMEGA_TOLERANCE)
    worst = (1.0, "")
    for number, omega in enumerate(omegas):
        here = np.flatnonzero(column == number)
        here = here[np.argsort(cells.level[here])]
        speed, phi = cells.mean[here, 0], cells.level_phi[cells.level[here]]
        for low in range(len(here) - 1):
            factor = speed[low + 1] / speed[low] if speed[low] > 0 else 1.0
            if factor > worst[0]:
                worst = (
                    factor,
                    (
                        f" At {omega:g} rad/s it falls by a factor of {factor:.1f}, from {CM * speed[low + 1]:.1f} to "
                        f"{CM * speed[low]:.1f} cm/s, between φ {phi[low + 1]:.3f} and {phi[low]:.3f}."
                    ),
                )
    return (
        f"Mean speed against volume fraction, one colour per leg frequency; points: trials, lines: "
        f"{_model_name(material.fit)}."
        f"{worst[1]} {CONVENTION}"
    )


def _model_name(fit: Fit) -> str:
    return " + ".join([f"the {fit.model.base} model", *map(readable, fit.effects)])
