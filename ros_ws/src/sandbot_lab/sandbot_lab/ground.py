"""The ground: strength and surface at a place on the track, its memory of footholds, and its force on a leg.

Compiled functions on records of `sandbot_lab.physics`: ``p`` the physics of a trial, ``s`` its state.
"""

from math import acos, atan2, cos, exp, pi, sin
from typing import Any

import numpy as np

from sandbot_lab.jit import jit
from sandbot_lab.off_catalogue import strength_factor

FOOT = 0.05  # half length of a foot's print, in leg radii
CRATER_REACH = 1.2  # a crater lowers the surface this far from its centre, in leg radii
NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)

# Li, Zhang & Goldman 2013, generic coefficients [N/cm3]; a flat plate pushed straight down gets their sum.
A00, A10, B11, B01, B_11 = 0.206, 0.169, 0.212, 0.358, 0.055
FLAT_PLATE = A00 + A10 + B11 + B01 + B_11


@jit
def overlap(p: Any, s: Any, x: float) -> float:
    """Fraction of a footprint at x that lies on disturbed ground, 0 to 1.

    Each earlier foothold has disturbed a stretch of half length b = s_c R - a, where a = 0.05 R is the half length of a
    print: the overlap is 0 beyond a distance of s_c R, and 1 within (s_c - 0.1) R.
    """
    foot = FOOT * p.radius
    stretch = p.s_c * p.radius - foot
    most = 0.0
    for i in range(min(s.feet, s.foot_x.size)):
        most = max(most, (foot + stretch - abs(x - s.foot_x[i])) / (2.0 * foot))
    return min(most, 1.0)


@jit
def strength(p: Any, s: Any, x: float, k: float) -> float:
    """Stiffness at x where virgin ground has k."""
    if p.disturbed_ground:
        k -= max(k - p.k_disturbed, 0.0) * overlap(p, s, x)
    elif p.dilation:
        k += (p.k_disturbed - p.k) * overlap(p, s, x)
    return k * strength_factor(p, x, s.steps)


@jit
def surface(p: Any, s: Any, x: float, t: float) -> float:
    """Height of the surface at x: 0, or that of the deepest crater not yet refilled."""
    lowest = 0.0
    if p.crater_refill:
        for i in range(min(s.feet, s.foot_x.size)):
            if abs(x - s.foot_x[i]) < CRATER_REACH * p.radius:
                lowest = min(lowest, -p.crater_refill_z0_m * exp(-(t - s.foot_t[i]) / p.crater_refill_tau_s))
    return lowest


@jit
def disturb(s: Any, x: float, t: float) -> None:
    """Remember a foothold."""
    s.foot_x[s.feet % s.foot_x.size] = x
    s.foot_t[s.feet % s.foot_t.size] = t
    s.feet += 1


@jit
def arc_ends(p: Any, theta: float, depth: float) -> tuple[float, float]:
    """The submerged arc, as angles from the centre of curvature's downward vertical, forward positive.

    The surface cuts the circle symmetrically, but in front the leg's tip may come first: it lies beyond the point
    opposite the hip (-theta) by the excess of the arc over a half circle.
    """
    wetted = acos(min(max(1.0 - depth / p.radius, -1.0), 1.0))
    tip = -theta + p.exact_leg_arc_tip_deg * pi / 180.0 if p.exact_leg_arc else -theta + p.arc_excess
    return -wetted, min(wetted, tip)


@jit
def arc_force(p: Any, theta: float, depth: float, alpha: float) -> float:
    """Vertical yield stress alpha times local depth, over the horizontal extent of the arc (quadrature)."""
    low, high = arc_ends(p, theta, depth)
    half, middle, total = 0.5 * (high - low), 0.5 * (high + low), 0.0
    for i in range(NODES.size):
        psi = middle + half * NODES[i]
        local = depth - p.radius * (1.0 - cos(psi))
        total += WEIGHTS[i] * local * cos(psi)
    return float(alpha * p.width * p.radius * half * total)


@jit
def resistive_stress(tilt: float, course: float) -> float:
    """Vertical stress per depth relative to a flat plate pushed down.

    ``tilt`` of the element from the horizontal and ``course`` of its motion below the horizontal [rad]; the Fourier
    form of Li, Zhang & Goldman 2013 (eq. 1 of its supplement).
    """
    return (
        A00
        + A10 * cos(2.0 * tilt)
        + B11 * sin(2.0 * tilt + course)
        + B01 * sin(course)
        + B_11 * sin(-2.0 * tilt + course)
    ) / FLAT_PLATE


@jit
def resistive_force(p: Any, theta: float, depth: float, alpha: float) -> float:
    """Vertical force from stresses on the arc's elements while the leg turns about the resting axle."""
    low, high = arc_ends(p, theta, depth)
    half, middle, total = 0.5 * (high - low), 0.5 * (high + low), 0.0
    for i in range(NODES.size):
        psi = middle + half * NODES[i]
        local = depth - p.radius * (1.0 - cos(psi))
        # Element relative to the axle, in radii; the leg turns clockwise (x ahead, z up).
        r_x, r_z = -sin(theta) + sin(psi), -cos(theta) - cos(psi)
        v_x, v_z = r_z, -r_x
        if v_x * sin(psi) - v_z * cos(psi) > 0.0:  # only the leading side of the leg is loaded
            side = 1.0 if v_x >= 0.0 else -1.0
            total += WEIGHTS[i] * local * resistive_stress(side * psi, atan2(-v_z, abs(v_x)))
    return float(p.resistive_force_theory_zeta * alpha * p.width * p.radius * half * total)


@jit
def force(p: Any, s: Any, theta: float, rate: float, x: float, z: float, t: float, k: float) -> float:
    """Vertical force [N] on a leg at centre angle theta (0 = below) with its axle at (x, z); virgin stiffness k."""
    foot_x = x - p.radius * sin(theta)
    depth = surface(p, s, foot_x, t) + p.radius * (1.0 + cos(theta)) - z
    if depth <= 0.0:
        return 0.0
    k = strength(p, s, foot_x, k)
    if p.finite_depth:
        k *= 1.0 + exp(-(p.finite_depth_bed_m - depth) / p.finite_depth_length_m)
    alpha = k / (p.width * p.radius)
    if p.resistive_force_theory:
        total = resistive_force(p, theta, depth, alpha)
    elif p.exact_leg_arc:
        total = arc_force(p, theta, depth, alpha)
    elif p.depth_nonlinearity:
        total = k * p.reference_depth * (depth / p.reference_depth) ** p.depth_nonlinearity_n
    else:
        total = k * depth
    if p.cohesion:
        total += 2.0 * p.cohesion_c_pa * p.width * p.radius
    if p.inertial_drag:
        total += p.inertial_drag_lambda_ * 600.0 * p.width * p.radius * (p.radius * rate) ** 2
    return float(total)
