"""Refusal of a claim from a single observable, where something without physics explains as much.

Many formulas change one quantity in the same way, and an offset for every cell mean absorbs any of them.
"""

import numpy as np

from sandbot_model.discovery.batch_sd import batch_sd_of
from sandbot_model.discovery.smooth import smooth_gain
from sandbot_model.discovery.verdict import EXPLAINS_ALL, Sets, Verdict
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.observables import Observable


def refused_from_one_observable(verdict: Verdict, fits: Sets) -> Verdict | None:
    """The refusal of a claim if only one observable was measured, and either a smooth discrepancy explains as much or
    the claim needs a bed that scatters between conditions; else None."""
    base = fits[()]
    if verdict.status not in EXPLAINS_ALL or len(base.cells.observables) != 1:
        return None
    seen, named = Observable[base.cells.observables[0]], fits[verdict.effects]
    why = _smooth_does_as_well(base, named, seen) or _needs_a_scattering_bed(named, seen)
    if not why:
        return None
    others = ", ".join(other.label for other in Observable if other is not seen)
    because = f"{' + '.join(verdict.effects)} would repair it{why}; measure {others} too"
    return Verdict("unexplained", (), (), because)


def _smooth_does_as_well(base: Fit, named: Fit, seen: Observable) -> str:
    smooth, gain = smooth_gain(base, seen), base.bic - named.bic
    if gain > smooth:
        return ""
    return (
        f" (BIC falls by {gain:.0f}), but so does any smooth change of {seen.label} over φ and ω (a Gaussian process: "
        f"{smooth:.0f}): from {seen.label} alone nothing can be named"
    )


def _needs_a_scattering_bed(named: Fit, seen: Observable) -> str:
    share = named.cells.batch_share
    by_condition = share is None or np.median((share > 0).sum(axis=0)) <= 1
    if named.nuisances is None or not by_condition or not batch_sd_of(named).ln_k:
        return ""
    return (
        ", but only on a bed that scatters from condition to condition, and from "
        f"{seen.label} alone such a bed can't be told from what a model misses"
    )
