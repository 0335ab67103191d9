"""How far batches differ in what each has of its own: k of its bed, and readings off another zero or another scale."""

from dataclasses import dataclass, fields, replace

from sandbot_model.discovery.criteria import Criteria
from sandbot_model.fitting.fit import Fit

BATCH, BATCH_ZERO, BATCH_SCALE = "ln_k", "lift_zero_of_batch_m", "speed_scale_of_batch"
"""Names of what each batch has of its own: an offset of ln k, a zero of the lift and a scale along the track."""
READINGS = (BATCH_ZERO, BATCH_SCALE)
"""Those that leave the bed as it is."""


@dataclass(frozen=True)
class BatchSd:
    """Standard deviations from batch to batch; none that differ are false."""

    ln_k: float = 0.0
    lift_zero_of_batch_m: float = 0.0
    speed_scale_of_batch: float = 0.0

    def __bool__(self) -> bool:
        """Whether batches differ in anything."""
        return bool(self.names)

    @property
    def names(self) -> tuple[str, ...]:
        """Of what batches differ in."""
        return tuple(name for name in NAMES if self[name])

    def __getitem__(self, name: str) -> float:
        """By the nuisance's name."""
        return float(getattr(self, name))

    def with_sd(self, name: str, sd: float) -> "BatchSd":
        """The same with one of them."""
        return replace(self, **{name: sd})

    def maximum(self, other: "BatchSd") -> "BatchSd":
        """The larger of both, one by one."""
        return BatchSd(*(max(self[name], other[name]) for name in NAMES))


NAMES = tuple(field.name for field in fields(BatchSd))
ALIKE = BatchSd()
"""Batches that do not differ."""


def priors(fit: Fit, criteria: Criteria) -> BatchSd:
    """Standard deviations of the half-normal priors of what batches of these trials may differ in; 0 where in nothing.

    A bed is never prepared twice alike. Readings are set to their zero and scale for a batch that is told, at most:
    as well, from one to the next, as the cameras' file knows them for all.
    """
    cells = fit.cells
    if cells.batch_share is None:
        return BatchSd(criteria.bed_scatter)
    zero_m = cells.accuracy.lift_zero_m if "lift" in cells.observables else 0.0
    return BatchSd(criteria.bed_scatter, zero_m, cells.accuracy.speed_scale)


def batch_sd_of(fit: Fit) -> BatchSd:
    """What a fit's nuisances take for granted of how batches differ."""
    assert fit.nuisances is not None
    known = dict(zip(fit.nuisances.names, fit.nuisances.sd.tolist(), strict=True))
    return BatchSd(*(known.get(name, 0.0) for name in NAMES))
