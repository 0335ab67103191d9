"""Standard deviations between batches of the nuisances that each batch has: offset of ln k, lift zero, speed scale."""

from dataclasses import dataclass, fields, replace

from sandbot_model.discovery.criteria import Criteria
from sandbot_model.fitting.fit import Fit

BATCH, BATCH_ZERO, BATCH_SCALE = "ln_k", "lift_zero_of_batch_m", "speed_scale_of_batch"
"""Names of the nuisances that each batch has: offset of ln k, zero of the lift, scale along the track."""
READINGS = (BATCH_ZERO, BATCH_SCALE)
"""Those that change what is read, not the bed."""


@dataclass(frozen=True)
class BatchSd:
    """Standard deviations between batches; false if all are 0."""

    ln_k: float = 0.0
    lift_zero_of_batch_m: float = 0.0
    speed_scale_of_batch: float = 0.0

    def __bool__(self) -> bool:
        """Whether batches differ at all."""
        return bool(self.names)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the nuisances in which batches differ."""
        return tuple(name for name in NAMES if self[name])

    def __getitem__(self, name: str) -> float:
        """The standard deviation of a nuisance, by name."""
        return float(getattr(self, name))

    def with_sd(self, name: str, sd: float) -> "BatchSd":
        """A copy with one standard deviation replaced."""
        return replace(self, **{name: sd})

    def maximum(self, other: "BatchSd") -> "BatchSd":
        """The elementwise maximum."""
        return BatchSd(*(max(self[name], other[name]) for name in NAMES))


NAMES = tuple(field.name for field in fields(BatchSd))
ALIKE = BatchSd()
"""No differences between batches."""


def priors(fit: Fit, criteria: Criteria) -> BatchSd:
    """Scales of the half-normal priors of the differences between batches; 0 where batches cannot differ.

    The bed may differ between any two preparations. Zero and scale may differ only between recorded batches; their
    prior is the calibration uncertainty in the cameras' file.
    """
    cells = fit.cells
    if cells.batch_share is None:
        return BatchSd(criteria.bed_scatter)
    zero_m = cells.accuracy.lift_zero_m if "lift" in cells.observables else 0.0
    return BatchSd(criteria.bed_scatter, zero_m, cells.accuracy.speed_scale)


def batch_sd_of(fit: Fit) -> BatchSd:
    """The batch SDs that a fit assumes."""
    assert fit.nuisances is not None
    known = dict(zip(fit.nuisances.names, fit.nuisances.sd.tolist(), strict=True))
    return BatchSd(*(known.get(name, 0.0) for name in NAMES))
