"""What is excluded already, by evidence that holds however often it is looked at.

The likelihood of data that come one after the other under one hypothesis, over that under a true one, is a martingale
that begins at 1: it ever reaches 1/α with a probability of at most α (Ville 1939;
Ramdas et al. 2023, Stat. Sci. 38, 576).

* A claim is tried against a mixture over M effects, each of a strength drawn from a normal distribution ``WIDTH``
  standard errors wide: what an effect must gain in deviance is 2 ln(M/α) + ln(1 + WIDTH²), the same at every look.
* An effect is excluded at a strength once the deviance has risen by 2 ln(1/α) at it.

Both hold for linear models of known noise; where replicates are few, F takes the place of χ².
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from sandbot_model.data.distributions import chi2_sf, f_isf
from sandbot_model.discovery.criteria import DEFAULT, Criteria
from sandbot_model.discovery.effect_search import EffectSearch, Names
from sandbot_model.discovery.verdict import overdispersion
from sandbot_model.fitting.fit import Fit

WIDTH = 45.0
"""Prior sd of a strength, in standard errors at the end: the plausible range of an effect that is well measured."""
WEAK, USUAL = 0.5, 1.0
"""Strengths to exclude, as a share of an effect's usual one."""

NONE = 1e-9
"""A share of trials that is none of them."""


def at_every_look(alpha: float, effects: int, criteria: Criteria) -> Criteria:
    """Criteria by which one of ``effects`` effects that are not there is ever claimed with probability ``alpha``."""
    claim = 2 * math.log(effects / alpha) + math.log1p(WIDTH**2)
    # Where explanations differ most there is one trial at first: a campaign repeats it, and leaves none out.
    return replace(criteria, claim=max(criteria.claim, claim), lone_trials=NONE)


def lack_of_fit_at(look: int, alpha: float) -> float:
    """p-value of lack of fit that refuses a model for good at look 1, 2, ...: α/(k (k + 1)), all together α."""
    return alpha / (look * (look + 1))


@dataclass(frozen=True, eq=False)
class Possible:
    """The named set with one effect more, and what speaks against it."""

    effect: str
    share: float
    """Its strength, as a share of its usual one."""
    fit: Fit
    rise: float
    """Of the deviance, over that of the named set."""
    needed: float
    """Rise from which on it is excluded."""

    @property
    def excluded(self) -> bool:
        """Whether it is, at every look."""
        return self.rise >= self.needed

    @property
    def spoken_for(self) -> bool:
        """Whether the data lean to it by two standard deviations: then it is not out of the plan's reach."""
        return self.rise <= -DEFAULT.not_excluded

    @property
    def e_value(self) -> float:
        """Likelihood of the named set over this one."""
        return math.exp(min(0.5 * self.rise, 700.0))


def possible_beside(
    search: EffectSearch, named: Fit, alpha: float, share: float, more: Sequence[str]
) -> list[Possible]:
    """Each of ``more`` effects beside the named set, at a share of its usual strength."""
    sets = [search.extended(named.effects, [name])[0] for name in more]
    held = [_held(search, name, named.effects, share) for name in more]
    fits = search.near([search.model(names, at) for names, at in zip(sets, held, strict=True)], named)
    needed = excluding_rise(named, alpha)
    return [
        Possible(name, share, fit, fit.deviance - named.deviance, needed) for name, fit in zip(more, fits, strict=True)
    ]


def excluding_rise(named: Fit, alpha: float) -> float:
    """Rise of the deviance that excludes: 2 ln(1/α), more where replicates are few or cell means scatter more."""
    freedom = int(named.cells.pure_error_dof.sum())
    tail = chi2_sf(2 * math.log(1 / alpha), 1)
    return overdispersion(named) * (f_isf(tail, 1, freedom) if freedom else math.inf)


def _held(search: EffectSearch, name: str, beside: Names, share: float) -> dict[str, float]:
    """Where the effect's parameters are held: where they usually are, but a strength at a share of that."""
    strength = dict(search.strengths(beside)).get(name)
    usual = {f"{name}.{one.name}": one.start for one in search.effects[name].parameters}
    if strength is not None and strength.neutral is not None:
        usual[f"{name}.{strength.name}"] = strength.neutral + share * (strength.start - strength.neutral)
    return usual
