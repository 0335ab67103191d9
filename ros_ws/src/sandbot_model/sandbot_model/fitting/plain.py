"""Results as plain data, for the JSON of ``compare`` and ``discover``."""

from dataclasses import is_dataclass
from typing import Any

import numpy as np

from sandbot_model.data.conditions import Cells


def data_summary(cells: Cells) -> dict[str, Any]:
    """How much data there is."""
    return {
        "trials": cells.trials,
        "excluded_trials": cells.excluded,
        "cells": len(cells),
        "replicated_cells": int((cells.n.max(axis=1) > 1).sum()),
        "observables": list(cells.observables),
    }


def plain(record: Any) -> dict[str, Any]:
    """A dataclass as a mapping; tuples become lists, dataclasses in them mappings, numbers that are not finite None."""
    return {name: _plain(value) for name, value in vars(record).items()}


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return number(value)
    if isinstance(value, tuple):
        return [plain(part) if is_dataclass(part) else _plain(part) for part in value]
    return value


def number(value: float) -> float | None:
    """The value, or None where it is not finite: JSON has no NaN."""
    return float(value) if np.isfinite(value) else None
