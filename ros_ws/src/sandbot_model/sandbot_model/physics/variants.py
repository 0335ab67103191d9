"""Other conventions for an effect's formula: the family is the effect, which convention holds is for the data to say.

An exponent, the width of a ramp and what the first step feels are conventions of whoever wrote the formula down. A
variant has its family's identifier and parameters, so that it takes its place in a catalogue.
"""

from collections.abc import Mapping

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Values
from sandbot_model.physics.formula import formula_effect

_CRATER = "penetration = maximum(z - z_0_m*{left}*clip((1.2*R - step*kept)/({width}*R), 0, 1)*(1 - first), 0)"
_LEFT = "exp(-pi/(omega*tau_s))"
_SLIP = "step, peak_ratio *= clip(1 - sigma*(d_r/maximum(d, 1e-6)){more}, 0, 1)"
_DRAG = "step, peak_ratio *= clip(1 - f_c_n*{more}/maximum(1.5*146e3*w*{depths}, 1e-6), 0, 1)"
_TOUCH_DOWN = "beta*omega*maximum(d + h - R, 0)"
_TIME_LEFT = "maximum(pi/omega - 2*arcsin(clip(s_0/(2*R), 0, 1))/(beta*omega), 0)"
_SLIDING = f"minimum({_TOUCH_DOWN}/(mu_b*g), {_TIME_LEFT})"
_DECAY_S = "0.2/(mu_b*g)"
"""Of friction in proportion to speed that is Coulomb's at 0.2 m/s."""
VARIANTS: Mapping[str, Mapping[str, str]] = {
    "disturbed_ground": {
        "a ramp of 0.3 R": "k - maximum(k - k_l_n_per_m, 0)*clip((s_c*R - step*kept)/(0.3*R), 0, 1)*(1 - first)",
        "a share of k": (
            "k - k*maximum(1 - k_l_n_per_m/K(0.61), 0)*clip((s_c*R - step*kept)/(0.1*R), 0, 1)*(1 - first)"
        ),
    },
    "stance_overlap": {
        "the first step spared": "kept *= 1 - eta*(1 - first)",
        "in proportion to ω": "kept *= maximum(1 - eta*omega/16, 0)",
    },
    "belly_coast": {
        "the first step as any other": f"s + {_TOUCH_DOWN}*{_SLIDING} - 0.5*mu_b*g*{_SLIDING}**2",
        "not cut short by the next step": f"s + ({_TOUCH_DOWN})**2/(2*mu_b*g)",
        "friction in proportion to speed": (
            f"s + {_TOUCH_DOWN}*{_DECAY_S}*(1 - exp(-{_TIME_LEFT}/(1 + first)/({_DECAY_S})))"
        ),
    },
    "swimming_thrust": {
        "by the inverse square of ω": "v_swim = minimum(thrust_m_s2*16/omega**2, R*omega/pi)",
        "by the inverse root of ω": "v_swim = minimum(thrust_m_s2/(16*omega)**0.5, R*omega/pi)",
    },
    "carried_momentum": {
        "of the legs' speed": "Delta_v = maximum(Delta_v - chi_m*R*omega*(1 - first), 0)",
        "by energy": "Delta_v = sqrt(maximum(Delta_v**2 - (chi_m*v)**2*(1 - first), 0))",
    },
    "inertial_drag": {
        "in proportion to speed": "extra_force += lambda_1*600*w*R*(R*16)*(R*omega)",
        "in proportion to speed cubed": "extra_force += lambda_1*600*w*R*(R*omega)**3/(R*16)",
        "in proportion to depth": "extra_force += lambda_1*600*w*d*(R*omega)**2",
    },
    "crater_refill": {
        "a ramp of 0.02 R": _CRATER.format(left=_LEFT, width=0.02),
        "a ramp of 0.3 R": _CRATER.format(left=_LEFT, width=0.3),
        "refilled evenly": _CRATER.format(left="maximum(1 - pi/(omega*2*tau_s), 0)", width=0.1),
        "refilled ever slower": _CRATER.format(left="tau_s/(tau_s + pi/omega)", width=0.1),
    },
    "phi_dependent_response": {"exponential in φ": "delta_t *= exp(b*(phi - 0.61)/0.05)"},
    "cable_drag": {
        "F_x in proportion to depth": _DRAG.format(more=1, depths="d_r*d"),
        "in proportion to the legs' speed": _DRAG.format(more="omega/16", depths="d**2"),
    },
    "leg_slip": {
        "in inverse proportion to depth": _SLIP.format(more=""),
        "by the inverse cube of depth": _SLIP.format(more="**3"),
        "in proportion to ω": _SLIP.format(more="**2*omega/16"),
    },
    "motor_saturation": {
        "a sharper bend": "omega/(1 + (omega/omega_s_rad_s)**4)**0.25",
        "a softer bend": "omega/(1 + omega/(4*omega_s_rad_s))",
    },
}
"""By family: what is different, and the formula's right side as ``--effect`` reads it."""


class Variant(Effect):
    """An effect under another convention; ``variant`` says which."""

    def __init__(self, family: Effect, variant: str, text: str) -> None:
        self.identifier, self.stage, self.parameters = family.identifier, family.stage, family.parameters
        self.source, self.seen_in, self.replaces = family.source, family.seen_in, family.replaces
        self.variant = variant
        ranges = (f"{one.name} in {one.low}..{one.high}" for one in family.parameters)
        self.acts = formula_effect("; ".join((f"{self.identifier}: {self.stage}: {text}", *ranges)))
        self.formula, self.first_step_differs = self.acts.formula, self.acts.first_step_differs

    def apply(self, chain: Chain, p: Values) -> None:
        """Set what the formula says."""
        self.acts.apply(chain, p)


def variants_of(effect: Effect) -> tuple[Effect, ...]:
    """The other conventions of a family; none of an effect that a user has put in its place."""
    if effect.variant or not type(effect).__module__.startswith(f"{__package__}.effects."):
        return ()
    return tuple(Variant(effect, name, text) for name, text in VARIANTS.get(effect.identifier, {}).items())
