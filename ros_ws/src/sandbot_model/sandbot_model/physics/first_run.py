"""Runs an effect once before any fit, on arrays of the shapes used in fits, so that mistakes show at once."""

from collections.abc import Iterator, Mapping
from itertools import product

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_common.robot import SANDBOT, Robot
from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Parameter
from sandbot_model.physics.gait import clock
from sandbot_model.physics.walking import USUAL_K, Inputs, Params, Walker, depth_grid

PHI, OMEGA = (np.array([part]).T for part in zip(*product((0.55, 0.6, 0.65), (1.0, 4.0, 12.0, 40.0)), strict=True))
INPUTS = Inputs(
    np.array([[[150.0, 250.0]]]),
    OMEGA[None],
    0.4,
    PHI[None],
    clock=clock(["SGCS"] * len(PHI))[:, None],
    k_of_phi=USUAL_K,
)
"""Shapes as in a fit (rows, cells, nodes): every φ at every ω."""


ROBOTS = (
    SANDBOT,
    *(
        Robot(leg_radius_m=radius, axle_height_m=share * radius, leg_width_m=0.3 * radius, mass_per_leg_kg=mass)
        for radius, mass in ((0.01, 0.1), (0.35, 5.0))
        for share in (0.1, 0.95)
    ),
)
"""SandBot, and robots with small and large legs of which the belly hangs low and high: legs sink to other depths."""
NEGLIGIBLE = 1e-9
"""Relative change by an effect at its neutral values that counts as none."""


def changes_something(effect: Effect) -> bool:
    """Whether any observable of any of these robots depends on an effect, at the ends or the start value of its
    parameters' ranges.

    Exceptions of its ``apply`` are passed on.
    """
    return any(_changes(effect, robot) for robot in ROBOTS)


def _changes(effect: Effect, robot: Robot) -> bool:
    """The same of one robot; both the first step and later ones are run in any case."""
    changed = [
        np.any(here != there)
        for first_step in (False, True)
        for here, there in zip(
            _filled(effect, (effect,), first_step, robot=robot),
            _filled(effect, (), first_step, robot=robot),
            strict=True,
        )
    ]
    return any(changed)


def is_repeatable(effect: Effect) -> bool:
    """Whether an effect gives the same again for the same inputs."""
    twice = (list(_filled(effect, (effect,), first_step=False)) for _ in range(2))
    return all(np.array_equal(here, there, equal_nan=True) for here, there in zip(*twice, strict=True))


def vanishes(effect: Effect) -> bool:
    """Whether an effect changes nothing at the neutral values of its parameters; True if none has one.

    Where it gives no number it is not judged: whether that matters depends on the conditions of the data.
    """
    if all(parameter.neutral is None for parameter in effect.parameters):
        return True
    at = {p.name: _tried(p) if p.neutral is None else np.full((3, 1, 1), p.neutral) for p in effect.parameters}
    return all(
        np.all(np.isnan(here) | np.isclose(here, there, rtol=NEGLIGIBLE, atol=NEGLIGIBLE))
        for first_step in (False, True)
        for here, there in zip(_filled(effect, (effect,), first_step, at), _filled(effect, (), first_step), strict=True)
    )


def observed_quantities(chain: Chain) -> tuple[Floats, ...]:
    """Quantities that determine the observables: the force margin, and those read after the force balance."""
    seen = chain.depth, chain.speed, chain.peak_speed, chain.advance, chain.v_swim, chain.swum
    return chain.margin, *seen, chain.sigma_phi


def _filled(
    effect: Effect,
    effects: tuple[Effect, ...],
    first_step: bool,
    at: Mapping[str, Floats] | None = None,
    robot: Robot = SANDBOT,
) -> Iterator[Floats]:
    """The observed quantities, and others that effects of later stages may read; the parameters of each of ``effects``
    are ``at`` these values, or at the ends and start of their ranges."""
    walker = Walker(effects, robot)
    params: Params = [at or {p.name: _tried(p) for p in own.parameters} for own in effects]
    chain = walker.chain(INPUTS, params, depth_grid(robot), first_step=first_step)
    yield from observed_quantities(chain)
    if effect.stage != "balance":
        yield from (chain.chord, chain.slow_phase_ratio, chain.swing_ratio, chain.slow_begin, chain.slow_end)


def _tried(parameter: Parameter) -> Floats:
    """The ends and the start of a parameter's range ``(3, 1, 1)``."""
    return np.array([parameter.low, parameter.start, parameter.high])[:, None, None]
