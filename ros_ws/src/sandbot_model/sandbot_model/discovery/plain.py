"""Results as plain data: what the JSON of ``compare`` and ``discover`` is made of."""

from typing import Any

import numpy as np

from sandbot_model.data.conditions import Cells
from sandbot_model.fitting.fit import Fit


def data_summary(cells: Cells) -> dict[str, Any]:
    """How much data there is."""
    return {
        "trials": cells.trials,
        "excluded_trials": cells.excluded,
        "cells": len(cells),
        "replicated_cells": int((cells.n.max(axis=1) > 1).sum()),
        "observables": list(cells.observables),
    }


def fit_summary(fit: Fit) -> dict[str, Any]:
    """One step of the ladder as plain data."""
    return {
        "effects": list(fit.effects),
        "rmse_m_s": number(fit.rmse_m_s),
        "cv_rmse_m_s": number(fit.cv_rmse_m_s),
        "rmse": {name: number(value) for name, value in fit.rmse.items()},
        "cv_rmse": {name: number(value) for name, value in fit.cv_rmse.items()},
        "cv_cells": fit.cv_cells,
        "cv_deviance": number(fit.cv_deviance),
        "chi2": number(fit.chi2),
        "dof": fit.dof,
        "lack_of_fit_p": number(fit.lack_of_fit_p),
        "lack_of_fit": {name: number(value) for name, value in fit.lack_of_fit.items()},
        "parameters": {
            name: {"value": number(one.value), "stderr": number(one.stderr)} for name, one in fit.parameters.items()
        },
        "k_n_per_m": [
            {"phi": number(phi), "value": number(k), "stderr": number(error)}
            for phi, k, error in zip(fit.level_phi, fit.k_n_per_m, fit.k_stderr_n_per_m, strict=True)
        ],
        "at_bounds": list(fit.at_bounds),
        "implausible": list(fit.implausible),
        "fails": [plain(fail) for fail in fit.fails],
    }


def plain(one: Any) -> dict[str, Any]:
    """A flat dataclass as a mapping; tuples become lists, numbers that can't be told None."""
    return {
        name: number(value) if isinstance(value, float) else list(value) if isinstance(value, tuple) else value
        for name, value in vars(one).items()
    }


def number(value: float) -> float | None:
    """The value, or None where it is not finite: JSON has no NaN."""
    return float(value) if np.isfinite(value) else None
