"""The end of walking: critical frequency and largest speed against φ (Li09 Fig. 2b, c), step over radius (Fig. 3d)."""

from typing import TYPE_CHECKING

import numpy as np

from sandbot_model.physics.observables import CM
from sandbot_model.report.atlas.material import Material, nearest
from sandbot_model.report.atlas.style import ABOVE, ACCENT, FAINT, INK, MARKERS, key, phi_colours, sheet
from sandbot_model.report.mechanics import collapse, largest_at_measured, modelled_collapse
from sandbot_model.report.view import bands, frequencies

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NARROW_MM = 120.0
"""Width up to which two legends have no room for two columns each."""
TRANSITION = (0.9, 1.0)
"""Range of s/R at which walking ends in the paper."""


def critical(material: Material, width_mm: float) -> "tuple[Figure, str]":
    """Figs 2b, c: bars span from the last ω that walks to the first that swims."""
    figure, (left, right) = sheet(width_mm, 0.3 * width_mm + 14.0, columns=2)
    seen, phis = collapse(material.cells), np.array([band.phi for band in bands(material.cells)])
    phi, omega_c, best = modelled_collapse(material.fit)
    middle = 0.5 * (seen.last_walking_rad_s + seen.first_swimming_rad_s)
    half = 0.5 * (seen.first_swimming_rad_s - seen.last_walking_rad_s)
    left.errorbar(phis, middle, half, fmt="none", ecolor=INK, elinewidth=1.0, capsize=2.0, label="measured")
    never = np.isnan(seen.first_swimming_rad_s) & np.isfinite(seen.last_walking_rad_s)
    if never.any():
        left.plot(phis[never], seen.last_walking_rad_s[never], "^", color=INK, markersize=4, label="walks at every ω")
    left.plot(phi, omega_c, color=ACCENT, label="model")
    right.plot(phis, CM * seen.peak_speed_m_s, "o", color=INK, markersize=3.5, label="measured")
    right.plot(phi, CM * best, color=ACCENT, label="model")
    at_measured = CM * largest_at_measured(material.fit)
    right.plot(phis, at_measured, "o", color=ACCENT, mfc="none", markersize=5, label="model at the ω measured")
    for panel, name in ((left, "critical frequency ω$_c$ (rad/s)"), (right, "largest mean speed (cm/s)")):
        panel.set_xlabel("volume fraction φ")
        panel.set_ylabel(name)
        panel.set_ylim(0, 1.05 * panel.get_ylim()[1])
        key(panel, "", columns=2 if width_mm > NARROW_MM else 1, **ABOVE)
    return figure, (
        "The end of walking: bars span from the last leg frequency that walks to the first that swims (left); the "
        "largest mean speed (right), modelled over all ω (line) and over the measured ω (circles). "
        f"From φ {phis[0]:.3f} to {phis[-1]:.3f} the largest speed goes from "
        f"{CM * seen.peak_speed_m_s[0]:.1f} to {CM * seen.peak_speed_m_s[-1]:.1f} cm/s."
    )


def step_over_radius(material: Material, width_mm: float) -> "tuple[Figure, str]":
    """Fig. 3d: s/R = πv̄/(ωR) of every trial; the band is where walking ends in the paper."""
    figure, (panel,) = sheet(width_mm, 0.8 * width_mm)
    trials, cells, radius = material.trials, material.cells, material.robot.leg_radius_m
    ratio = np.pi * trials.speed_m_s / trials.omega_rad_s / radius
    level = nearest(trials.phi, cells.level_phi)
    panel.axhspan(*TRANSITION, color=FAINT, alpha=0.2, linewidth=0)
    for number, colour in enumerate(phi_colours(len(cells.level_phi))):
        here = np.flatnonzero(level == number)
        panel.plot(
            trials.omega_rad_s[here], ratio[here], MARKERS[number % len(MARKERS)], color=colour, markersize=2.6,
            label=f"{cells.level_phi[number]:.3f}",
        )  # fmt: skip
    colours = phi_colours(len(cells.level_phi))
    for band in bands(cells):
        mean = np.pi * cells.mean[band.cells, 0] / cells.omega[band.cells] / radius
        panel.plot(cells.omega[band.cells], mean, color=colours[band.level], linewidth=0.7)
    omegas, _ = frequencies(cells)
    panel.set_xlabel("leg frequency ω (rad/s)")
    panel.set_ylabel("step over leg radius s/R")
    panel.set_xticks(omegas, [f"{omega:g}" for omega in omegas])
    panel.set_ylim(bottom=0)
    key(panel, "φ", columns=5, **ABOVE)
    caption = "Step length over leg radius, s/R = πv̄/(ωR), of every trial; lines join the means."
    return figure, f"{caption} {_last_steps(material)}"


def _last_steps(material: Material) -> str:
    """The range over φ of s/R in the last condition that walks, where a faster one swims."""
    cells, seen = material.cells, collapse(material.cells)
    radius = material.robot.leg_radius_m
    found = []
    for band, last, first in zip(bands(cells), seen.last_walking_rad_s, seen.first_swimming_rad_s, strict=True):
        if np.isfinite(last) and np.isfinite(first):
            at = band.cells[np.argmin(np.abs(cells.omega[band.cells] - last))]
            found.append(np.pi * cells.mean[at, 0] / last / radius)
    if not found:
        return "Walking ends at none of the φ measured."
    return f"The last step before swimming is {min(found):.2f} to {max(found):.2f} R (grey: the paper's 0.9 to 1)."
