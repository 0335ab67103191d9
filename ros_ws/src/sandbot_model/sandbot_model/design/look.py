"""One look at a running campaign: the verdict so far, whether it is enough, and what to run next if not."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from sandbot_model.data.conditions import Cells
from sandbot_model.design.block import block
from sandbot_model.design.curves import Curve, curves
from sandbot_model.design.discrepancy import something_else
from sandbot_model.design.evidence import USUAL, WEAK, AddedEffect, added_effects, at_every_look, lack_of_fit_at
from sandbot_model.design.explanations import explained_by
from sandbot_model.design.places import Places
from sandbot_model.design.reach import gains_over
from sandbot_model.design.reason import because
from sandbot_model.design.start import Condition
from sandbot_model.discovery.criteria import DEFAULT, Criteria
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.power import Z
from sandbot_model.discovery.result import Discovery
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
"""Most explanations that a block discriminates between, in addition to ``something_else``."""
ENOUGH = "every other effect that this plan can show at its usual strength is excluded"
ALIKE = "no trials of this plan would tell them apart"
REFUSED = "no set of the catalogue can come back from this"


@dataclass(frozen=True)
class Plan:
    """What can be run, and what it costs.

    ``conditions``: where trials can be run. ``cost_s``: the cost of a trial in each, including the bed. ``replicates``:
    trials per condition in the whole plan, which define what is within reach; a block may repeat a condition more often
    where that is more informative. ``gait``: that of all trials; empty: that of most trials so far.
    """

    conditions: Sequence[Condition]
    cost_s: Callable[[Condition], float]
    replicates: int
    gait: str = ""


@dataclass(frozen=True)
class Chosen:
    """A condition chosen for a trial, and why."""

    phi: float
    omega_rad_s: float
    because: str


@dataclass(frozen=True, eq=False)
class Look:
    """The result of one look. ``stop`` says why the campaign may end; if empty, it continues with ``block``."""

    found: Discovery
    possible: tuple[AddedEffect, ...]
    """Effects tested in addition to those named, the least excluded first."""
    within_reach: tuple[str, ...]
    """Those of them that are not settled yet and that the plan can settle."""
    stop: str
    block: tuple[Chosen, ...]
    rivals: tuple[Curve, ...] = ()
    """Predictions, at the block's φ, of the explanations that the block discriminates between."""

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
                    "effect": tested.effect,
                    "share_of_usual": tested.share,
                    "e_value_against": number(tested.e_value),
                    "excluded": tested.excluded,
                    "within_reach": tested.effect in self.within_reach,
                }
                for tested in self.possible
            ],
            "stop": self.stop,
            "next": [vars(trial) for trial in self.block],
            "rivals": [asdict(curve) for curve in self.rivals],
        }

    def __str__(self) -> str:
        """One line for the operator."""
        verdict = f"{self.found.cells.trials} trials: {self.found.headline}"
        if self.stop:
            return f"{verdict}; {self.stop}"
        unsettled = f", perhaps with {' or '.join(self.within_reach)}" if self.within_reach else ""
        first = self.block[0]
        where = f"φ {first.phi:.3f}, ω {first.omega_rad_s:.3g} rad/s"
        return f"{verdict}{unsettled}; next: {where}, because {first.because}"


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
    """Judge the trials so far, ``number`` counting looks from 1, and choose the next block.

    The verdict is ``discover``'s, with a ``claim`` that is valid at every look. A campaign may stop if effects are
    named, none is missing, or the plan can't separate the sets left, and every other effect that the plan can show is
    excluded; or if lack of fit rejects all sets for good.
    """
    criteria = at_every_look(alpha, len(effects), criteria)
    found = discover(cells, effects, base=base, max_effects=max_effects, criteria=criteria, fit_all=fit_all)
    places = Places.of(plan.conditions, found.fit, plan.gait)
    possible: list[AddedEffect] = []
    open_ones: list[AddedEffect] = []
    match found.verdict.status:
        case "adequate" | "identified" | "ambiguous":
            equivalent = _equivalent(found)
            if _separable(equivalent, places, plan, criteria.clearly):
                rivals, stop = equivalent, ""
            else:
                catalogue = {**effects, **found.fit.model.catalogue}
                search = EffectSearch(cells, catalogue, base, criteria=criteria, fit_all=fit_all)
                possible, open_ones = _possible(search, found.fit, places, plan, alpha)
                rivals = [*equivalent, *(added.fit for added in open_ones)]
                stop = "" if open_ones else ENOUGH if len(equivalent) == 1 else ALIKE
        case status:
            rivals = [fit for fit in found.fits if sound(fit)] or [found.fit]
            refused = status != "untested" and max(fit.lack_of_fit_p for fit in rivals) < lack_of_fit_at(number, alpha)
            stop = REFUSED if refused else ""
    rivals = rivals[:RIVALS]
    block = () if stop else _next_block(rivals, places, plan, criteria)
    drawn = curves(rivals, {trial.phi for trial in block}, [omega for _, omega in plan.conditions], places.clock)
    return Look(found, tuple(possible), tuple(added.effect for added in open_ones), stop, block, drawn)


def _equivalent(found: Discovery) -> list[Fit]:
    """The set that the verdict names, and its alternatives, which explain the data equally well."""
    others = found.verdict.alternatives[1:]
    return [found.fit, *(next(fit for fit in found.fits if fit.effects == names) for names in others)]


def _possible(
    search: EffectSearch, named: Fit, places: Places, plan: Plan, alpha: float
) -> tuple[list[AddedEffect], list[AddedEffect]]:
    """Every effect that is not named, the least excluded first, at weak strength where the plan can show that, else at
    usual strength; then those of them that are still open.

    An effect is open if the data favour it, or if it is not excluded and the whole plan would exclude it in nine
    campaigns of ten.
    """
    gain = gains_over(named, places, plan.replicates)

    def is_open(added: AddedEffect) -> bool:
        return added.favoured or (not added.excluded and gain(added.fit) > (math.sqrt(added.needed) + Z) ** 2)

    more = [name for name in search.names if name not in named.effects]
    weak = added_effects(search, named, alpha, WEAK, more)
    open_ones = [added for added in weak if is_open(added)]
    too_weak = [added for added in weak if not added.excluded and added not in open_ones]
    usual = added_effects(search, named, alpha, USUAL, [added.effect for added in too_weak])
    open_ones += [added for added in usual if is_open(added)]
    shown = [added for added in weak if added not in too_weak]
    return sorted([*shown, *usual], key=_rise), sorted(open_ones, key=_rise)


def _rise(added: AddedEffect) -> float:
    return added.rise


def _separable(fits: Sequence[Fit], places: Places, plan: Plan, clearly: float) -> bool:
    """Whether the whole plan would separate the first of these fits from any of the others."""
    gain = gains_over(fits[0], places, plan.replicates)
    return any(gain(other) > (math.sqrt(clearly) + Z) ** 2 for other in fits[1:])


def _next_block(rivals: Sequence[Fit], places: Places, plan: Plan, criteria: Criteria) -> tuple[Chosen, ...]:
    """The block that best discriminates between the rivals and a smooth discrepancy on top of the first."""
    explanations = [explained_by(fit, places) for fit in rivals]
    explanations.append(something_else(rivals[0], places, criteria.gross))
    chosen = block(explanations, np.array([plan.cost_s(condition) for condition in plan.conditions]), BLOCK)
    return tuple(Chosen(*plan.conditions[place], because(explanations, place)) for place in chosen)
