"""How far k differs between batches, from conditions that several of them share."""

import numpy as np

from sandbot_model.discovery.criteria import Criteria
from sandbot_model.discovery.nuisances_about import within_cell_contrasts
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.uncertainty import covariance_of

FAR_SD = 4.0
"""Standard deviations, those of a bed's scatter and those of its own error, beyond which a difference is told."""


def in_words(fit: Fit, criteria: Criteria) -> str:
    """That two batches differ in k by more than a bed does; empty where none do, or where they share no conditions."""
    differ = _farthest_apart(fit)
    if differ is None:
        return ""
    apart, error = differ
    if apart < FAR_SD * max(np.sqrt(2.0) * criteria.bed_scatter, error):
        return ""
    batches = fit.cells.batch_share
    assert batches is not None
    differ_by = "the two batches differ by" if batches.shape[1] == 2 else "batches differ by up to"
    return (
        f"{differ_by} {100 * apart:.1f} ± {100 * error:.1f} % in k, and a bed by {100 * criteria.bed_scatter:.1g} % "
        "(s.d.): were they prepared alike? Judge each by itself, too"
    )


def _farthest_apart(fit: Fit) -> tuple[float, float] | None:
    """The difference of ln k between two batches that exceeds its standard error most, and this error; None where no
    condition is shared."""
    contrasts, slopes = within_cell_contrasts(fit)
    if slopes.shape[1] < 2 or not slopes.any():
        return None
    covariance = covariance_of(slopes.T @ slopes)
    ln_k, variance = covariance @ (slopes.T @ contrasts), np.diag(covariance)
    seen = np.flatnonzero(variance)
    one, other = (seen[at] for at in np.triu_indices(len(seen), 1))
    error = np.sqrt(np.maximum(variance[one] + variance[other] - 2 * covariance[one, other], 0.0))
    apart = np.abs(ln_k[one] - ln_k[other])
    known = error > 0
    if not known.any():
        return None
    best = np.argmax(np.where(known, apart / np.where(known, error, 1.0), 0.0))
    return float(apart[best]), float(error[best])
