"""Force given and force needed against depth: by the chosen model (Li09 Fig. 3c), by the full model (Fig. 4a)."""

from typing import TYPE_CHECKING

import numpy as np

from sandbot_model.data.conditions import Floats
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.geometry import depth_at
from sandbot_model.physics.observables import CM
from sandbot_model.report.atlas.material import Material, determined
from sandbot_model.report.atlas.style import ABOVE, FAINT, INK, S_IS_R_RAD, key, phi_colours, sheet, stepped_line
from sandbot_model.report.balance import Forces, forces
from sandbot_model.report.view import bands, frequencies

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HEADROOM = 1.05
JUMP = 0.02
"""Change within one step of the depth grid, as a fraction of the mean force, that counts as a jump."""
MIN_LABEL_GAP = 0.04
"""Smallest distance between labels of lines, as a fraction of the panel's height."""
SHOWN_FROM = 0.65
"""Shallowest depth shown, as a fraction of the deepest; legs that walk stand deeper."""


def force(material: Material, width_mm: float) -> "tuple[Figure, str]":
    """Fig. 3c: the families of ground strength (φ) and of leg frequency in one panel."""
    figure, (panel,) = sheet(width_mm, 0.8 * width_mm)
    depths = _families(panel, material, material.fit, 1.0)
    panel.set_ylabel("force on a leg (N)")
    return figure, (
        "Force the ground gives (colours, one per φ) and force needed (black, one per leg frequency, "
        f"{_range(material)}) against depth, from the fit; a leg holds where they first cross. {depths}"
    )


def dimensionless(material: Material, width_mm: float) -> "tuple[Figure, str]":
    """Fig. 4a: the same by the full model, in units of the weight a leg carries."""
    figure, (panel,) = sheet(width_mm, 0.8 * width_mm)
    weight = material.robot.mass_per_leg_kg * material.robot.gravity_m_s2
    _families(panel, material, determined(material.full), weight)
    panel.set_ylabel("force over weight, F$_z$/mg")
    return figure, (
        "The full model: force the ground gives a whole leg (colours, one per φ) and force needed, a_z/g + 1 (black, "
        f"one per leg frequency, {_range(material)}), over the weight a leg carries. At the leg's lowest point no "
        "inertia is left to overcome, and ground that carries the weight holds."
    )


def _families(panel: "Axes", material: Material, fit: Fit, unit_n: float) -> str:
    """Draw both families of forces, in units of ``unit_n``; returns the depths at which legs hold, in words."""
    omegas, _ = frequencies(material.cells)
    found: list[Forces] = [forces(fit, float(omega)) for omega in omegas]
    slow, robot = found[0], material.robot
    colours = phi_colours(len(material.cells.level_phi))
    for band, given in zip(bands(material.cells), slow.given_n, strict=True):
        panel.plot(CM * slow.depth_m, given / unit_n, color=colours[band.level], label=f"{band.phi:.3f}")
    for at_omega in found:
        needed = at_omega.needed_n[-1] / unit_n
        stepped_line(panel, CM * at_omega.depth_m, needed, JUMP * float(needed.mean()), color=INK, linewidth=0.7)
    critical = float(depth_at(robot, np.asarray(S_IS_R_RAD)))
    panel.axvline(CM * critical, color=FAINT, linestyle=(0, (4, 2)), linewidth=0.8)
    panel.set_xlabel("depth d (cm)")
    shown = slow.depth_m >= SHOWN_FROM * slow.depth_m[-1]
    panel.set_xlim(CM * slow.depth_m[shown][0], CM * slow.depth_m[-1])
    low = min(float(slow.given_n[:, shown].min()), float(slow.needed_n[:, shown].min()))
    high = max(*(float(f.needed_n[-1, shown].max()) for f in found), float(slow.given_n.max()))
    panel.set_ylim(0.95 * low / unit_n, HEADROOM * high / unit_n)
    _name_lines(panel, omegas, [float(f.needed_n[-1, shown][0]) / unit_n for f in found])
    key(panel, "φ", columns=4, **ABOVE)
    hold_depths = {band.phi: [f.holds_m[i] for f in found] for i, band in enumerate(bands(material.cells))}
    last = max(hold_depths)
    held = [(omega, depth) for omega, depth in zip(omegas, hold_depths[last], strict=True) if np.isfinite(depth)]
    if not held:
        return "They never cross."
    return (
        f"At φ {last:.3f} the depth grows from {CM * held[0][1]:.2f} cm at {held[0][0]:g} rad/s to "
        f"{CM * held[-1][1]:.2f} cm at {held[-1][0]:g}; grey: s = R."
    )


def _name_lines(panel: "Axes", omegas: Floats, heights: list[float]) -> None:
    """Label lines with ω at their left ends, fastest first; a line too close to a labelled one gets no label."""
    low, high = panel.get_ylim()
    last = high
    for omega, height in sorted(zip(omegas, heights, strict=True), reverse=True):
        if last - height < MIN_LABEL_GAP * (high - low):
            continue
        last = height
        panel.annotate(
            f"ω {omega:g}", (0.02, height), xycoords=("axes fraction", "data"), va="center", fontsize=5.5, color=INK,
            bbox={"color": "white", "pad": 0.4},
        )  # fmt: skip


def _range(material: Material) -> str:
    omegas, _ = frequencies(material.cells)
    return f"{omegas[0]:g} to {omegas[-1]:g} rad/s" if len(omegas) > 1 else f"{omegas[0]:g} rad/s"
