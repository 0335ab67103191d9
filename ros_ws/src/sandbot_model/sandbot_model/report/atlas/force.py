"""Force given and force needed against depth: by the chosen model (Li09 Fig. 3c), by the full model (Fig. 4a)."""

from typing import TYPE_CHECKING, Any

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
SAME = 0.01
"""Relative difference up to which two forces are drawn as one line."""
MARGIN = 0.2
"""Depths shown above those at which legs hold, as a fraction of the range of these."""


def force(material: Material, width_mm: float) -> "tuple[Figure, str]":
    """Fig. 3c: the families of ground strength (φ) and of leg frequency in one panel."""
    figure, (panel,) = sheet(width_mm, 0.8 * width_mm)
    ends = _families(panel, material, found := _balances(material, material.fit), 1.0)
    panel.set_ylabel("force on a leg (N)")
    return figure, (
        f"Force the ground gives (colours, one per φ{ends}) and force needed (black, one per leg frequency, "
        f"{_range(material)}) against depth, from the fit; a leg holds where they first cross (dots). "
        f"{_depths(material, found)}"
    )


def dimensionless(material: Material, width_mm: float) -> "tuple[Figure, str]":
    """Fig. 4a: the same by the full model, in units of the weight a leg carries."""
    figure, (panel,) = sheet(width_mm, 0.8 * width_mm)
    weight = material.robot.mass_per_leg_kg * material.robot.gravity_m_s2
    ends = _families(panel, material, _balances(material, determined(material.full)), weight)
    panel.set_ylabel("force over weight, F$_z$/mg")
    return figure, (
        f"The full model: force the ground gives a whole leg (colours, one per φ{ends}) and force needed, a_z/g + 1 "
        f"(black, one per leg frequency, {_range(material)}), over the weight a leg carries; a leg holds where they "
        "first cross (dots). At the leg's lowest point no inertia is left to overcome, and ground that carries the "
        "weight holds."
    )


def _balances(material: Material, fit: Fit) -> list[Forces]:
    """The force balance at each leg frequency, slowest first."""
    return [forces(fit, float(omega)) for omega in frequencies(material.cells)[0]]


def _families(panel: "Axes", material: Material, found: list[Forces], unit_n: float) -> str:
    """Draw both families of forces, in units of ``unit_n``, and where legs hold. The force given is drawn at the
    slowest leg frequency, and where it depends on that also at the fastest; returns that in words.
    """
    omegas, _ = frequencies(material.cells)
    one = all(np.allclose(at.given_n, found[0].given_n, rtol=SAME) for at in found)
    levels, colours = bands(material.cells), phi_colours(len(material.cells.level_phi))
    for i, band in enumerate(levels):
        looks: dict[str, Any] = {"color": colours[band.level]}
        panel.plot(CM * found[0].depth_m, found[0].given_n[i] / unit_n, label=f"{band.phi:.3f}", **looks)
        if not one:
            panel.plot(CM * found[-1].depth_m, found[-1].given_n[i] / unit_n, linestyle=(0, (4, 1.5)), **looks)
        held = [float(np.interp(at.holds_m[i], at.depth_m, at.given_n[i])) / unit_n for at in found]
        panel.plot([CM * at.holds_m[i] for at in found], held, "o", markersize=2.8, zorder=3, **looks)
    for at_omega in found:
        needed = at_omega.needed_n[-1] / unit_n
        stepped_line(panel, CM * at_omega.depth_m, needed, JUMP * float(needed.mean()), color=INK, linewidth=0.7)
    panel.axvline(CM * _critical_m(material), color=FAINT, linestyle=(0, (4, 2)), linewidth=0.8)
    panel.set_xlabel("depth d (cm)")
    depth = found[0].depth_m
    shown = depth >= _shown_from_m(material, found)
    panel.set_xlim(CM * depth[shown][0], CM * depth[-1])
    given = np.concatenate([at.given_n[:, shown] for at in (found[0], found[-1])])
    low = min(float(given.min()), *(float(at.needed_n[-1, shown].min()) for at in found))
    high = max(float(given.max()), *(float(at.needed_n[-1, shown].max()) for at in found))
    panel.set_ylim(0.95 * low / unit_n, HEADROOM * high / unit_n)
    _name_lines(panel, omegas, [float(at.needed_n[-1, shown][0]) / unit_n for at in found])
    key(panel, "φ", columns=4, **ABOVE)
    return "" if one else f"; at {omegas[0]:g} rad/s solid, at {omegas[-1]:g} dashed"


def _critical_m(material: Material) -> float:
    return float(depth_at(material.robot, np.asarray(S_IS_R_RAD)))


def _shown_from_m(material: Material, found: list[Forces]) -> float:
    """The shallowest depth shown, a little above s = R and all depths at which legs hold; 0 where none does."""
    holds = np.array([at.holds_m for at in found])
    if not np.isfinite(holds).any():
        return 0.0
    first = min(float(np.nanmin(holds)), _critical_m(material))
    return first - MARGIN * (float(found[0].depth_m[-1]) - first)


def _depths(material: Material, found: list[Forces]) -> str:
    """The depths at which legs hold on the densest ground, in words."""
    last, (omegas, _) = int(np.argmax([band.phi for band in bands(material.cells)])), frequencies(material.cells)
    held = [(omega, at.holds_m[last]) for omega, at in zip(omegas, found, strict=True) if np.isfinite(at.holds_m[last])]
    if not held:
        return "They never cross."
    return (
        f"At φ {bands(material.cells)[last].phi:.3f} the depth grows from {CM * held[0][1]:.2f} cm at {held[0][0]:g} "
        f"rad/s to {CM * held[-1][1]:.2f} cm at {held[-1][0]:g}; grey: s = R."
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
