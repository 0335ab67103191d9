"""Mean speeds predicted by rival explanations for the next block, as curves to compare with the points to come."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from sandbot_model.design.explanations import name_of, readings
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.gait import Clock
from sandbot_model.physics.observables import Observable

POINTS = 33
"""A curve is drawn in a figure some 400 pixels wide, and sent once a second."""
DIGITS = 5
"""0.01 mm/s."""


@dataclass(frozen=True)
class Curve:
    """Mean speed over leg frequency at one φ, as predicted by one explanation."""

    explanation: str
    phi: float
    omega_rad_s: tuple[float, ...]
    speed_m_s: tuple[float, ...]


def curves(
    rivals: Sequence[Fit], phi: Collection[float], omega_rad_s: Sequence[float], clock: Clock | None = None
) -> tuple[Curve, ...]:
    """One curve for each rival and φ, from the lowest frequency to the highest."""
    omega = np.linspace(min(omega_rad_s), max(omega_rad_s), POINTS)
    return tuple(
        Curve(
            name_of(fit),
            level,
            tuple(omega.round(DIGITS).tolist()),
            tuple(readings(fit, np.full_like(omega, level), omega, clock)[:, Observable.speed].round(DIGITS).tolist()),
        )
        for fit in rivals
        for level in sorted(phi)
    )
