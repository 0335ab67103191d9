"""The catalogue of effects (physics §6): one file, one class, one formula each."""

from sandbot_model.physics.effect import Effect
from sandbot_model.physics.effects.added_mass import AddedMass
from sandbot_model.physics.effects.bed_slope import BedSlope
from sandbot_model.physics.effects.belly_coast import BellyCoast
from sandbot_model.physics.effects.cable_drag import CableDrag
from sandbot_model.physics.effects.carried_momentum import CarriedMomentum
from sandbot_model.physics.effects.cohesion import Cohesion
from sandbot_model.physics.effects.crater_refill import CraterRefill
from sandbot_model.physics.effects.depth_nonlinearity import DepthNonlinearity
from sandbot_model.physics.effects.dilation import Dilation
from sandbot_model.physics.effects.disturbed_ground import DisturbedGround
from sandbot_model.physics.effects.exact_leg_arc import ExactLegArc
from sandbot_model.physics.effects.exact_vertical_acceleration import ExactVerticalAcceleration
from sandbot_model.physics.effects.finite_depth import FiniteDepth
from sandbot_model.physics.effects.inertial_drag import InertialDrag
from sandbot_model.physics.effects.leg_slip import LegSlip
from sandbot_model.physics.effects.motor_saturation import MotorSaturation
from sandbot_model.physics.effects.phi_dependent_response import PhiDependentResponse
from sandbot_model.physics.effects.phi_nonuniformity import PhiNonuniformity
from sandbot_model.physics.effects.resistive_force_theory import ResistiveForceTheory
from sandbot_model.physics.effects.slow_phase_speed import SlowPhaseSpeed
from sandbot_model.physics.effects.stance_overlap import StanceOverlap
from sandbot_model.physics.effects.swimming_thrust import SwimmingThrust
from sandbot_model.physics.effects.unequal_leg_load import UnequalLegLoad

CATALOGUE: tuple[Effect, ...] = (
    DisturbedGround(),
    ExactVerticalAcceleration(),
    ExactLegArc(),
    StanceOverlap(),
    SwimmingThrust(),
    InertialDrag(),
    CraterRefill(),
    PhiDependentResponse(),
    AddedMass(),
    BellyCoast(),
    CableDrag(),
    LegSlip(),
    ResistiveForceTheory(),
    Dilation(),
    Cohesion(),
    DepthNonlinearity(),
    BedSlope(),
    MotorSaturation(),
    PhiNonuniformity(),
    FiniteDepth(),
    SlowPhaseSpeed(),
    CarriedMomentum(),
    UnequalLegLoad(),
)
"""Every effect of the catalogue, in the order of physics §6."""
