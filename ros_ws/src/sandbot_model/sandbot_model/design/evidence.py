"""Which effects are excluded already, by evidence that is valid however often one looks (anytime-valid).

The likelihood ratio of data that arrive one after the other, for a hypothesis against the true one, is a martingale
that starts at 1: the probability that it ever reaches 1/α is at most α (Ville 1939; Ramdas et al. 2023, Stat. Sci. 38,
576).

* A claim is tested with a mixture over M effects, each with a normal prior of its strength ``WIDTH`` standard errors
  wide: an effect must gain 2 ln(M/α) + ln(1 + WIDTH²) in deviance, the same at every look.
* An effect of a given strength is excluded once the deviance at that strength has risen by 2 ln(1/α).

Both hold for linear models of known noise; where replicates are few, F takes the place of χ².
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from sandbot_model.data.distributions import chi2_sf, f_isf
from sandbot_model.discovery.criteria import DEFAULT, Criteria
from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.verdict import Names, overdispersion
from sandbot_model.fitting.fit import Fit

WIDTH = 45.0
"""Prior sd of a strength, in final standard errors: the plausible range of an effect that is measured well."""
WEAK, USUAL = 0.5, 1.0
"""Strengths to exclude, relative to an effect's usual one."""

NONE = 1e-9
"""A fraction of trials that amounts to none; ``Criteria`` does not allow 0."""


def at_every_look(alpha: float, effects: int, criteria: Criteria) -> Criteria:
    """Criteria by which the probability of ever claiming one of ``effects`` absent effects is at most ``alpha``."""
    claim = 2 * math.log(effects / alpha) + math.log1p(WIDTH**2)
    # The most informative conditions have a single trial at first: a campaign repeats it rather than leave it out.
    return replace(criteria, claim=max(criteria.claim, claim), lone_trials=NONE)


def lack_of_fit_at(look: int, alpha: float) -> float:
    """p-value of lack of fit below which look k = 1, 2, ... rejects a model for good: α/(k (k + 1)), in total α."""
    return alpha / (look * (look + 1))


@dataclass(frozen=True, eq=False)
class AddedEffect:
    """The named set with one more effect, held at a strength, and the evidence against it."""

    effect: str
    share: float
    """The strength, relative to the effect's usual one."""
    fit: Fit
    rise: float
    """Rise of the deviance above that of the named set."""
    needed: float
    """Rise from which on the effect is excluded."""

    @property
    def excluded(self) -> bool:
        """Whether the effect is excluded at this strength, validly at every look."""
        return self.rise >= self.needed

    @property
    def favoured(self) -> bool:
        """Whether the data favour the effect by two standard deviations: then it is not out of the plan's reach."""
        return self.rise <= -DEFAULT.not_excluded

    @property
    def e_value(self) -> float:
        """Likelihood ratio of the named set to this one."""
        return math.exp(min(0.5 * self.rise, 700.0))


def added_effects(
    search: EffectSearch, named: Fit, alpha: float, share: float, more: Sequence[str]
) -> list[AddedEffect]:
    """Each of the effects ``more`` added to the named set, at a fraction of its usual strength."""
    sets = [search.extended(named.effects, [name])[0] for name in more]
    held = [_held(search, name, named.effects, share) for name in more]
    fits = search.near([search.model(names, at) for names, at in zip(sets, held, strict=True)], named)
    needed = excluding_rise(named, alpha)
    return [
        AddedEffect(name, share, fit, fit.deviance - named.deviance, needed)
        for name, fit in zip(more, fits, strict=True)
    ]


def excluding_rise(named: Fit, alpha: float) -> float:
    """Rise of the deviance that excludes: 2 ln(1/α), more if replicates are few or cell means are overdispersed."""
    dof = int(named.cells.pure_error_dof.sum())
    tail = chi2_sf(2 * math.log(1 / alpha), 1)
    return overdispersion(named) * (f_isf(tail, 1, dof) if dof else math.inf)


def _held(search: EffectSearch, name: str, named: Names, share: float) -> dict[str, float]:
    """Values at which the effect's parameters are held: the usual ones, with the strength at a fraction of its own."""
    strength = dict(search.strengths(named)).get(name)
    usual = {f"{name}.{parameter.name}": parameter.start for parameter in search.effects[name].parameters}
    if strength is not None and strength.neutral is not None:
        usual[f"{name}.{strength.name}"] = strength.neutral + share * (strength.start - strength.neutral)
    return usual
