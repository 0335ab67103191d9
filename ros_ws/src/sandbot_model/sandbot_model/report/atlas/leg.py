"""The leg in the ground, to scale (Li09 Fig. 3a), and step length against depth (Fig. 3b)."""

from typing import TYPE_CHECKING, Any

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_common.robot import SANDBOT, Robot
from sandbot_model.physics.geometry import chord, deepest_m, depth_at
from sandbot_model.physics.observables import CM
from sandbot_model.report.atlas.material import Material, usual
from sandbot_model.report.atlas.style import ACCENT, FAINT, INK, S_IS_R_RAD, sheet
from sandbot_model.report.view import frequencies

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GROUND = "#e9dfc9"
POINTS = 200


def in_the_ground(material: Material, width_mm: float) -> "tuple[Figure, str]":
    """Fig. 3a: a leg at the start (solid) and at the end of stance (dashed), drawn from the fit."""
    robot, fit = material.robot, material.fit
    omegas, _ = frequencies(material.cells)
    omega = usual(omegas)
    found = fit.predict(fit.level_phi, np.full_like(fit.level_phi, omega))
    level = int(np.flatnonzero(found.walking)[-1]) if found.walking.any() else -1
    depth = float(found.depth_m[level]) if level >= 0 else deepest_m(robot)
    figure, (panel,) = sheet(width_mm, 0.75 * width_mm)
    step = float(chord(robot, np.asarray(depth)))
    _leg(panel, robot, depth, -1.0, linestyle="-")
    _leg(panel, robot, depth, 1.0, linestyle=(0, (3, 2)))
    _measures(panel, robot, depth, step)
    panel.set_aspect("equal")
    top = max(2 * robot.leg_radius_m - depth, _s_height(robot))
    panel.set_ylim(-1.25 * CM * depth, CM * (top + 0.2 * robot.leg_radius_m))
    panel.axis("off")
    if level < 0:
        return (
            figure,
            f"A leg at its deepest, 2R − h = {CM * depth:.2f} cm: at {omega:g} rad/s no ground here holds it.",
        )
    return figure, (
        f"A leg in the ground, to scale, from the fit at φ {fit.level_phi[level]:.3f} and {omega:g} rad/s: "
        f"R = {CM * robot.leg_radius_m:.2f} cm, h = {CM * robot.axle_height_m:.2f} cm; it holds at d = "
        f"{CM * depth:.2f} cm, and the body moves by the chord s = {CM * step:.2f} cm = "
        f"{step / robot.leg_radius_m:.2f} R about the leg's centre, which stands still. Solid: the leg starts to hold; "
        "dashed: the belly is back on the ground."
    )


def _leg(panel: "Axes", robot: Robot, depth: float, side: float, **looks: Any) -> None:
    """The c-leg about its centre, depth - R below the surface; ``side`` -1: start, +1: end of stance."""
    radius = robot.leg_radius_m
    centre = radius - depth
    angle = side * np.arcsin(np.clip(float(chord(robot, np.asarray(depth))) / (2 * radius), 0.0, 1.0))
    axle = np.array([radius * np.sin(angle), centre + radius * np.cos(angle)])
    arc = angle + np.linspace(0.0, np.pi + robot.arc_excess_rad, POINTS)
    panel.plot(CM * radius * np.sin(arc), CM * (centre + radius * np.cos(arc)), color=INK, linewidth=1.8, **looks)
    panel.plot(*(CM * axle), "o", color=INK, markersize=4, markerfacecolor="white" if side > 0 else INK)
    belly = axle[1] - robot.axle_height_m
    reach = 0.8 * radius
    panel.plot(CM * (axle[0] + np.array([-reach, reach])), CM * np.array([belly, belly]), color=FAINT, **looks)


def _measures(panel: "Axes", robot: Robot, depth: float, step: float) -> None:
    """The surface, and R, h, d, s as arrows."""
    radius, height = robot.leg_radius_m, robot.axle_height_m
    wide = 2.1 * radius
    panel.fill_between(CM * np.array([-wide, wide]), CM * -1.25 * depth, 0.0, color=GROUND, linewidth=0, zorder=0)
    panel.plot(CM * np.array([-wide, wide]), [0, 0], color=INK, linewidth=0.7)
    centre = radius - depth
    panel.plot(0, CM * centre, "+", color=ACCENT, markersize=6)
    above = _s_height(robot)
    arrows = (
        ((0.0, centre), (-radius * 0.7071, centre - radius * 0.7071), "R"),
        ((-1.7 * radius, 0.0), (-1.7 * radius, -depth), "d"),
        ((-step / 2, above), (step / 2, above), "s"),
        ((-step / 2 - 0.25 * radius, 0.0), (-step / 2 - 0.25 * radius, height), "h"),
    )
    for start, end, name in arrows:
        (x, z), (to_x, to_z) = ((CM * metres for metres in point) for point in (start, end))
        looks = {"arrowstyle": "<->" if name != "R" else "->", "color": ACCENT, "lw": 0.8, "shrinkA": 0, "shrinkB": 0}
        panel.annotate("", (to_x, to_z), (x, z), arrowprops=looks)
        panel.text((x + to_x) / 2 + 0.12, (z + to_z) / 2 + 0.12, name, color=ACCENT, style="italic", fontsize=8)


def _s_height(robot: Robot) -> float:
    """Height at which the arrow of s is drawn [m]."""
    return robot.axle_height_m + 0.35 * robot.leg_radius_m


def step_against_depth(material: Material, width_mm: float) -> "tuple[Figure, str]":
    """Fig. 3b: the chord s(d), with s = R and the corresponding depth."""
    robot = material.robot
    radius, deepest = robot.leg_radius_m, deepest_m(robot)
    depth: Floats = np.linspace(max(radius - robot.axle_height_m, 0.0), deepest, POINTS)
    critical = float(depth_at(robot, np.asarray(S_IS_R_RAD)))
    figure, (panel,) = sheet(width_mm, 0.7 * width_mm)
    panel.plot(CM * depth, CM * chord(robot, depth), color=ACCENT)
    panel.axhline(CM * radius, color=FAINT, linestyle=(0, (4, 2)), linewidth=0.8)
    panel.axvline(CM * critical, color=FAINT, linestyle=(0, (4, 2)), linewidth=0.8)
    panel.annotate("s = R", (CM * depth[0], CM * radius), xytext=(2, 3), textcoords="offset points", fontsize=7)
    panel.set_xlabel("depth d (cm)")
    panel.set_ylabel("step length s (cm)")
    panel.set_xlim(CM * depth[0], 1.02 * CM * deepest)
    panel.set_ylim(bottom=0)
    # The paper's own robot.
    li09 = (radius, deepest) == (SANDBOT.leg_radius_m, deepest_m(SANDBOT))
    printed = "; the paper prints 5.0 cm, which is deeper than a leg can be" if li09 else ""
    return figure, (
        f"Step length against depth: s = R = {CM * radius:.2f} cm at d = {CM * critical:.3f} cm (dashed{printed}), "
        f"s = 0 at 2R − h = {CM * deepest:.2f} cm."
    )
