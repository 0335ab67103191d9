"""How well a trial is measured: the section ``accuracy`` of cameras.yaml, next to the cameras it describes."""

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from sandbot_common.parameters import from_mapping, parameter

SECTION = "accuracy"
"""Its name among the cameras."""


def _constant(default: float, unit: str, what: str) -> Any:
    return parameter(default, unit=unit, doc=f"{what}: constant error that all replicates share", low=0.0, high=1.0)


def _relative(default: float, what: str) -> Any:
    return parameter(default, doc=f"{what}: relative error that all replicates share", low=0.0, high=1.0)


def _usual(default: float, unit: str, what: str) -> Any:
    return parameter(default, unit=unit, doc=f"{what}: usual scatter of one trial", low=1e-6, high=1.0)


@dataclass(frozen=True)
class Accuracy:
    """Per observable, what its replicates can't show: the systematic error, and the usual scatter where there are none.

    The systematic error is what all replicates share, a constant and a fraction of the value. It is negligible for
    mean speed, a distance over a time, but not for the rise and the steepest slope of a folded curve, for which
    tests/unit/sandbot_tracking/test_trial.py bounds it on rendered ground truth. The usual standard deviation of one
    trial weights the observables against each other where nothing was replicated.
    """

    speed_m_s: float = _constant(0.0, "m/s", "mean speed")
    speed_share: float = _relative(0.0, "mean speed")
    speed_sd_m_s: float = _usual(5e-3, "m/s", "mean speed")
    lift_m: float = _constant(1e-4, "m", "lift")
    lift_share: float = _relative(0.0, "lift")
    lift_sd_m: float = _usual(5e-4, "m", "lift")
    peak_speed_m_s: float = _constant(0.0, "m/s", "peak speed")
    peak_speed_share: float = _relative(0.015, "peak speed")
    peak_speed_sd_m_s: float = _usual(1e-2, "m/s", "peak speed")
    first_step_m: float = _constant(3e-4, "m", "first step")
    first_step_share: float = _relative(0.0, "first step")
    first_step_sd_m: float = _usual(1.5e-3, "m", "first step")
    lift_zero_m: float = parameter(
        6e-4, unit="m", doc="sd of the lift's zero, common to all trials: a grain, uniform", low=1e-6, high=0.1
    )
    speed_scale: float = parameter(0.01, doc="sd of the track's scale, common to all trials", low=1e-6, high=1.0)


USUAL = Accuracy()
"""The accuracy of the trackway's own cameras."""


def accuracy_from_mapping(mapping: Any, where: str) -> Accuracy:
    """The accuracy in a mapping, by default ``USUAL``'s. ``where`` opens every error line. Raises InputError."""
    return from_mapping(Accuracy, mapping, f"{where}: {SECTION}")


def worst(several: Iterable[Accuracy]) -> Accuracy | None:
    """An accuracy that holds for all of them: the largest of each error; None if there are none."""
    values = [dataclasses.astuple(accuracy) for accuracy in several]
    return Accuracy(*map(max, zip(*values, strict=True))) if values else None
