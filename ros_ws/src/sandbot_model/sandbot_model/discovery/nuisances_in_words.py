"""Nuisances described in words and in a reader's units."""

from sandbot_model.data.conditions import Cells
from sandbot_model.discovery.nuisances_about import DRIFT, LIFT_SCALE, LIFT_ZERO, SPEED_SCALE, run_in_order_of
from sandbot_model.fitting.fit import Fit

WORDS = {
    DRIFT: ("a drift of k", 1e2, "%"),
    SPEED_SCALE: ("a speed-scale error", 1e2, "%"),
    LIFT_ZERO: ("a lift-zero error", 1e3, "mm"),
    LIFT_SCALE: ("a lift-scale error", 1e2, "%"),
}
"""Description, factor from SI, and unit of each nuisance."""
SHOWS = 2.0
"""Standard errors above which a nuisance is mentioned."""


def significant(fit: Fit) -> list[str]:
    """Drift, zero and scale of a fit that exceed twice their standard error, in words."""
    if fit.nuisances is None:
        return []
    return [
        in_words(name, value, stderr, sd)
        for name, sd, (value, stderr) in zip(fit.nuisances.names, fit.nuisances.sd, fit.shared, strict=True)
        if name in WORDS and abs(value) > SHOWS * stderr
    ]


def in_words(name: str, value: float, stderr: float, sd: float) -> str:
    """A nuisance and its prior in a reader's units: ``a lift-zero error of 0.98 ± 0.05 mm (prior 0.6 mm)``."""
    what, scale, unit = WORDS[name]
    return f"{what} of {scale * value:.2g} ± {scale * stderr:.1g} {unit} (prior {scale * sd:.1g} {unit})"


def confounded_drift(cells: Cells) -> str:
    """What a drift looks like if trials were run in order of ω or φ; empty if they were not, or no order is known."""
    axis = run_in_order_of(cells)
    like = {"ω": "a dependence on ω", "φ": "part of k(φ)"}
    return f"trials were run in order of {axis}, so a drift of the bed looks like {like[axis]}" if axis else ""
