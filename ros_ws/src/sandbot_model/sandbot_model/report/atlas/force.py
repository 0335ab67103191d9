"""Force given and force needed against depth: by the chosen model (Li09 Fig. 3c), by the full model (Fig. 4a)."""

from typing import TYPE_CHECKING, Any

import numpy as np

from sandbot_common.arrays import Floats
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
        f"{_depths(material, found)}{_falls(material, found)}"
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
    met = np.concatenate([_needed_where_met(at) for at in found])
    low, high = min(float(given.min()), float(met.min())), max(float(given.max()), float(met.max()))
    panel.set_ylim(0.95 * low / unit_n, HEADROOM * high / unit_n)
    _name_lines(panel, omegas, np.array([at.needed_n[-1, shown][[0, -1]] for at in found]) / unit_n)
    key(panel, "φ", columns=5, **ABOVE)
    return "" if one else f"; at {omegas[0]:g} rad/s solid, at {omegas[-1]:g} dashed"


def _needed_where_met(at: Forces) -> Floats:
    """The force needed from the depth at which a leg first holds, or at the greatest if none does: above that depth it
    may be far beyond all that the ground gives."""
    first = float(np.nanmin(at.holds_m)) if np.isfinite(at.holds_m).any() else np.inf
    needed: Floats = at.needed_n[-1, at.depth_m >= min(first, float(at.depth_m[-1]))]
    return needed


def _falls(material: Material, found: list[Forces]) -> str:
    """The depth at which the force needed falls as the slow phase begins, in words; empty if it does not."""
    depth, needed = found[-1].depth_m, found[-1].needed_n[-1]
    clock = material.cells.clock
    begins = np.unique(material.fit.model.walker.slow_begin_m(clock)[~clock.one_rate])
    before, after = (np.clip(np.searchsorted(depth, begins) + by, 0, len(depth) - 1) for by in (-2, 1))
    falls = begins[needed[before] - needed[after] > JUMP * needed.mean()]
    where = " and ".join(f"{CM * at_m:.2f}" for at_m in falls if at_m > _shown_from_m(material, found))
    return f" The force needed falls (dotted) at {where} cm, where the slow phase begins." if where else ""


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


def _name_lines(panel: "Axes", omegas: Floats, ends: Floats) -> None:
    """Label lines with ω at their left or right ``ends``, (n, 2), wherever more are apart and within the panel."""
    low, high = panel.get_ylim()
    left, right = (_apart(ends[:, side], low, high) for side in (0, 1))
    x, align, named, side = (0.02, "left", left, 0) if len(left) >= len(right) else (0.98, "right", right, 1)
    for i in named:
        panel.annotate(
            f"ω {omegas[i]:g}", (x, ends[i, side]), xycoords=("axes fraction", "data"), va="center", ha=align,
            fontsize=5.5, color=INK, bbox={"color": "white", "pad": 0.4},
        )  # fmt: skip


def _apart(heights: Floats, low: float, high: float) -> list[int]:
    """The lines to label, fastest first: those within the panel that are not too close to a labelled one."""
    found: list[int] = []
    for i in reversed(range(len(heights))):
        above = heights[found[-1]] if found else high
        if heights[i] > low and above - heights[i] >= MIN_LABEL_GAP * (high - low):
            found.append(i)
    return found


def _range(material: Material) -> str:
    omegas, _ = frequencies(material.cells)
    return f"{omegas[0]:g} to {omegas[-1]:g} rad/s" if len(omegas) > 1 else f"{omegas[0]:g} rad/s"
