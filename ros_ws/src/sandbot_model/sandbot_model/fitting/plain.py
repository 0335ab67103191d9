"""Results as plain data: what the JSON of ``compare`` and ``discover`` is made of."""

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
    """A flat dataclass as a mapping; tuples become lists, numbers that are not finite None."""
    return {
        name: number(value) if isinstance(value, float) else list(value) if isinstance(value, tuple) else value
        for name, value in vars(record).items()
    }


def number(value: float) -> float | None:
    """The value, or None where it is not finite: JSON has no NaN."""
    return float(value) if np.isfinite(value) else None
