"""Each single effect compared with the base model, and the BIC weight of the sets that contain it."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from sandbot_model.discovery.criteria import Criteria
from sandbot_model.discovery.verdict import (
    Names,
    Sets,
    doubtful_values,
    gains_enough,
    leaves_nothing,
    sound,
    why_not_claimed,
)
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.effect import Effect

HEAVY = 0.5
"""Weight of the sets with an effect from which an adequate verdict says why it is not claimed."""


@dataclass(frozen=True)
class Candidate:
    """Changes when one effect is added to the base model (negative: better), and the weight of the sets with it."""

    effect: str
    stage: str
    delta_chi2: float
    delta_bic: float
    cv_rmse_m_s: float
    cv_cells: int
    weight: float


def candidates(fits: Sets, effects: Mapping[str, Effect]) -> list[Candidate]:
    """All effects that were fitted alone, in order of BIC."""
    base, weights = fits[()], bic_weights(fits)
    found = []
    for name, effect in effects.items():
        if (single := fits.get((name,))) is not None:
            change, cv = (single.deviance - base.deviance, single.bic - base.bic), single.cross_validation
            weight = _weight_with(name, weights)
            found.append(Candidate(name, effect.stage, *change, cv.rmse["speed"], cv.cells, weight))
    return sorted(found, key=lambda candidate: candidate.delta_bic)


def only_implausible(found: Iterable[Candidate], fits: Iterable[Fit], criteria: Criteria) -> dict[str, str]:
    """Of the single effects that lower the BIC and leave no lack of fit but can't be named, effect → the implausible
    values at which they do."""
    helpful = {(one.effect,) for one in found if one.delta_bic < 0}
    suffice = [fit for fit in fits if fit.effects in helpful and leaves_nothing(fit, criteria)]
    return {fit.effects[0]: values for fit in suffice if (values := doubtful_values(fit))}


def nearly_claimed(fits: Sets, criteria: Criteria) -> Fit | None:
    """An effect that is not claimed although the sets with it outweigh all others; None if there is none such."""
    weights = bic_weights(fits)
    for key, fit in fits.items():
        heavy = len(key) == 1 and _weight_with(key[0], weights) > HEAVY
        if heavy and sound(fit) and not gains_enough(fits, key, (), criteria):
            return fit
    return None


def what_it_lacks(fits: Sets, criteria: Criteria) -> str:
    """What such an effect lacks for a claim; empty if there is none."""
    fit = nearly_claimed(fits, criteria)
    return f"{fit.effects[0]} {why_not_claimed(fits, fit, criteria)}" if fit else ""


def _weight_with(name: str, weights: Mapping[Names, float]) -> float:
    """Weight of all sets with an effect."""
    return sum(value for names, value in weights.items() if name in names)


def bic_weights(fits: Sets) -> dict[Names, float]:
    """exp(-ΔBIC/2), normalised over all sets tried."""
    scores = np.array([fit.bic for fit in fits.values()])
    weights = np.exp(-0.5 * np.minimum(scores - scores.min(), 1400.0))
    return dict(zip(fits, (weights / weights.sum()).tolist(), strict=True))
