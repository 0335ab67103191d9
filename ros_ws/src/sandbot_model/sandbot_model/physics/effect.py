"""What an effect is: a formula at one stage of the chain, with parameters of plausible range."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sandbot_common.errors import InputError
from sandbot_model.physics.arrays import Array
from sandbot_model.physics.chain import Chain

STAGES = ("clock", "strength", "balance", "step", "speed")

REPLACEABLE = ("v_swim_m_s",)
"""Parameters of the base model that an effect may replace; a search needs Δt."""

Values = Mapping[str, Array]
"""Parameters of one effect by name, broadcastable against ``Chain.depth``."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect: its plausible range, and the wider one a fit may search."""

    name: str
    unit: str
    low: float
    high: float
    start: float
    doc: str
    neutral: float | None = None
    """Where the effect vanishes, if such a value exists."""
    hard_low: float = -np.inf
    hard_high: float = np.inf
    symbol: str = ""
    """What the effect's formula calls it; empty if that is its name."""

    @property
    def width(self) -> float:
        """Of the plausible range."""
        return self.high - self.low

    @property
    def search(self) -> tuple[float, float]:
        """The plausible range widened by half its width a side: a fit at its edge is seen to want more."""
        margin = 0.5 * self.width
        return max(self.low - margin, self.hard_low), min(self.high + margin, self.hard_high)

    def check(self, value: float, where: str) -> None:
        """Raises InputError, which ``where`` opens, for a value that it can't have."""
        if not self.hard_low <= value <= self.hard_high:
            ends = (("at least", self.hard_low), ("at most", self.hard_high))
            needed = " and ".join(f"{how} {end:g}" for how, end in ends if np.isfinite(end))
            raise InputError(f"{where}={value:g}: {needed} is needed")

    def held_at(self, value: float) -> "Parameter":
        """The parameter with no range but this value."""
        return replace(self, low=value, high=value, start=value, hard_low=value, hard_high=value)


def duplicate_name(parameters: Sequence[Parameter]) -> str:
    """The first name that two parameters have; empty where each has its own."""
    names = [parameter.name for parameter in parameters]
    return next((name for name in names if names.count(name) > 1), "")


class Effect:
    """A physical effect missing from the base model: one formula at one stage.

    Subclass it and set what is below, on the class or, where one class makes many effects, on each instance.
    """

    identifier: str
    stage: str
    formula: str
    """What ``apply`` does, in words or as docs/physics.md §6 says formulas are written (see ``typeset``)."""
    source: str
    seen_in: str
    parameters: tuple[Parameter, ...] = ()
    mistaken_for: str = ""
    """What has the same formula for another reason, so that no data can tell the two apart; a claim says so."""
    first_step_differs: bool = False
    """True if the effect is another in the first step: virgin ground, standing start (see ``chain.first_step``)."""
    clocked: bool = False
    """True if legs turn by the clock of the gait: the force needed then jumps where the slow phase begins
    (``chain.slow_begin``), and the next leg may end a stance (``chain.longest_step``)."""
    at_the_slow_rate: bool = False
    """True if legs give the push in their slow phase: the same push then takes a Δt that is as much shorter."""
    along_the_track: bool = False
    """True if φ varies within a trial (the effect sets ``chain.sigma_phi``): averages are then taken along the way."""
    replaces: tuple[str, ...] = ()
    """Parameters of the base model that mean nothing once the effect acts, of ``REPLACEABLE``."""
    variant: str = ""
    """Which other convention this is, of a family with the same identifier (see ``variants``)."""

    def apply(self, chain: Chain, p: Values) -> None:
        """Change the chain's quantities; ``p`` holds this effect's parameters by name."""
        raise NotImplementedError


def is_from_catalogue(effect: Effect) -> bool:
    """Whether an effect is the catalogue's, under whatever convention; not one that a user has put in its place."""
    return bool(effect.variant) or type(effect).__module__.startswith(f"{__package__}.effects.")
