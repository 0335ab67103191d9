"""Effects outside the published catalogue (``x_``): each a factor on strength or advance, or a force.

They let a test ask whether a discovery tool admits that nothing it knows explains the data.
"""

from math import exp, pi, sin
from typing import Any

from sandbot_lab.jit import jit

PHI_LOOSE, PHI_CLOSE = 0.580, 0.633


@jit
def x_foot_clogging(p: Any, rate: float) -> float:
    """Factor on advance: 1 below omega_0, falling linearly to 1 - loss over the width."""
    clogged = (rate - p.x_foot_clogging_omega_0_rad_s) / p.x_foot_clogging_width_rad_s
    return float(1.0 - p.x_foot_clogging_loss * min(max(clogged, 0.0), 1.0))


@jit
def x_resonance(p: Any, rate: float) -> float:
    """Factor on advance: a Lorentzian dip at omega_0."""
    away = (rate - p.x_resonance_omega_0_rad_s) / p.x_resonance_width_rad_s
    return float(1.0 - p.x_resonance_loss / (1.0 + away * away))


@jit
def x_traction_loss(p: Any) -> float:
    """Factor on advance: loss in proportion to how loose the bed is."""
    loose = (PHI_CLOSE - p.phi) / (PHI_CLOSE - PHI_LOOSE)
    return float(1.0 - p.x_traction_loss_loss * min(max(loose, 0.0), 1.0))


@jit
def x_ageing(p: Any, steps: int) -> float:
    """Factor on strength after a number of steps."""
    return float(1.0 - p.x_ageing_loss * (1.0 - exp(-steps / p.x_ageing_steps)))


@jit
def x_periodic_strength(p: Any, x: float) -> float:
    """Factor on strength at place x."""
    return float(1.0 + p.x_periodic_strength_amplitude * sin(2.0 * pi * x / p.x_periodic_strength_length_m))


@jit
def x_belly_suction(p: Any) -> float:
    """Force [N] a leg has to add to lift the belly off."""
    dense = (p.phi - PHI_LOOSE) / (PHI_CLOSE - PHI_LOOSE)
    return float(p.x_belly_suction_force_n * min(max(dense, 0.0), 1.0))


@jit
def advance_factor(p: Any, rate: float) -> float:
    """Product of all factors on advance."""
    factor = 1.0
    if p.x_foot_clogging:
        factor *= x_foot_clogging(p, rate)
    if p.x_resonance:
        factor *= x_resonance(p, rate)
    if p.x_traction_loss:
        factor *= x_traction_loss(p)
    return factor


@jit
def strength_factor(p: Any, x: float, steps: int) -> float:
    """Product of all factors on strength."""
    factor = 1.0
    if p.x_ageing:
        factor *= x_ageing(p, steps)
    if p.x_periodic_strength:
        factor *= x_periodic_strength(p, x)
    return factor
