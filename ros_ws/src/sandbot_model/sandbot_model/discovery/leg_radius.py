"""Legs of another radius than robot.yaml says, where they explain as much as a calibration error or several effects.

A wrong radius changes speed, peak and lift together, and a speed scale of several priors' standard deviations, or two
effects, take up most of that. The radius is no nuisance of every fit: it is left free only where this question arises.
"""

from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from sandbot_common.errors import InputError
from sandbot_common.robot import Robot
from sandbot_model.discovery.batch_sd import ALIKE, batch_sd_of
from sandbot_model.discovery.calibration_error import has_rival
from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.nuisances_about import LIFT_ZERO, SPEED_SCALE, nuisances_for
from sandbot_model.discovery.plausibility import DIFFERENT
from sandbot_model.discovery.sharing import Judged
from sandbot_model.discovery.verdict import EXPLAINS_ALL, either, parts_of, passes
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.nuisances import Nuisances
from sandbot_model.physics.observables import CM

SUSPECT = 2.0
"""Standard deviations: of its prior, from which a zero or scale may be a wrong radius; of the radius, from which it is
another one than robot.yaml's."""
RADII = 1.0 + np.linspace(-DIFFERENT, DIFFERENT, 25)
"""Radii tried, over that of robot.yaml; beyond them ``plausibility`` doubts it."""
MOST_PARTS = 5
"""Parts of the claimed sets, those common to most of them, that are fitted with a free radius."""


@dataclass(frozen=True)
class Legs:
    """The fit of a model at the best leg radius, and that radius with its standard error."""

    fit: Fit
    radius_m: float
    stderr_m: float

    def in_words(self, given: Robot) -> str:
        """``legs of 3.73 ± 0.02 cm instead of robot.yaml's 3.55 cm``, and the effects that these need besides."""
        beside = f", with {' + '.join(self.fit.effects)}," if self.fit.effects else ""
        value = f"{CM * self.radius_m:.2f} ± {max(CM * self.stderr_m, 0.01):.2f}"
        return f"legs of {value} cm instead of robot.yaml's {CM * given.leg_radius_m:.3g} cm{beside}"


def instead_of_a_reading(search: EffectSearch, named: Fit) -> Legs | None:
    """Legs of another radius in place of a zero or scale beyond ``SUSPECT``, if they explain as much as these do
    without their priors; else None."""
    own = named.nuisances
    off = 0.0 if own is None else sum(cost for cost in _costs(named) if cost > SUSPECT**2)
    legs = _with_free_radius(search, named, own) if own is not None and off else None
    return legs if legs and legs.fit.deviance <= named.deviance - off else None


def instead_of_effects(search: EffectSearch, found: Judged) -> str:
    """Legs of another radius, in one clause, if with them fewer effects explain as much as the claim, or if they
    explain what no set does; else empty."""
    claimed = found.verdict.alternatives if found.verdict.status in EXPLAINS_ALL else ()
    if claimed and not _may_be_legs(search, found):
        return ""
    parts = Counter(part for names in claimed for part in parts_of(names, search.fits) if part)
    batch_sd = batch_sd_of(found.named) if found.named.nuisances else ALIKE
    for part in ((), *(part for part, _ in parts.most_common(MOST_PARTS))):
        fit = search.fits[part]
        legs = _with_free_radius(search, fit, nuisances_for(fit, search.criteria, batch_sd))
        if legs and passes(legs.fit, search.criteria) and not (claimed and _fits_worse(legs.fit, found.named)):
            much = f"explain as much as {either(claimed)}" if claimed else "would leave nothing to explain"
            return f"{legs.in_words(search.cells.robot)} {much}: measure them"
    return ""


def _may_be_legs(search: EffectSearch, found: Judged) -> bool:
    """Whether a wrong radius may look like a claim: it is of several effects, or a calibration error looks like it."""
    several = max(map(len, found.verdict.alternatives)) > 1
    return several or max(_costs(found.named), default=0.0) > SUSPECT**2 or has_rival(search, found.named)


def _fits_worse(fit: Fit, claimed: Fit) -> bool:
    """Whether a fit with a free radius, one more parameter, has the higher BIC."""
    return fit.bic + float(np.log(fit.problem.values)) > claimed.bic


def _costs(fit: Fit) -> list[float]:
    """What the priors of zero and scale add to a fit's deviance, (value/sd)² each."""
    own = fit.nuisances
    named = zip(own.names, own.sd.tolist(), fit.shared, strict=True) if own else ()
    return [(value / sd) ** 2 for name, sd, (value, _) in named if name in (LIFT_ZERO, SPEED_SCALE)]


def _with_free_radius(search: EffectSearch, fit: Fit, nuisances: Nuisances) -> Legs | None:
    """The fit at its best radius; None if that is at an end of the range, or hardly better than robot.yaml's."""
    robots = list(_robots(search.cells.robot))
    models = [replace(fit.model, robot=robot) for robot in robots]
    fits = search.near(models, fit, nuisances)
    deviance = np.array([one.deviance for one in fits])
    best = int(np.argmin(deviance))
    given = deviance[robots.index(search.cells.robot)]
    if best in (0, len(fits) - 1) or given - deviance[best] <= SUSPECT**2:
        return None
    radii, weight = np.array([robot.leg_radius_m for robot in robots]), np.exp(-0.5 * (deviance - deviance[best]))
    mean = float(np.average(radii, weights=weight))
    step = radii[best] - radii[best - 1]
    return Legs(fits[best], mean, float(np.sqrt(np.average((radii - mean) ** 2, weights=weight) + step**2 / 12)))


def _robots(robot: Robot) -> Iterator[Robot]:
    """Robots with the radii tried, as far as they are possible."""
    for share in RADII.tolist():
        with suppress(InputError):
            yield replace(robot, leg_radius_m=share * robot.leg_radius_m)
