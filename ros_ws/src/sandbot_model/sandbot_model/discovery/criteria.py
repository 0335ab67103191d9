"""Thresholds for claiming an effect: every number of the verdict that is a matter of policy."""

from dataclasses import dataclass, fields, replace

import numpy as np

from sandbot_common.errors import InputError
from sandbot_common.typed import is_a
from sandbot_model.fitting.thresholds import GROSS, LACK_OF_FIT


@dataclass(frozen=True)
class Criteria:
    """Thresholds of the verdict. Raises InputError for a value outside its range.

    The defaults are calibrated on worlds where nothing is missing (benchmarks/hidden.md): a higher ``claim`` misses
    more effects that are present, a lower one claims more that are absent.
    """

    lack_of_fit: float = LACK_OF_FIT
    """p-value of the joint lack-of-fit test below which a model is rejected."""
    lack_of_fit_of_one: float = 3e-4
    """The same for the test of each of the four observables."""
    gross: float = GROSS
    """Misfit of every cell mean, in standard errors, that the lack-of-fit test must be able to detect; if pure error is
    known too poorly for that, the verdict is untested."""
    claim: float = 22.0
    """Gain in deviance that each effect must bring. The best of some 25 absent effects gains as much in less than 1 %
    of worlds where nothing is missing."""
    lone_trials: float = 0.05
    """Largest fraction of the conditions that may be left out as unreplicated outliers."""
    one_cell: float = 0.5
    """Fraction of the claim that must remain without the cell that gains most: no effect rests on a single cell."""
    clearly: float = 10.0
    """Difference in BIC from which one set of effects is clearly worse than another (weights of 150 to 1)."""
    term: float = 22.0
    """Gain in deviance for each coefficient or threshold of a formula suggested for the remaining misfit. Where nothing
    is missing, the best of some 500 terms gains as much in 1 of 10,000 campaigns (20,000 drawn to first order)."""
    not_excluded: float = 4.0
    """Rise of the deviance up to which an effect at its usual strength is not excluded: two standard deviations."""
    telling_sd: float = 0.5
    """Expected gap, in standard deviations of one trial, from which more trials are worthwhile."""
    bed_scatter: float = 0.007
    """Prior of σ_b, the relative scatter of k between batches: scale of a half-normal. Beds have 0.3 to 1 %."""
    drift: float = 0.03
    """Prior standard deviation of the relative drift of k over a campaign."""
    all_but_a_rest: float = 0.9
    """Fraction of the excess deviance an effect must remove to be named if the rest shows in several observables."""
    shared: float = 6.0
    """Gain in -2 ln likelihood from which batches are assumed to differ."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value, most = getattr(self, field.name), 1.0 if field.name in SHARES else np.inf
            if not is_a(value, field.type) or not 0.0 < value < most:
                raise InputError(f"criteria: {field.name} is {value!r}; a number between 0 and {most:g} is needed")


SHARES = ("lack_of_fit", "lack_of_fit_of_one", "lone_trials", "one_cell", "all_but_a_rest")
"""Criteria that are probabilities or shares."""
DEFAULT = Criteria()
WIDEST = 0.3
"""Largest relative scatter or drift of a bed that is accepted as input."""


def of_bed(scatter: float | None, drift: float | None) -> Criteria:
    """The default criteria, with known scatter or drift of a bed in place of the usual priors. Raises InputError."""
    given = {"bed_scatter": scatter, "drift": drift}
    known = {name: value for name, value in given.items() if value is not None}
    for name, value in known.items():
        if not 0.0 < value <= WIDEST:
            option = "--bed-scatter" if name == "bed_scatter" else "--bed-drift"
            raise InputError(f"{option} {value:g}: a fraction above 0 and up to {WIDEST:g} is needed, 0.007 for 0.7 %")
    return replace(DEFAULT, **known)
