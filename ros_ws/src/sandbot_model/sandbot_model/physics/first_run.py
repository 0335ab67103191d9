"""An effect is run once before any fit, on arrays shaped as a fit has them: a slip shows at once."""

from collections.abc import Iterator
from itertools import product

import numpy as np

from sandbot_model.physics.arrays import Array
from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.gait import clock
from sandbot_model.physics.walking import Inputs, KCurve, Params, Walker, depth_grid

PHI, OMEGA = (np.array([part]).T for part in zip(*product((0.55, 0.6, 0.65), (1.0, 4.0, 12.0, 40.0)), strict=True))
CURVE = KCurve(np.array([0.58, 0.6, 0.633]), np.array([170.0, 205.0, 220.0]))
INPUTS = Inputs(
    np.array([[[150.0, 250.0]]]), OMEGA[None], 0.4, PHI[None], clock=clock(["SGCS"] * len(PHI))[:, None], k_of_phi=CURVE
)
"""Rows, cells, nodes: every φ at every ω."""


def changes_something(effect: Effect) -> bool:
    """Whether anything that is seen depends on an effect, somewhere between the ends of its parameters' ranges.

    Raises what its ``apply`` raises.
    """
    changed = [
        np.any(here != there)
        for first_step in (False, True)
        for here, there in zip(_all_seen(effect, (effect,), first_step), _all_seen(effect, (), first_step), strict=True)
    ]
    return any(changed)


def shown(chain: Chain) -> tuple[Array, ...]:
    """What all that is seen is made of: the force balance, the observables."""
    seen = chain.depth, chain.speed, chain.peak_speed, chain.advance, chain.v_swim, chain.swum
    return chain.margin, *seen, chain.sigma_phi


def _all_seen(effect: Effect, effects: tuple[Effect, ...], first_step: bool) -> Iterator[Array]:
    """What shows, and what effects of later stages may read of the rest."""
    walker = Walker(effects)
    params: Params = [
        {one.name: np.array([one.low, one.start, one.high])[:, None, None] for one in own.parameters} for own in effects
    ]
    chain = walker.chain(INPUTS, params, depth_grid(walker.robot), first_step=first_step)
    yield from shown(chain)
    if effect.stage != "balance":
        yield from (chain.chord, chain.slow_phase_ratio, chain.swing_ratio, chain.slow_begin, chain.slow_end)
