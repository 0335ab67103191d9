"""Nothing in the catalogue fits: what the residual looks like in the field's terms, as a formula to try.

The ratio of measured to modelled advance, v̄/v̄_model, is regressed on a short library of dimensionless groups, one term,
then two, as long as the information criterion gains. The result is an expression for ``--effect`` at the speed stage.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from sandbot_model.chain import Array
from sandbot_model.fit import Fit

MOST_TERMS = 2
WORTH = 10.0
"""Gain in χ² + penalty below which a term is not reported."""


@dataclass(frozen=True)
class Description:
    """``sentence`` for a person, ``formula`` for ``--effect``; terms with their coefficients."""

    sentence: str
    formula: str
    terms: tuple[tuple[str, float], ...]
    explained: float
    """Share of the speed's χ² about the model that the terms take away."""


def library(fit: Fit) -> dict[str, tuple[str, str, Array]]:
    """name → (in words, expression for ``--effect``, values ``(cells,)``)."""
    cells, robot = fit.cells, fit.fitted.robot
    radius, g = robot.leg_radius_m, robot.gravity_m_s2
    found = fit.predict(cells.level_phi[cells.level], cells.omega, cells.slow_phase_ratio)
    delta_t = fit.parameters["delta_t_s"].value
    one = np.ones(len(cells))
    resonance = {
        f"near {w:g} rad/s": (
            f"near ω = {w:g} rad/s",
            f"exp(-((omega - {w:g})/3)**2)",
            np.exp(-(((cells.omega - w) / 3) ** 2)),
        )
        for w in np.unique(np.round(cells.omega, 1))
    }
    return {
        "constant": ("everywhere alike", "1", one),
        "froude": ("Rω²/g", "R*omega**2/g", radius * cells.omega**2 / g),
        "omega_dt": ("ωΔt", "omega*delta_t", cells.omega * delta_t),
        "depth": ("d/R", "d/R", found.depth_m / radius),
        "step": ("s/R", "chord/R", found.step_m / radius),
        "phi": ("φ - 0.6", "(phi - 0.6)", cells.level_phi[cells.level] - 0.6),
        **resonance,
    }


def describe_residual(fit: Fit) -> Description | None:
    """The terms that say most of what the model misses in the mean speed of walking cells; None if nothing does."""
    ratio = fit.cells.mean[:, 0] / fit.predicted[:, 0] - 1
    error = fit.cells.sem[:, 0] / fit.predicted[:, 0]
    terms = library(fit)
    usable = np.isfinite(ratio) & np.isfinite(terms["depth"][2]) & (fit.predicted[:, 0] > 0.04)
    if usable.sum() < 8:
        return None
    target = ratio[usable] / error[usable]
    columns = {name: values[usable] / error[usable] for name, (_, _, values) in terms.items()}
    whole = float(target @ target)
    chosen: tuple[str, ...] = ()
    best, coefficients = whole, np.zeros(0)
    for size in range(1, MOST_TERMS + 1):
        trials = [(names, *_regress(target, [columns[n] for n in names])) for names in combinations(columns, size)]
        names, chi2, values = min(trials, key=lambda one: one[1])
        if best - chi2 < WORTH + np.log(usable.sum()) * (size - len(chosen)):
            break
        best, chosen, coefficients = chi2, names, values
    if not chosen:
        return None
    found = tuple((name, float(value)) for name, value in zip(chosen, coefficients, strict=True))
    share = 1 - best / whole
    words = " and ".join(f"{terms[name][0]} (coefficient {value:+.3g})" for name, value in found)
    body = " + ".join(f"c{i}*{terms[name][1]}" for i, (name, _) in enumerate(found))
    ranges = "; ".join(f"c{i} [1] in {-2 * abs(value):.3g}..{2 * abs(value):.3g}" for i, (_, value) in enumerate(found))
    sentence = (
        f"where it walks, the advance differs from the model's in proportion to {words}: {100 * share:.0f} % of χ²"
    )
    return Description(sentence, f"residual: speed: kept*(1 + {body}); {ranges}", found, share)


def _regress(target: Array, columns: list[Array]) -> tuple[float, Array]:
    design = np.stack(columns, axis=-1)
    values = np.linalg.lstsq(design, target, rcond=None)[0]
    return float(np.sum((target - design @ values) ** 2)), np.asarray(values)
