"""Fills the chain stage by stage; the effects of each stage act on the quantities computed so far."""

from collections.abc import Sequence

import numpy as np

from sandbot_model.physics import guarded
from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Values
from sandbot_model.physics.geometry import chord

Active = Sequence[tuple[Effect, Values]]
"""Effects with the values of their parameters, arrays broadcastable against ``Chain.depth``."""


def through(chain: Chain, effects: Active) -> Chain:
    """Fill the chain stage by stage and let each stage's effects act (physics §2, with the effects of physics §6)."""

    def act(stage: str) -> None:
        for effect, values in effects:
            if effect.stage == stage:
                guarded.apply(effect, chain, values)

    robot = chain.robot
    # Set before the clock, whose effects may scale it: the phase of the largest leg speed depends on the gait.
    chain.peak_ratio = np.ones(())
    act("clock")
    chain.leg_speed = robot.leg_radius_m * chain.omega
    # Thrust begins when the leg has passed its lowest point, with uniform rotation half way through the first step.
    chain.thrust_time = np.pi / (2 * chain.omega)
    chain.chord = chord(robot, chain.depth)
    clocked = any(effect.clocked for effect, _ in effects)
    chain.step = np.minimum(chain.chord, chain.longest_step) if clocked else chain.chord
    chain.kept = np.ones(())
    act("step")
    # Speed comes before strength: the next foot falls an advance further on, maybe in disturbed ground.
    act("speed")

    chain.penetration = chain.depth
    chain.sigma_phi = np.zeros(())
    act("strength")

    chain.force = chain.k * chain.penetration
    chain.extra_force = np.zeros(())
    chain.delta_v = chain.leg_speed
    chain.lift_ratio = np.ones(())
    chain.mass, chain.added_mass = np.asarray(robot.mass_per_leg_kg), np.zeros(())
    chain.gravity = np.asarray(robot.gravity_m_s2)
    act("balance")
    return chain
