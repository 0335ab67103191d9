"""Confidence limits at 95 % on effects that are absent, such as ``stance_overlap.eta < 0.02``.

Each is a value at which a fit with the parameter held there, and everything else free, is worse than the best by the
rise of the deviance that the level asks for: 2.71 for an effect that can only reduce something (η, σ), which has an
upper limit; 3.84 for an effect of either sign (b, χ), which has an interval.
"""

import math
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.global_minimum import WarmStart
from sandbot_model.fitting.text import to_error
from sandbot_model.physics.effect import Parameter

ONE_SIDED, TWO_SIDED = 2.706, 3.841
"""χ² of one degree of freedom at 90 and 95 %."""
ROUNDS = 4
"""Values tried for each limit, and again beyond a step of the deviance; there is no limit if none of them is excluded
by about as much as asked."""
AIMED_AT, ACCEPTED = 1.05, 1.3
"""√ of the rise of the deviance at which the next value aims, and up to which a limit is accepted, as a multiple of
what is asked: below 1 it would be no limit."""
STAIRCASE = 1e-4
"""Fraction of the plausible range below which a standard error is that of a step, not of the parameter."""
OUTWARDS = 3.0
"""Most by which the distance from the best value grows from one value to the next."""


@dataclass(frozen=True)
class Limit:
    """Limits at 95 % on a parameter of an absent effect; None on a side where they exclude no plausible value."""

    effect: str
    parameter: str
    unit: str
    low: float | None
    high: float | None
    neutral: float = 0.0
    """Value at which the effect vanishes."""

    def __str__(self) -> str:
        low, high = self.ends
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"{low and f'{low} < '}{self.effect}.{self.parameter}{high and f' < {high}'}{unit}"

    @property
    def ends(self) -> tuple[str, str]:
        """Both limits as text, empty for none: to a tenth of the interval, since both may lie near the neutral value;
        one alone to two digits of its distance from there.
        """
        if self.low is not None and self.high is not None:
            error = 0.1 * (self.high - self.low)
            return to_error(self.low, error), to_error(self.high, error)
        low, high = ("" if end is None else _to_two_digits(end, self.neutral) for end in (self.low, self.high))
        return low, high


def _to_two_digits(value: float, neutral: float) -> str:
    distance = max(abs(value - neutral), 1e-9)
    return f"{round(value, 1 - math.floor(math.log10(distance))):.12g}"


def limits(search: EffectSearch, named: Fit, hidden: Container[str] = ()) -> list[Limit]:
    """Limits on each effect that is not named, vanishes at a neutral value of one parameter, and shows in the data: not
    on those that are ``hidden`` at their usual strength. No limit excludes the neutral value."""
    strengths = {name: parameter for name, parameter in search.strengths(named.effects) if name not in hidden}
    sides = _sides(search, named, strengths)
    for tried in range(2 * ROUNDS):
        if tried == ROUNDS:
            for side in sides:
                side.pass_the_step()
        sought = [side for side in sides if not side.settled]
        for side, fit in zip(sought, _held(search, named, sought), strict=True):
            side.look(fit)
    found = []
    for name, parameter in strengths.items():
        ends = {side.sign: side.limit for side in sides if side.name == name}
        low, high, neutral = ends.get(-1), ends.get(1), float(parameter.neutral or 0.0)
        found += [] if low is high is None else [Limit(name, parameter.name, parameter.unit, low, high, neutral)]
    return found


@dataclass
class _Side:
    """The search for the limit to one side of a parameter. Distances are from its best value, outwards."""

    name: str
    parameter: str
    sign: int
    best_value: float
    deviance: float
    root_asked: float
    """√ of the rise of the deviance that excludes a value."""
    tried: float
    """Distance to try next."""
    room: float
    """Distance of the end of the plausible range."""
    usual: float
    """Distance of the usual strength."""
    beside: WarmStart
    """Where the last fit ended, from which the next begins as well: a descent from the named set alone stops at the
    first condition that would have to walk or swim."""
    inside: tuple[float, float]
    """The farthest distance that is not excluded, and √ of the rise there."""
    outside: tuple[float, float] | None = None
    """The nearest distance that is excluded, and √ of the rise there."""

    @property
    def limit(self) -> float | None:
        """The nearest value that a fit excludes; None where only a step of the deviance does: a condition that walks or
        swims there by chance says less than the rise it causes."""
        return self.best_value + self.sign * self.outside[0] if self.outside is not None and self.settled else None

    @property
    def settled(self) -> bool:
        """Whether the deviance has risen by little more than is asked, or by less in all of the plausible range."""
        if self.outside is None:
            return self.inside[0] >= self.room
        return self.outside[1] <= ACCEPTED * self.root_asked

    def look(self, fit: Fit) -> None:
        """Take account of the fit at the distance ``tried``."""
        here = self.tried, math.sqrt(max(fit.deviance - self.deviance, 0.0))
        self.deviance, self.beside = min(self.deviance, fit.deviance), fit.warm_start
        if here[1] >= self.root_asked:
            self.outside = here
        else:
            self.inside = here
        self._aim()

    def pass_the_step(self) -> None:
        """If a step of the deviance is in the way, go on from its far end: the rise counts from there."""
        if self.outside is not None and not self.settled:
            self.deviance += self.outside[1] ** 2
            self.inside, self.outside = (self.outside[0], 0.0), None
            self._aim()

    def _aim(self) -> None:
        """Choose what to try next."""
        (near, low), aim = self.inside, AIMED_AT * self.root_asked
        if self.outside is None:
            self.tried = min(near * min(aim / max(low, 1e-9), OUTWARDS), self.room)
        else:
            far, high = self.outside
            self.tried = near + (far - near) * min((aim - low) / (high - low), 1.0)


def _sides(search: EffectSearch, named: Fit, strengths: Mapping[str, Parameter]) -> list[_Side]:
    """The sides to which limits are sought; none where the data say nothing."""
    sets = [search.extended(named.effects, [name])[0] for name in strengths]
    # The named set is fitted again, for its search may have gone deeper than those compared with it.
    base, *free = search.near([search.model(names) for names in (named.effects, *sets)], named)
    sides = [
        side
        for (name, parameter), fit in zip(strengths.items(), free, strict=True)
        for side in _outwards(name, parameter, base.deviance, fit)
    ]
    return _not_made_to_vanish(search, named, sides)


def _outwards(name: str, parameter: Parameter, base: float, free: Fit) -> Iterator[_Side]:
    """The sides of one parameter, from its best value outwards: ``free`` has it, ``base`` is the deviance without."""
    neutral, (value, error) = float(parameter.neutral or 0.0), free.parameters[f"{name}.{parameter.name}"]
    best, centre = min((base, neutral), (free.deviance, value))
    one_sided = parameter.hard_low == neutral
    rise = ONE_SIDED if one_sided else TWO_SIDED
    # What an effect does may rise with the square of its parameter: no slope at neutral, and no error to begin with.
    error = 0.5 * parameter.width if value == neutral and not error < parameter.width else error
    # An effect whose best fit is far above the base model does not contain that, as with a gait that is assumed.
    if not STAIRCASE * parameter.width < error < parameter.width or free.deviance > best + rise:
        return
    for sign, end in ((1, parameter.high), (-1, parameter.low)):
        kept, usual, room = (sign * (at - centre) for at in (neutral, parameter.start, end))
        kept, root = max(kept, 0.0), math.sqrt(rise)
        if kept < room and not (one_sided and sign < 0):
            first = min(max(AIMED_AT * root * error, kept + error), room)
            yield _Side(
                name, parameter.name, sign, centre, best, root, first, room, usual, free.warm_start, (kept, 0.0)
            )


def _not_made_to_vanish(search: EffectSearch, named: Fit, sides: Sequence[_Side]) -> list[_Side]:
    """The sides for which the effect is excluded at its usual strength and at the end of the plausible range, although
    a second parameter could make it vanish there: a search from the neutral value may miss such a fit."""
    able = [side for side in sides if len(search.effects[side.name].parameters) > 1]
    far = [
        replace(side, tried=distance) for side in able for distance in (side.usual, side.room) if distance > side.tried
    ]
    vanishing = {
        (side.name, side.sign)
        for side, fit in zip(far, _held(search, named, far), strict=True)
        if fit.deviance < side.deviance + side.root_asked**2
    }
    return [side for side in sides if (side.name, side.sign) not in vanishing]


def _held(search: EffectSearch, named: Fit, sides: Sequence[_Side]) -> list[Fit]:
    """Full fits with each parameter held at the distance that is to be tried."""
    models = []
    for side in sides:
        value = side.best_value + side.sign * side.tried
        names = search.extended(named.effects, [side.name])[0]
        models.append(search.model(names, {f"{side.name}.{side.parameter}": value}))
    return search.near(models, named, also=[(side.beside,) for side in sides])
