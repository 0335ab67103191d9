"""An effect: a formula at one stage of the chain, with parameters that have plausible ranges."""

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_common.errors import InputError
from sandbot_common.robot import SANDBOT, Robot
from sandbot_model.physics.chain import Chain

STAGES = ("clock", "strength", "balance", "step", "speed")

REPLACEABLE = ("v_swim_m_s",)
"""Parameters of the base model that an effect may replace; Δt is needed by every search."""

Values = Mapping[str, Floats]
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
    """Value at which the effect vanishes, if there is one."""
    hard_low: float = -np.inf
    hard_high: float = np.inf
    symbol: str = ""
    """Its symbol in the effect's formula; empty if that is its name."""
    reach: float = 0.5
    """How far a fit may search beyond the plausible range, in units of its width."""
    scales_with: Callable[[Robot], float] | None = None
    """What the ranges of two robots are in proportion to; None: SandBot's range holds for every robot."""

    @property
    def width(self) -> float:
        """Width of the plausible range."""
        return self.high - self.low

    @property
    def search(self) -> tuple[float, float]:
        """The plausible range widened by ``reach`` to either side, so that a fit may leave it and be seen to."""
        margin = self.reach * self.width
        return max(self.low - margin, self.hard_low), min(self.high + margin, self.hard_high)

    def ends_at(self, value: float) -> float | None:
        """The end of ``search`` next to a value; None if it is a physical one, or the effect vanishes there."""
        end = min(self.search, key=lambda end: abs(end - value))
        hard = min(abs(end - self.hard_low), abs(end - self.hard_high)) < 1e-9 * self.width
        return None if hard or end == self.neutral else end

    def with_unit(self, value: float) -> str:
        """A value of it with its unit: ``0.4 s``."""
        return f"{value:g}{'' if self.unit == '1' else f' {self.unit}'}"

    def check(self, value: float, where: str) -> None:
        """Raises InputError, its text beginning with ``where``, for a value that the parameter can't have."""
        if not self.hard_low <= value <= self.hard_high:
            ends = (("at least", self.hard_low), ("at most", self.hard_high))
            needed = " and ".join(f"{how} {end:g}" for how, end in ends if np.isfinite(end))
            raise InputError(f"{where}={value:g}: {needed} is needed")

    def of(self, robot: Robot) -> "Parameter":
        """The parameter with its range for this robot, as it is declared with SandBot's."""
        factor = self.scales_with(robot) / self.scales_with(SANDBOT) if self.scales_with else 1.0
        if factor == 1.0:
            return self
        return replace(
            self, low=factor * self.low, high=factor * self.high, start=factor * self.start, scales_with=None
        )

    def held_at(self, value: float) -> "Parameter":
        """The parameter with its range reduced to this value."""
        return replace(self, low=value, high=value, start=value, hard_low=value, hard_high=value)


def is_range(low: float, high: float) -> bool:
    """Whether a fit can search from ``low`` to ``high``: the square of the width is neither 0 nor infinite."""
    return 1e-100 < high - low < 1e100


def duplicate_name(parameters: Sequence[Parameter]) -> str:
    """The first name used by two parameters; empty if all differ."""
    names = [parameter.name for parameter in parameters]
    return next((name for name in names if names.count(name) > 1), "")


class Effect:
    """A physical effect missing from the base model: one formula at one stage.

    Subclass it and set the attributes below, on the class or, where one class makes many effects, on each instance.
    """

    identifier: str
    stage: str
    formula: str
    """What ``apply`` does, in words or in the notation of docs/physics.md §6 (see ``typeset``)."""
    source: str
    seen_in: str
    parameters: tuple[Parameter, ...] = ()
    mistaken_for: str = ""
    """Another cause with the same formula, which no data can distinguish from this one; a claim mentions it."""
    control: str = ""
    """An experiment other than trials at some φ and ω in which the effect shows, and how: ``dry the grains: it
    vanishes``. A verdict asks for it where no such trial distinguishes the effect from others."""
    first_step_differs: bool = False
    """True if the effect differs in the first step: virgin ground, standing start (see ``chain.first_step``)."""
    clocked: bool = False
    """True if legs turn by the clock of the gait: the force needed then jumps where the slow phase begins
    (``chain.slow_begin``), and the next leg may end a stance (``chain.longest_step``)."""
    at_the_slow_rate: bool = False
    """True if the body is pushed in the legs' slow phase: the same force then means a Δt shorter by the ratio β."""
    along_the_track: bool = False
    """True if φ varies within a trial (the effect sets ``chain.sigma_phi``): averages are then taken along the way."""
    replaces: tuple[str, ...] = ()
    """Parameters of the base model that the effect makes meaningless, a subset of ``REPLACEABLE``."""
    variant: str = ""
    """Name of its convention, if it is a variant of the effect with the same identifier (see ``variants``)."""

    def with_parameters(self, parameters: tuple[Parameter, ...]) -> "Effect":
        """The same effect with other ranges or limits of its parameters."""
        found = copy.copy(self)
        found.parameters = parameters
        return found

    def of(self, robot: Robot) -> "Effect":
        """The effect with its ranges for this robot; the same object where they are SandBot's."""
        own = tuple(parameter.of(robot) for parameter in self.parameters)
        return self if own == self.parameters else self.with_parameters(own)

    def apply(self, chain: Chain, p: Values) -> None:
        """Change the chain's quantities; ``p`` holds this effect's parameters by name."""
        raise NotImplementedError


def is_from_catalogue(effect: Effect) -> bool:
    """Whether an effect is the catalogue's, in any convention, and not a user's replacement of it."""
    return bool(effect.variant) or type(effect).__module__.startswith(f"{__package__}.effects.")


def of_robot(catalogue: Mapping[str, Effect], robot: Robot) -> dict[str, Effect]:
    """A catalogue with its ranges for this robot."""
    return {name: effect.of(robot) for name, effect in catalogue.items()}
