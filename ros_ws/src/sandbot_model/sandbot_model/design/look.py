"""One look at a campaign that is under way: what is known, whether that is enough, and what to run next if not."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from sandbot_model.data.conditions import Cells
from sandbot_model.design.block import block
from sandbot_model.design.curves import Curve, curves
from sandbot_model.design.discrepancy import something_else
from sandbot_model.design.evidence import USUAL, WEAK, Possible, at_every_look, lack_of_fit_at, possible_beside
from sandbot_model.design.explanations import explained_by
from sandbot_model.design.places import Places
from sandbot_model.design.reach import gains_over
from sandbot_model.design.reason import because
from sandbot_model.design.start import Condition
from sandbot_model.discovery.criteria import DEFAULT, Criteria
from sandbot_model.discovery.discover import Discovery, discover
from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.power import Z
from sandbot_model.discovery.verdict import sound
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.parallel import Map
from sandbot_model.fitting.plain import number
from sandbot_model.physics.effect import Effect

ALPHA = 0.02
"""Probability of a false claim over all looks at a campaign."""
BLOCK = 6
"""Trials between two looks."""
RIVALS = 6
"""Explanations between which a block decides, besides something else."""
ENOUGH = "every other effect that this plan can show at its usual strength is excluded"
ALIKE = "no trials of this plan would tell them apart"
REFUSED = "no set of the catalogue can come back from this"


@dataclass(frozen=True)
class Plan:
    """What can be run, and what it costs.

    ``conditions``: where trials can be run. ``cost_s``: what one costs at each, bed and all. ``replicates``: how often
    each would be run if all of it were; what that would not show is out of reach. A block may run one more often, where
    that says more than another. ``gait``: of all its trials; empty: that of most there have been.
    """

    conditions: Sequence[Condition]
    cost_s: Callable[[Condition], float]
    replicates: int
    gait: str = ""


@dataclass(frozen=True)
class Chosen:
    """A trial to run, and why there."""

    phi: float
    omega_rad_s: float
    because: str


@dataclass(frozen=True, eq=False)
class Look:
    """What one look found. ``stop`` says why the campaign may end; empty: it goes on with ``block``."""

    found: Discovery
    possible: tuple[Possible, ...]
    """What may be there beside that which is named, if anything is; the least excluded first."""
    within_reach: tuple[str, ...]
    """Those of them that the plan can still exclude."""
    stop: str
    block: tuple[Chosen, ...]
    rivals: tuple[Curve, ...] = ()
    """What the explanations between which the block decides say of its φ."""

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        verdict = self.found.verdict
        return {
            "trials": self.found.cells.trials,
            "status": verdict.status,
            "effects": list(verdict.effects),
            "alternatives": list(map(list, verdict.alternatives)),
            "because": verdict.because,
            "possible": [
                {
                    "effect": one.effect,
                    "share_of_usual": one.share,
                    "e_value_against": number(one.e_value),
                    "excluded": one.excluded,
                    "within_reach": one.effect in self.within_reach,
                }
                for one in self.possible
            ],
            "stop": self.stop,
            "next": [vars(one) for one in self.block],
            "rivals": [asdict(one) for one in self.rivals],
        }

    def __str__(self) -> str:
        """One line for the operator."""
        verdict = f"{self.found.cells.trials} trials: {self.found.headline}"
        if self.stop:
            return f"{verdict}; {self.stop}"
        left = f", perhaps with {' or '.join(self.within_reach)}" if self.within_reach else ""
        first = self.block[0]
        return f"{verdict}{left}; next: φ {first.phi:.3f}, ω {first.omega_rad_s:.3g} rad/s, because {first.because}"


def look(
    cells: Cells,
    effects: Mapping[str, Effect],
    plan: Plan,
    *,
    number: int,
    base: str = "simple",
    alpha: float = ALPHA,
    max_effects: int = 2,
    criteria: Criteria = DEFAULT,
    fit_all: Map = map,
) -> Look:
    """Judge what there is, ``number`` 1 at the first look, and choose the next block.

    The verdict is ``discover``'s, at a ``claim`` that holds at every look. It is enough where something is named, or
    nothing missing, or sets are left that no trials of the plan would tell apart, and everything else that the plan can
    show is excluded beside it; or where lack of fit refuses all there is for good.
    """
    criteria = at_every_look(alpha, len(effects), criteria)
    found = discover(cells, effects, base=base, max_effects=max_effects, criteria=criteria, fit_all=fit_all)
    places = Places.of(plan.conditions, found.fit, plan.gait)
    possible: list[Possible] = []
    open_ones: list[Possible] = []
    match found.verdict.status:
        case "adequate" | "identified" | "ambiguous":
            alike = _alike(found)
            if _differ(alike, places, plan, criteria.clearly):
                rivals, stop = alike, ""
            else:
                catalogue = {**effects, **found.fit.model.catalogue}
                search = EffectSearch(cells, catalogue, base, criteria=criteria, fit_all=fit_all)
                possible, open_ones = _possible(search, found.fit, places, plan, alpha)
                rivals = [*alike, *(one.fit for one in open_ones)]
                stop = "" if open_ones else ENOUGH if len(alike) == 1 else ALIKE
        case status:
            rivals = [fit for fit in found.fits if sound(fit)] or [found.fit]
            refused = status != "untested" and max(fit.lack_of_fit_p for fit in rivals) < lack_of_fit_at(number, alpha)
            stop = REFUSED if refused else ""
    rivals = rivals[:RIVALS]
    block = () if stop else _next(rivals, places, plan, criteria)
    drawn = curves(rivals, {one.phi for one in block}, [omega for _, omega in plan.conditions], places.clock)
    return Look(found, tuple(possible), tuple(one.effect for one in open_ones), stop, block, drawn)


def _alike(found: Discovery) -> list[Fit]:
    """What the verdict names, and the other sets that explain the data alike."""
    others = found.verdict.alternatives[1:]
    return [found.fit, *(next(fit for fit in found.fits if fit.effects == names) for names in others)]


def _possible(
    search: EffectSearch, named: Fit, places: Places, plan: Plan, alpha: float
) -> tuple[list[Possible], list[Possible]]:
    """Every effect that is not named, the least excluded first: a weak one where the plan can show it, else a usual.

    Then those that are still open: the data speak for them, or they are not excluded, and the whole of the plan would
    exclude them in nine campaigns of ten.
    """
    gain = gains_over(named, places, plan.replicates)

    def is_open(one: Possible) -> bool:
        return one.spoken_for or (not one.excluded and gain(one.fit) > (math.sqrt(one.needed) + Z) ** 2)

    more = [name for name in search.names if name not in named.effects]
    weak = possible_beside(search, named, alpha, WEAK, more)
    open_ones = [one for one in weak if is_open(one)]
    faint = [one for one in weak if not one.excluded and one not in open_ones]
    usual = possible_beside(search, named, alpha, USUAL, [one.effect for one in faint])
    open_ones += [one for one in usual if is_open(one)]
    shown = [one for one in weak if one not in faint]
    return sorted([*shown, *usual], key=_rise), sorted(open_ones, key=_rise)


def _rise(one: Possible) -> float:
    return one.rise


def _differ(alike: Sequence[Fit], places: Places, plan: Plan, clearly: float) -> bool:
    """Whether the whole of the plan would tell the best of some sets from any other."""
    gain = gains_over(alike[0], places, plan.replicates)
    return any(gain(other) > (math.sqrt(clearly) + Z) ** 2 for other in alike[1:])


def _next(rivals: Sequence[Fit], places: Places, plan: Plan, criteria: Criteria) -> tuple[Chosen, ...]:
    """The block that decides between sets and something else that is smooth, on top of the first."""
    explanations = [explained_by(fit, places) for fit in rivals]
    explanations.append(something_else(rivals[0], places, criteria.gross))
    chosen = block(explanations, np.array([plan.cost_s(one) for one in plan.conditions]), BLOCK)
    return tuple(Chosen(*plan.conditions[place], because(explanations, place)) for place in chosen)
