"""Open the virtual lab's sealed world after the analysis, and judge whether the verdict was right."""

from dataclasses import dataclass
from typing import Any

from sandbot_bringup.plan import Plan
from sandbot_lab.world import World


def truth_of(world: World, plan: Plan) -> frozenset[str]:
    """The effects really present: those of the world, and the slow phase if the gait has one.

    If the clock signal's stance is slower than the mean rate, the legs push at the slower rate without any effect in
    the world file.
    """
    slow = {"slow_phase_speed"} if abs(plan.clock_gait.slow_phase_ratio - 1) > 0.01 else set()
    return frozenset(world.effects) | slow


@dataclass(frozen=True)
class Agreement:
    """Whether the verdict names the truth; ``line`` explains it in one sentence."""

    agrees: bool
    line: str


def judge(truth: frozenset[str], verdict: dict[str, Any]) -> Agreement:
    """Compare the effects really present with a discovery's ``verdict`` (schema sandbot.discovery/1 or /2).

    Right verdicts are: adequate if nothing is hidden; identified with exactly the hidden set; ambiguous with the hidden
    set among the alternatives; partial with hidden effects only, or with such an alternative. Everything else is wrong,
    including ``unexplained`` and ``untested``.
    """
    status = verdict["status"]
    named = frozenset(verdict["effects"])
    alternatives = {frozenset(effects) for effects in verdict.get("alternatives", [])} | {named}
    hidden = _names(truth)
    if status == "adequate":
        return Agreement(not truth, f"the sealed truth holds {hidden}; the verdict was that nothing is missing")
    if status == "identified":
        return Agreement(named == truth, f"the sealed truth holds {hidden}; the verdict named {_names(named)}")
    if status == "partial":
        part = any(one <= truth for one in alternatives)
        named_ones = " or ".join(sorted(map(_names, alternatives)))
        return Agreement(part, f"the sealed truth holds {hidden}; the verdict was that {named_ones} is part of it")
    if status == "ambiguous":
        among = truth in alternatives
        where = "among" if among else "not among"
        return Agreement(among, f"the sealed truth holds {hidden}, {where} the {len(alternatives)} sets left open")
    if status == "untested":
        return Agreement(False, f"the sealed truth holds {hidden}; the verdict was that nothing could be tested")
    return Agreement(False, f"the sealed truth holds {hidden}; the verdict was that no set of the catalogue fits")


def _names(effects: frozenset[str]) -> str:
    return " + ".join(sorted(effects)) or "no effect"
