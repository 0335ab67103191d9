"""The physical effects a world may contain: identifier, parameters with unit and bounds, and where each one acts.

``EFFECTS`` is the single source: the world file is checked against it and the kernel's flat parameter record is built
from it (`sandbot_lab.physics`). Identifiers that begin with ``x_`` are outside the published catalogue: for them a
discovery tool must answer "unexplained".
"""

import math
from dataclasses import dataclass

from sandbot_common.errors import InputError
from sandbot_common.parameters import Spec, check
from sandbot_common.suggest import did_you_mean


@dataclass(frozen=True)
class EffectParameter:
    """One number of an effect, with inclusive bounds, and its default."""

    spec: Spec
    default: float
    catalogue: str = ""
    """The name in the catalogue of effects, accepted in its place; empty if that is the same."""
    of_catalogue: float = 1.0
    """Its value for a value of 1 in the catalogue's unit."""

    @property
    def name(self) -> str:
        """Its name in a world file."""
        return self.spec.name


@dataclass(frozen=True)
class Effect:
    """What one effect does to the state, and its parameters."""

    doc: str
    parameters: tuple[EffectParameter, ...] = ()

    def defaults(self) -> dict[str, float]:
        """The default value of every parameter."""
        return {parameter.name: parameter.default for parameter in self.parameters}


def P(
    name: str,
    default: float,
    low: float,
    high: float,
    unit: str,
    doc: str,
    catalogue: str = "",
    of_catalogue: float = 1.0,
) -> EffectParameter:
    """A parameter that is a float."""
    return EffectParameter(Spec(name, float, unit, doc, low, high, choices=()), default, catalogue, of_catalogue)


EFFECTS: dict[str, Effect] = {
    # strength of the ground
    "disturbed_ground": Effect(
        "a foot leaves a weaker stretch at its place; a later foot that overlaps it finds strength k_l (Li09)",
        (
            P("k_l_n_per_m", 175.0, 150.0, 250.0, "N/m", "stiffness of disturbed ground"),
            P("s_c", 0.95, 0.7, 1.2, "R", "distance between footholds below which they begin to overlap"),
        ),
    ),
    "dilation": Effect(
        "disturbed ground dilates or compacts towards the critical volume fraction (Gravish 2010)",
        (
            P("xi", 0.6, 0.0, 1.0, "", "part of the way to the critical volume fraction"),
            P("phi_c", 0.600, 0.58, 0.633, "", "critical volume fraction"),
            P("s_c", 0.95, 0.7, 1.2, "R", "distance between footholds below which they begin to overlap"),
        ),
    ),
    "crater_refill": Effect(
        "a foothold leaves a crater that refills as exp(-t/tau): a lower surface for a foot within 1.2 R (Li09)",
        (
            P("z0_m", 0.010, 0.0, 0.015, "m", "depth of the fresh crater", "z_0_m"),
            P("tau_s", 0.15, 0.02, 1.0, "s", "refill time"),
        ),
    ),
    "phi_nonuniformity": Effect(
        "the volume fraction varies along the track from step to step (Li09)",
        (P("sigma_phi", 0.003, 0.0, 0.01, "", "standard deviation of the local volume fraction"),),
    ),
    "finite_depth": Effect(
        "the container's floor stiffens the ground: k (1 + exp(-(D - z)/l)) (Stone 2004)",
        (
            P("length_m", 0.02, 0.01, 0.03, "m", "decay length of the floor's influence", "l_m"),
            P("bed_m", 0.0, 0.0, 0.15, "m", "depth D of the bed; 0: the robot's bed_depth_m"),
        ),
    ),
    "depth_nonlinearity": Effect(
        "penetration force k d_r (z/d_r)^n, d_r of the robot (Kang 2018)",
        (P("n", 1.2, 0.8, 1.5, "", "exponent of depth"),),
    ),
    "cohesion": Effect("penetration force + 2 c w R", (P("c_pa", 200.0, 0.0, 500.0, "Pa", "cohesion"),)),
    "unequal_leg_load": Effect(
        "the middle leg of a tripod carries m (1 + x), the outer ones m (1 - x/2); it decides when the ground holds",
        (P("x", 0.05, 0.0, 0.5, "", "excess load of the middle leg"),),
    ),
    # force balance at the moment the ground takes hold
    "exact_vertical_acceleration": Effect(
        "only the vertical component of the velocity the leg imparts has to be supported (Li09, full model)"
    ),
    "exact_leg_arc": Effect(
        "yield stress alpha*depth summed over the submerged arc of the leg, tip included (Li09, full model)",
        (P("tip_deg", 0.0, 0.0, 60.0, "deg", "arc beyond the half circle; 0: the robot's"),),
    ),
    "resistive_force_theory": Effect(
        "stress on each element of the arc depends on its tilt and direction of motion (Li, Zhang & Goldman 2013)",
        (P("zeta", 1.5, 0.3, 5.0, "", "scale of the stress; 1 gives a flat plate pushed down the strength alpha"),),
    ),
    "inertial_drag": Effect(
        "penetration force + lambda rho_b w R (R omega)^2, rho_b = 600 kg/m3 (Katsuragi & Durian 2007)",
        (P("lambda_", 1.0, 0.0, 5.0, "", "drag coefficient", "lambda_1"),),
    ),
    "phi_dependent_response": Effect(
        "the ground's response time is dt0 [1 + b (phi - 0.61)/0.05] (Li09)",
        (P("b", 0.5, -0.8, 1.5, "", "relative change of response time over 0.05 of volume fraction"),),
    ),
    "added_mass": Effect(
        "grains carried along add inertia (Aguilar & Goldman 2016)",
        (P("c_g", 2.7, 0.0, 10.0, "", "added mass coefficient"),),
    ),
    "carried_momentum": Effect(
        "a moving body needs less impulse: the velocity change is R omega - chi_m v",
        (P("chi_m", 0.5, 0.0, 1.0, "", "part of the mean speed that survives from step to step"),),
    ),
    # the step
    "stance_overlap": Effect(
        "the arriving tripod stops the forward advance for the last part of the chord (Li09)",
        (P("eta", 0.15, 0.0, 0.4, "", "fraction of the chord lost"),),
    ),
    "leg_slip": Effect(
        "during a hold the contact slips backwards: advance (1 - sigma (d_r/d)^2), d_r of the robot",
        (P("sigma", 0.15, 0.0, 0.4, "", "slip at the reference depth"),),
    ),
    "cable_drag": Effect(
        "the cable's pull makes the contact slip by force over horizontal resistance 1.5 alpha_x w d^2",
        (P("f_c_n", 0.3, 0.0, 1.0, "N", "pull of the cable"),),
    ),
    "bed_slope": Effect(
        "the bed is inclined along the track, positive uphill",
        (P("chi_deg", 1.0, -3.0, 3.0, "deg", "slope", "chi_rad", math.degrees(1.0)),),
    ),
    "belly_coast": Effect(
        "after touchdown the belly slides with Coulomb friction from its touchdown speed",
        (P("mu_b", 1.0, 0.2, 2.0, "", "friction coefficient of belly on grains"),),
    ),
    "swimming_thrust": Effect(
        "a swimming robot moves at min(A/omega, R omega/pi) in place of a constant (Li09)",
        (P("a_m_s2", 0.32, 0.05, 1.0, "m/s2", "thrust constant A", "thrust_m_s2"),),
    ),
    # the clock
    "motor_saturation": Effect(
        "legs turn at omega / sqrt(1 + (omega/omega_s)^2) (Li09)",
        (P("omega_s_rad_s", 60.0, 20.0, 300.0, "rad/s", "rate at which the motors fall behind"),),
    ),
    # outside the catalogue
    "x_foot_clogging": Effect(
        "fast feet stay clogged with grains and lose advance above a rate",
        (
            P("loss", 0.3, 0.0, 0.8, "", "advance lost when fully clogged"),
            P("omega_0_rad_s", 10.0, 2.0, 40.0, "rad/s", "rate at which clogging sets in"),
            P("width_rad_s", 8.0, 1.0, 20.0, "rad/s", "rate range over which it becomes full"),
        ),
    ),
    "x_resonance": Effect(
        "the body's bounce takes traction away near one leg rate",
        (
            P("loss", 0.35, 0.0, 0.8, "", "advance lost at the resonance"),
            P("omega_0_rad_s", 12.0, 2.0, 40.0, "rad/s", "resonant leg rate"),
            P("width_rad_s", 2.0, 0.3, 10.0, "rad/s", "half width"),
        ),
    ),
    "x_traction_loss": Effect(
        "loose ground flows away behind the leg: advance lost in proportion to looseness",
        (P("loss", 0.4, 0.0, 0.9, "", "advance lost at phi = 0.580, none at 0.633"),),
    ),
    "x_ageing": Effect(
        "walking shakes the whole bed: strength falls with the number of steps taken",
        (
            P("loss", 0.15, 0.0, 0.5, "", "strength lost in the end"),
            P("steps", 4.0, 1.0, 50.0, "steps", "steps to lose 63 % of that"),
        ),
    ),
    "x_periodic_strength": Effect(
        "strength varies periodically along the track, as from a patterned air distributor",
        (P("amplitude", 0.10, 0.0, 0.5, "", "relative amplitude"), P("length_m", 0.10, 0.02, 1.0, "m", "period")),
    ),
    "x_belly_suction": Effect(
        "lifting the belly off dense grains has to break a seal",
        (P("force_n", 0.5, 0.0, 5.0, "N", "force of the seal at phi = 0.633, none at 0.580"),),
    ),
}

DRAWN = (
    "disturbed_ground",
    "exact_vertical_acceleration",
    "exact_leg_arc",
    "stance_overlap",
    "swimming_thrust",
    "leg_slip",
)
"""The effects among which `draw_world` draws."""


def checked_effect(name: object, given: object, where: str) -> dict[str, float]:
    """All parameters of one effect, defaults filled in; InputError on an unknown name or a value out of bounds."""
    if not isinstance(name, str) or name not in EFFECTS:
        raise InputError(f"{where}: unknown effect {name!r}{did_you_mean(str(name), EFFECTS)}")
    if given is None:
        given = {}
    if not isinstance(given, dict):
        raise InputError(f"{where}: {name}: expected a mapping of parameters, got {given!r}")
    values = EFFECTS[name].defaults()
    named = {word: one for one in EFFECTS[name].parameters for word in (one.name, one.catalogue) if word}
    for key, value in given.items():
        if key not in named:
            raise InputError(f"{where}: {name}: unknown parameter {key!r}{did_you_mean(str(key), values)}")
        parameter = named[key]
        if key != parameter.name and parameter.name in given:
            raise InputError(f"{where}: {name}: {key} and {parameter.name} are the same; give one")
        if key == parameter.catalogue and isinstance(value, float | int):
            value *= parameter.of_catalogue
        values[parameter.name] = check(parameter.spec, value, f"{where}: {name}")
    return values
