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


def plain(value: Any) -> Any:
    """A dataclass as a mapping, a tuple as a list, a number that is not finite as None, also within each other."""
    if is_dataclass(value):
        return {name: plain(part) for name, part in vars(value).items()}
    if isinstance(value, tuple):
        return [plain(part) for part in value]
    return number(value) if isinstance(value, float) else value


def number(value: float) -> float | None:
    """The value, or None where it is not finite: JSON has no NaN."""
    return float(value) if np.isfinite(value) else None
