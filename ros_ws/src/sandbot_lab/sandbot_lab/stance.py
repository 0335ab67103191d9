"""Stance: the force the ground must provide to hold a leg, and how a held leg carries the body."""

from math import asin, cos, pi, sin, tan
from typing import Any

from sandbot_lab.jit import jit
from sandbot_lab.off_catalogue import advance_factor, x_belly_suction

TRACTION_STRESS = 146e3  # alpha_x [N/m3]: 1.5 alpha_x w d^2 is 4 N at the reference depth
GRAIN_DENSITY = 1100.0
ROUNDING = 1e-9  # rad
CONE = tan(pi / 3.0)  # slope of the cone of grains carried along


@jit
def response_time(p: Any) -> float:
    """Time in which the ground brings the body up to leg speed."""
    if p.phi_dependent_response:
        return float(p.delta_t * (1.0 + p.phi_dependent_response_b * (p.phi - 0.61) / 0.05))
    return float(p.delta_t)


@jit
def velocity_change(p: Any, s: Any, theta: float, rate: float) -> float:
    """Change of velocity [m/s] of the body if the leg's centre is to be fixed in the ground from now on.

    Turning about its fixed centre the leg moves the axle with velocity R rate (cos theta, -sin theta) in (x, z).
    """
    v_x, v_z = p.radius * rate * cos(theta), -p.radius * rate * sin(theta)
    if p.exact_vertical_acceleration:
        return float(max(v_z, 0.0))
    change = (v_x * v_x + v_z * v_z) ** 0.5
    if p.carried_momentum:
        change = max(change - p.carried_momentum_chi_m * s.pace, 0.0)
    return float(change)


@jit
def load(p: Any, s: Any, theta: float, rate: float) -> float:
    """Force [N] the ground must exert on a leg to hold it: weight, and acceleration of the body to leg speed."""
    gravity, mass = p.gravity, p.mass
    if p.bed_slope:
        gravity *= cos(p.bed_slope_chi_deg * pi / 180.0)
    if p.unequal_leg_load:
        mass *= 1.0 + p.unequal_leg_load_x
    inertia = mass
    if p.added_mass:
        volume = pi / 3.0 * (p.width * p.radius / pi) ** 1.5
        inertia += p.added_mass_c_g * p.phi * GRAIN_DENSITY * volume * CONE
    total = mass * gravity + inertia * velocity_change(p, s, theta, rate) / response_time(p)
    if p.x_belly_suction:
        total += x_belly_suction(p)
    return float(total)


@jit
def advance_gain(p: Any, depth: float, rate: float) -> float:
    """Fraction of the leg's chord that becomes advance, after slip."""
    gain = advance_factor(p, rate)
    if p.leg_slip:
        gain *= 1.0 - p.leg_slip_sigma * (p.reference_depth / depth) ** 2
    traction = 1.5 * TRACTION_STRESS * p.width * depth * depth
    if p.cable_drag:
        gain *= 1.0 - p.cable_drag_f_c_n / traction
    if p.bed_slope:
        gain *= 1.0 - p.tripod * p.mass * p.gravity * sin(p.bed_slope_chi_deg * pi / 180.0) / traction
    return max(gain, 0.0)


@jit
def stop_angle(p: Any, grip: float, release: float) -> float:
    """Leg angle at which the advance ends: at touchdown, or earlier where the arriving tripod stops it."""
    if not p.stance_overlap:
        return release
    chord = sin(release) - sin(grip)
    return asin(min(sin(grip) + (1.0 - p.stance_overlap_eta) * chord, 1.0))


@jit
def ripple(p: Any, s: Any, theta: float) -> float:
    """Replicate noise of the peak: extra advance [R] that is zero at grip and stop, with unit slope at theta = 0."""
    span = s.release_angle if theta < 0.0 else s.stop_angle
    if span <= 0.0:
        return 0.0
    return float(p.peak_offset * span / pi * sin(pi * theta / span))


@jit
def ripple_slope(p: Any, s: Any, theta: float) -> float:
    """Derivative of `ripple` with respect to the leg angle."""
    span = s.release_angle if theta < 0.0 else s.stop_angle
    if span <= 0.0:
        return 0.0
    return float(p.peak_offset * cos(pi * theta / span))


@jit
def held_x(p: Any, s: Any, theta: float) -> float:
    """Axle's x while held, the leg at centre angle theta."""
    reached = min(theta, s.stop_angle)
    geometric = s.gain * (sin(reached) - sin(s.grip_angle))
    return float(s.grip_x + p.radius * (geometric + ripple(p, s, reached) - ripple(p, s, s.grip_angle)))


@jit
def held_speed(p: Any, s: Any, theta: float, rate: float) -> float:
    """Forward speed while held."""
    if theta > s.stop_angle + ROUNDING:
        return 0.0
    return float(p.radius * rate * (s.gain * cos(theta) + ripple_slope(p, s, theta)))


@jit
def touchdown_speed(p: Any, s: Any, theta: float) -> float:
    """Forward speed at which the belly meets the ground, from the leg's mean rate during the hold.

    A swing that begins at touchdown does not throw the body forward: the ground needs time to accelerate it.
    """
    if s.t <= s.grip_t:
        return 0.0
    return held_speed(p, s, theta, (theta - s.grip_angle) / (s.t - s.grip_t))


@jit
def swimming_speed(p: Any, stroke_rate: float) -> float:
    """Forward speed if the ground never holds; stroke_rate is the mean leg rate."""
    if p.swimming_thrust and stroke_rate > 0.0:
        return float(min(p.swimming_thrust_a_m_s2 / stroke_rate, p.radius * stroke_rate / pi))
    return float(p.swim)


@jit
def coasting_deceleration(p: Any) -> float:
    """Deceleration of a sliding belly by friction [m/s2]."""
    return float(p.belly_coast_mu_b * p.gravity)
