"""The chain from clock to speed, as quantities that effects act on.

    clock → strength → balance → step → speed

Everything is a function of one unknown, the depth d of the lowest leg point: the chord s(d) is geometry, and with it
the ground's strength, the force it gives and the force that is needed. A ``Chain`` holds these quantities on arrays
of shape ``(..., depths)``; each stage computes its own from the earlier ones, then the effects of that stage change
them. An effect sees quantities, never another effect, so that effects can be combined freely. Step and speed are filled
first: they are functions of d alone, and the ground that a foot meets depends on the distance from the one before.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from sandbot_common.arrays import Bools, Floats
from sandbot_common.robot import Robot
from sandbot_model.physics.gait import STANCE_END, first_step_rad
from sandbot_model.physics.geometry import angle_at, stance_angle

HORIZONTAL_STRENGTH = 146e3
"""α_x [N/m³], so that F_x is 4 N at 3.9 cm (physics §6)."""

NO_ANGLE = 1e-9
"""Least stance angle [rad], so that a leg that stands at its lowest point only has a standing time above 0."""


@dataclass(slots=True)
class Chain:
    """Quantities of the chain in SI units, broadcastable against ``depth (..., depths)``; no others can be set."""

    robot: Robot
    depth: Floats = field(
        metadata={"unit": "m", "doc": "d, depth of the lowest leg point below the undisturbed surface"}
    )
    k: Floats = field(metadata={"unit": "N/m", "doc": "stiffness of the ground under one leg; effects may lower it"})
    omega: Floats = field(metadata={"unit": "rad/s", "doc": "leg frequency; effects may lower it"})
    phi: Floats = field(metadata={"unit": "1", "doc": "volume fraction"})
    delta_t: Floats = field(metadata={"unit": "s", "doc": "time in which the body is brought to leg speed"})
    v_swim: Floats = field(metadata={"unit": "m/s", "doc": "speed where the ground never holds"})
    slow_phase_ratio: Floats = field(metadata={"unit": "1", "doc": "β of the gait: leg rate in the slow phase over ω"})
    swing_ratio: Floats = field(metadata={"unit": "1", "doc": "leg rate in the fast phase over ω"})
    slow_begin: Floats = field(metadata={"unit": "m", "doc": "depth of the legs at which their slow phase begins"})
    slow_end: Floats = field(metadata={"unit": "m", "doc": "depth of the legs at which their slow phase ends"})
    first_step: bool = field(metadata={"doc": "virgin ground, standing start"})
    k_of_phi: Callable[[Floats], Floats] = field(metadata={"doc": "the fitted stiffness at another volume fraction"})
    one_leg: bool = field(default=False, kw_only=True, metadata={"doc": "one leg is pressed alone, nothing walks"})

    # step (geometry; before strength, which depends on it)
    chord: Floats = field(init=False, metadata={"unit": "m", "doc": "2√(R² - (d+h-R)²)"})
    step: Floats = field(init=False, metadata={"unit": "m", "doc": "advance per step"})
    thrust_time: Floats = field(init=False, metadata={"unit": "s", "doc": "swimming time in the first step"})
    # strength
    penetration: Floats = field(
        init=False, metadata={"unit": "m", "doc": "z, depth below the surface that the leg meets"}
    )
    sigma_phi: Floats = field(init=False, metadata={"unit": "1", "doc": "spread of φ along the track"})
    # balance
    force: Floats = field(
        init=False, metadata={"unit": "N", "doc": "ground force that grows with depth; effects scale it"}
    )
    extra_force: Floats = field(init=False, metadata={"unit": "N", "doc": "further ground force; effects add to it"})
    leg_speed: Floats = field(init=False, metadata={"unit": "m/s", "doc": "speed of the body on its fixed leg, Rω"})
    delta_v: Floats = field(init=False, metadata={"unit": "m/s", "doc": "speed the ground has to give the body"})
    lift_ratio: Floats = field(init=False, metadata={"unit": "1", "doc": "fraction of Δv/Δt that is vertical"})
    mass: Floats = field(init=False, metadata={"unit": "kg", "doc": "mass to carry"})
    added_mass: Floats = field(init=False, metadata={"unit": "kg", "doc": "further mass to accelerate, not to carry"})
    gravity: Floats = field(init=False, metadata={"unit": "m/s²", "doc": "g normal to the bed"})
    # speed (before strength as well)
    kept: Floats = field(init=False, metadata={"unit": "1", "doc": "fraction of the step that becomes advance"})
    peak_ratio: Floats = field(init=False, metadata={"unit": "1", "doc": "largest v_x(t) over leg speed"})

    @property
    def slow_from(self) -> Floats:
        """Angle before the lowest point at which a leg's slow phase begins [rad]."""
        return angle_at(self.robot, self.slow_begin)

    @property
    def slow_until(self) -> Floats:
        """Angle after the lowest point at which the slow phase ends [rad]."""
        return angle_at(self.robot, self.slow_end)

    @property
    def stance(self) -> Floats:
        """α = asin(s_0/2R) [rad]: a leg stands from -α to α."""
        return stance_angle(self.chord, self.robot.leg_radius_m)

    @property
    def standing_time(self) -> Floats:
        """Duration of a stance [s], each phase of the gait at its own rate."""
        angle = np.maximum(self.stance, NO_ANGLE)
        slow = np.minimum(angle, self.slow_from) + np.minimum(angle, self.slow_until)
        time: Floats = slow / (self.slow_phase_ratio * self.omega) + (2 * angle - slow) / (
            self.swing_ratio * self.omega
        )
        return time

    @property
    def longest_step(self) -> Floats:
        """Step [m] that takes half a period: then the next leg takes hold, since both legs are at the same angle from
        straight below and equally deep in the ground.
        """
        slow, swing, half = self.slow_phase_ratio, self.swing_ratio, np.pi
        near, far = self.slow_reach, np.maximum(self.slow_from, self.slow_until)
        within = slow * half / 2
        partly = (half - near / slow + near / swing) / (1 / slow + 1 / swing)
        beyond = swing * (half - (near + far) / slow) / 2 + (near + far) / 2
        angle = np.where(within < near, within, np.where(partly < far, partly, beyond))
        return 2 * self.robot.leg_radius_m * np.sin(np.minimum(angle, np.pi / 2))

    @property
    def time_left(self) -> Floats:
        """Time from the end of a stance to the next leg's stance [s]; in the first step, to the end of that step, which
        starts with the leg at the beginning of its slow phase, maybe before its stance.
        """
        if not self.first_step:
            return np.maximum(np.pi / self.omega - self.standing_time, 0.0)
        lasts = first_step_rad(self.slow_phase_ratio, self.swing_ratio, self.slow_from) / self.omega
        to_go = np.maximum(self.slow_from - self.stance, 0.0)
        return np.maximum(lasts - to_go / (self.slow_phase_ratio * self.omega) - self.standing_time, 0.0)

    @property
    def slow_reach(self) -> Floats:
        """Angle to both sides of the lowest point within which legs are in their slow phase [rad]."""
        return np.minimum(self.slow_from, self.slow_until)

    @property
    def stands_slowly(self) -> Bools:
        """Whether a usual stance lies within the slow phase, taken to be so if that reaches beyond half a long stance
        to each side. The peak of v_x(t) is then in the slow phase, else in the fast one.
        """
        slowly: Bools = self.slow_reach > STANCE_END / 2
        return slowly

    @property
    def advance(self) -> Floats:
        """Advance in a step [m]."""
        return self.step * self.kept

    @property
    def speed(self) -> Floats:
        """Mean forward speed v̄ = ωs/π [m/s] when walking: two steps a period."""
        return self.omega * self.advance / np.pi

    @property
    def peak_speed(self) -> Floats:
        """Largest v_x(t) of a step [m/s] when walking."""
        return self.leg_speed * self.peak_ratio

    @property
    def swum(self) -> Floats:
        """Advance in the first step [m] when swimming."""
        return self.v_swim * self.thrust_time

    @property
    def load(self) -> Floats:
        """The force the ground must give: m g + (m + m_a) a_z [N]."""
        return self.mass * self.gravity + (self.mass + self.added_mass) * self.delta_v / self.delta_t * self.lift_ratio

    @property
    def margin(self) -> Floats:
        """Force of the ground minus load [N]; the leg stops sinking at the least depth where it is not negative."""
        return self.force + self.extra_force - self.load

    def creep(self, grip: Floats) -> None:
        """Let the leg creep while it stands: step and peak of v_x(t) are multiplied by ``grip``."""
        self.step, self.peak_ratio = self.step * grip, self.peak_ratio * grip


def disturbed_fraction(chain: Chain, reach: Floats | float) -> Floats:
    """Fraction of a leg in ground that the last step disturbed: 0 at an advance of ``reach`` R, 1 at 0.1 R less."""
    radius = chain.robot.leg_radius_m
    fraction: Floats = np.clip((reach * radius - chain.advance) / (0.1 * radius), 0.0, 1.0)
    return fraction


def horizontal_force(chain: Chain) -> Floats:
    """F_x = 1.5 α_x w d² [N], the ground's force on a leg along the track: about 4 N at 3.9 cm."""
    force: Floats = np.maximum(1.5 * HORIZONTAL_STRENGTH * chain.robot.leg_width_m * chain.depth**2, 1e-6)
    return force
