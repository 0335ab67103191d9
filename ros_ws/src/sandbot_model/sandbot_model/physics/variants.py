"""Variants of effects: the same effect with another convention in its formula, to be chosen by the data.

An exponent, the width of a ramp, a law of friction, and whether the first step or the peak of v_x(t) are affected are
conventions of whoever wrote the formula. A variant differs from the formula of its family, an effect of the catalogue,
in one of them; it has the family's identifier and parameters, and can replace it in a catalogue. Where the convention
is a number (``power``; ``part``; ``log_width``, a ramp of 10^log_width R; ``reach``, where it begins; a time or a
length), that is an additional parameter, fitted and penalised like any other.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Parameter, Values, is_from_catalogue
from sandbot_model.physics.formula import formula_effect

_POWER = "; power [1] in {}..{}"
_EITHER = _POWER.format(-2, 2)
_GROWS = _POWER.format(0, 2)
"""Range for losses by contact or friction, which grow with pace: with the time of double stance, or speed squared."""
_BY_OMEGA = "(omega/16)**power"
_DEPTH = "maximum(d, 1e-6)"
_WIDTH = "; log_width [1] in -2..0"
_RAMP = "clip(({reach} - {at})/10**log_width, 0, 1)*(1 - first)"
_STEP = _RAMP.format(reach="{reach}", at="step*kept/R")
_DISTURBED = _STEP.format(reach="s_c")
_SMOOTH = "(1 - first)/(1 + exp((step*kept/R - s_c)/10**log_width)); log_width [1] in -2.5..-0.5"
_USUAL = "clip((s_c*R - step*kept)/(0.1*R), 0, 1)*(1 - first)"
_OVER_DEPTH = _RAMP.format(reach="s_c", at=f"step*kept/{_DEPTH}")
_USUAL_K = "(1.2227*m*g/(2*R - h))"
"""k of ground on which a robot walks: SandBot's 200 N/m."""
_DILATED = "(K(phi + xi*(phi_c - phi)) - K(phi))"
_CRATER = f"penetration = maximum(z - z_0_m*{{left}}*{_STEP.format(reach='1.2')}, 0){_WIDTH}"
_SLIP = "step, peak_ratio *= clip(1 - sigma*{}, 0, 1)"
_DRAG = "step, peak_ratio *= clip(1 - f_c_n/maximum(1.5*146e3*w*d_r**2, 1e-6)*{}, 0, 1)"
_LOAD = "maximum(0.6*k*d, 1e-6)"
"""The load on a leg [N], 4 N like F_x where legs stand: by friction its horizontal force is a fraction of it."""
_SLOWER = f"(d_r/{_DEPTH})**2"
_TURNED = "2*arcsin(clip(s_0/(2*R), 0, 1))"
_TOUCH_DOWN = f"{_TURNED}/t_s*maximum(d + h - R, 0)"
_LEGS = "R*omega*where(d + h > R, 1, 0)"
_SLOWLY = "beta*omega*maximum(d + h - R, 0)"
_LEFT_SLOWLY = f"maximum(pi/omega - {_TURNED}/(beta*omega), 0)/(1 + first)"
_TIME_LEFT = "maximum(pi/omega - t_s, 0)"
_SPARED = f"{_TIME_LEFT}*(1 - first)"
_FORGOTTEN = "exp(-pi/(omega*tau_m_s))*(1 - first)"
_TAU = "; tau_m_s [s] in 0.05..1"
_COULOMB = "s + {u}*minimum({u}/(mu_b*g), {left}) - 0.5*mu_b*g*minimum({u}/(mu_b*g), {left})**2"
_AT = 0.4
"""Speed [m/s] at which other laws of friction equal Coulomb's: that of a body at touch-down."""
_DECAY_S = f"{_AT}/(mu_b*g)"
_DECAY_M = f"{_AT}**2/(mu_b*g)"
_VISCOUS = f"s + maximum(share, 0)*{_TOUCH_DOWN}*{_DECAY_S}*(1 - exp(-{{left}}/({_DECAY_S}))); share [1] in 0.1..1"
"""Viscous friction; the belly may keep only a ``share`` of the speed as it comes down."""
_SQUARE = f"s + {_DECAY_M}*log(1 + {_TOUCH_DOWN}*{{left}}/({_DECAY_M}))"
AT_THE_SLOW_RATE, BY_THE_MEAN_RATE = "all of a stance at the slow rate", "by the mean rate"
PAST_THE_NEXT_LEG = "no stance cut short by the next leg"
OF_PHASES = (AT_THE_SLOW_RATE, BY_THE_MEAN_RATE, PAST_THE_NEXT_LEG)
"""Variants that neglect something of a gait with two phases; where legs turn at one rate they equal their family."""
IN_ANOTHER_BED = "in a bed of another depth"
"""The same formula with a bed depth that differs from the one in the robot's file."""
BY_ITS_TILT = "by the square of how far a leg tilts"
"""A one-parameter bend of the force law, which many causes can imitate: it counts against a claim, but is no claim."""
_PSI_MAX = "arccos(clip(1 - z/R, -1, 1))"
_PSI_MIN = f"minimum({_PSI_MAX}, arccos(clip((d + h)/R - 1, -1, 1)) + Delta_xi)"
_ON_ARC = " + ".join(f"R/2*({psi} + cos({psi})*sin({psi})) + (z - R)*sin({psi})" for psi in (_PSI_MAX, _PSI_MIN))
_UNDER = "clip((d/(2*R - h) - 0.89)/0.11, 0, 1)"
"""Ramp from the depth at which the end of a leg goes under to the one at which the robot swims."""
_CHORD = "sqrt(maximum(R**2 - (d*{} + h - R)**2, 0))"
_OF_A_TRIPOD = f"({_CHORD.format('(1 + x)')} + 2*{_CHORD.format('(1 - x/2)')})/(1.5*maximum(s_0, 1e-6))"
"""Mean step of a middle leg that carries more and of two outer legs, over that of equally loaded legs."""
VARIANTS: Mapping[str, Mapping[str, str]] = {
    "disturbed_ground": {
        "a ramp of another width": f"k - maximum(k - k_l_n_per_m, 0)*{_DISTURBED}{_WIDTH}",
        "a smooth ramp": f"k - maximum(k - k_l_n_per_m, 0)*{_SMOOTH}",
        "a share of k": f"k - k*(1 - k_l_n_per_m/{_USUAL_K})*{_DISTURBED}{_WIDTH}",
        "a share of k, by a smooth ramp": f"k - k*(1 - k_l_n_per_m/{_USUAL_K})*{_SMOOTH}",
        "a part of k beyond k_L": f"k - part*maximum(k - k_l_n_per_m, 0)*{_USUAL}; part [1] in 0.2..1",
        "by step over depth": f"k - maximum(k - k_l_n_per_m, 0)*{_OVER_DEPTH}{_WIDTH}",
    },
    "stance_overlap": {
        "the first step spared": "kept *= 1 - eta*(1 - first)",
        "by a power of ω": f"kept *= maximum(1 - eta*{_BY_OMEGA}, 0){_GROWS}",
        "the first step spared, by a power of ω": f"kept *= maximum(1 - eta*{_BY_OMEGA}*(1 - first), 0){_EITHER}",
        "a length of each step": "kept *= maximum(1 - eta*R/maximum(step, 1e-6), 0)",
        "by a power of depth": f"kept *= maximum(1 - eta*({_DEPTH}/d_r)**power, 0){_POWER.format(-3, 3)}",
    },
    "belly_coast": {
        "the first step as any other": _COULOMB.format(u=_TOUCH_DOWN, left=_TIME_LEFT),
        AT_THE_SLOW_RATE: _COULOMB.format(u=_SLOWLY, left=_LEFT_SLOWLY),
        "not cut short by the next step, over a power of speed": (
            f"s + {_AT}**2/(2*mu_b*g)*({_TOUCH_DOWN}/{_AT})**power{_POWER.format(1, 3)}"
        ),
        "friction in proportion to speed": _VISCOUS.format(left="t_left"),
        "friction in proportion to speed, the first step as any other": _VISCOUS.format(left=_TIME_LEFT),
        "friction by the square of speed": _SQUARE.format(left="t_left"),
        "friction by the square of speed, the first step as any other": _SQUARE.format(left=_TIME_LEFT),
        "the first step spared": _COULOMB.format(u=_TOUCH_DOWN, left=_SPARED),
        "friction in proportion to speed, the first step spared": _VISCOUS.format(left=_SPARED),
        "up to a length": (f"s + reach_m*tanh(({_TOUCH_DOWN})**2/(2*mu_b*g*reach_m)); reach_m [m] in 0.002..0.05"),
        "from the legs' speed": _COULOMB.format(u=_LEGS, left="t_left"),
        "from the legs' speed, not cut short by the next step": f"s + ({_LEGS})**2/(2*mu_b*g)",
    },
    "swimming_thrust": {
        "by a power of ω": (f"v_swim = minimum(thrust_m_s2/16*(16/omega)**power, R*omega/pi){_POWER.format(0, 3)}"),
        "in series with the legs": "v_swim = 1/(omega/maximum(thrust_m_s2, 1e-6) + pi/(R*omega))",
    },
    "carried_momentum": {
        "of the legs' speed": "Delta_v = maximum(Delta_v - chi_m*R*omega*(1 - first), 0)",
        "forgotten in time": f"Delta_v = maximum(Delta_v - chi_m*v*{_FORGOTTEN}, 0){_TAU}",
        "of the legs' speed, forgotten in time": f"Delta_v = maximum(Delta_v - chi_m*R*omega*{_FORGOTTEN}, 0){_TAU}",
        "by energy": "Delta_v = sqrt(maximum(Delta_v**2 - (chi_m*v)**2*(1 - first), 0))",
        "by a power of ω": f"Delta_v = maximum(Delta_v - chi_m*v*{_BY_OMEGA}*(1 - first), 0){_EITHER}",
    },
    "inertial_drag": {
        "by another power of speed": f"extra_force += lambda_1*600*w*R*(R*16)**2*{_BY_OMEGA}{_POWER.format(0, 4)}",
        "by a power of depth": f"extra_force += lambda_1*600*w*R*({_DEPTH}/R)**power*(R*omega)**2{_POWER.format(0, 2)}",
        "by a power of how steeply a leg comes down": (
            f"extra_force += lambda_1*600*w*R*(s_0/(2*R))**power*(R*omega)**2{_POWER.format(0, 3)}"
        ),
    },
    "crater_refill": {
        "a ramp of another width": _CRATER.format(left="exp(-pi/(omega*tau_s))"),
        "refilled evenly": _CRATER.format(left="maximum(1 - pi/(omega*2*tau_s), 0)"),
        "refilled ever slower": _CRATER.format(left="tau_s/(tau_s + pi/omega)"),
    },
    "phi_dependent_response": {"exponential in φ": "delta_t *= exp(b*(phi - 0.61)/0.05)"},
    "cable_drag": {
        "by another power of depth": f"{_DRAG.format(f'(d_r/{_DEPTH})**power')}{_POWER.format(0, 3)}",
        "by a power of ω": f"{_DRAG.format(f'{_SLOWER}*{_BY_OMEGA}')}{_GROWS}",
        "the first step spared": _DRAG.format(f"{_SLOWER}*(1 - first)"),
        # As much of a step of 46 mm on 200 N/m as F_x of 4 N lets the catalogue's formula take.
        "by the ground's stiffness, the peak spared": "step = maximum(s - 2.3*f_c_n/k, 0)",
    },
    "bed_slope": {
        "by the load the ground bears, the peak spared": f"step *= maximum(1 - N*m*g*sin(chi_rad)/{_LOAD}, 0)"
    },
    "leg_slip": {
        "by another power of depth": f"{_SLIP.format(f'(d_r/{_DEPTH})**power')}{_POWER.format(0, 4)}",
        "by a power of ω": f"{_SLIP.format(f'{_SLOWER}*{_BY_OMEGA}')}{_GROWS}",
        "the first step spared": _SLIP.format(f"{_SLOWER}*(1 - first)"),
        "above a depth": (
            f"{_SLIP.format('clip(0.5 + (d_0_m - d)/10**log_width, 0, 1)')}"
            "; d_0_m [m] in 0.02..0.05; log_width [1] in -3..-1.5"
        ),
        "the peak spared": f"step *= clip(1 - sigma*(d_r/{_DEPTH})**power, 0, 1){_POWER.format(1, 3)}",
        "the peak spared, by a power of ω": f"step *= clip(1 - sigma*{_SLOWER}*{_BY_OMEGA}, 0, 1){_GROWS}",
    },
    "exact_leg_arc": {
        "more lost as the leg's end goes under": (
            f"F*({_ON_ARC})/maximum(z, 1e-6)*(1 - part*{_UNDER}); part [1] in 0..0.3"
        )
    },
    "resistive_force_theory": {BY_ITS_TILT: "F*(1 - part*((1 - z/R)**2 - (1 - d_r/R)**2)); part [1] in 0.5..2"},
    "exact_vertical_acceleration": {"a power of the sine": f"lift_ratio *= (s_0/(2*R))**power{_POWER.format(0.5, 3)}"},
    "dilation": {"another ramp": f"k + {_DILATED}*{_STEP.format(reach='reach')}{_WIDTH}; reach [1] in 0.6..2"},
    "finite_depth": {IN_ANOTHER_BED: "k*(1 + exp(-(bed_m - z)/l_m)); bed_m [m] in 0.05..0.2"},
    "slow_phase_speed": {PAST_THE_NEXT_LEG: "Delta_v *= beta; peak *= rho"},
    "unequal_leg_load": {
        "a step is the mean of its legs'": f"k *= where((1 + x)*z > 2*R - h, 0, 1); step *= {_OF_A_TRIPOD}"
    },
    "motor_saturation": {
        BY_THE_MEAN_RATE: "omega/sqrt(1 + (omega/omega_s_rad_s)**2)",
        "another bend": f"omega/(1 + 0.5*(30/omega_s_rad_s)**2*(omega/30)**power){_POWER.format(1, 6)}",
    },
}
"""By family: the name of each convention, and its formula as in ``--effect``, with ranges of new parameters."""


NEW = "the convention, as a number"
"""Description of a parameter that a variant has in addition to its family's."""


def _convention_parameter(parameter: Parameter) -> Parameter:
    """The parameter of a convention: an exponent may be any number, a time or a length must be positive."""
    hard_low = parameter.hard_low if parameter.unit == "1" else 0.1 * parameter.low
    return replace(parameter, doc=NEW, hard_low=hard_low)


class Variant(Effect):
    """An effect with another convention, named ``variant``; ``as_formula`` is the same as a separate ``--effect``."""

    def __init__(self, family: Effect, variant: str, text: str) -> None:
        self.family = family
        self.identifier, self.stage, self.variant = family.identifier, family.stage, variant
        self.source, self.seen_in, self.replaces = family.source, family.seen_in, family.replaces
        self.control = family.control
        self.of_phases = variant in OF_PHASES
        """Whether it differs from its family only where legs turn at two rates."""
        ranges = (f"{p.name} [{p.unit}] in {p.low}..{p.high}" for p in family.parameters)
        acts = "; ".join((f"{self.stage}: {text}", *ranges))
        self.acts = formula_effect(f"{self.identifier}: {acts}", tried=True)
        self.as_formula = f"{self.identifier}_variant: {acts}"
        own = {p.name for p in family.parameters}
        self.parameters = (
            *family.parameters,
            *(_convention_parameter(p) for p in self.acts.parameters if p.name not in own),
        )
        self.formula, self.first_step_differs = self.acts.formula, self.acts.first_step_differs
        self.at_the_slow_rate = family.at_the_slow_rate

    def apply(self, chain: Chain, p: Values) -> None:
        """Apply the formula."""
        self.acts.apply(chain, p)


def variants_of(effect: Effect) -> tuple[Variant, ...]:
    """The variants of an effect of the catalogue; none if a user has replaced it."""
    return () if effect.variant or not is_from_catalogue(effect) else _variants(effect)


@lru_cache(maxsize=64)
def _variants(effect: Effect) -> tuple[Variant, ...]:
    return tuple(Variant(effect, name, text) for name, text in VARIANTS.get(effect.identifier, {}).items())


def with_variants(conventions: Mapping[str, str], effects: Mapping[str, Effect]) -> dict[str, Effect]:
    """A catalogue with variants, by name, in place of some effects. Raises KeyError for an unknown one."""
    by_name = {name: {variant.variant: variant for variant in variants_of(effects[name])} for name in conventions}
    return {**effects, **{name: by_name[name][variant] for name, variant in conventions.items()}}
