"""A ladder of fits as a table, in a reader's units: what ``compare`` prints and results show of themselves."""

from collections.abc import Sequence

from sandbot_model.data.conditions import noise_floor
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.text import Rows
from sandbot_model.physics.observables import CM, Observable


def ladder_rows(steps: Sequence[Fit]) -> Rows:
    """Each step's error per observable, in and out of sample, over the noise floor."""
    measured = [observable for observable in Observable if observable.name in steps[0].cells.observables]
    head = ["model", *(f"{observable.name} [{observable.readers_unit}]" for observable in measured)]
    floor = noise_floor(steps[0].cells)
    return [
        [*head, "out of sample: speed", "lack of fit p", "cells failing"],
        *(_row(step, measured) for step in steps),
        [
            "noise floor",
            *(f"{CM * floor[observable.name]:.3f}" for observable in measured),
            f"{CM * floor['speed']:.3f}",
            "",
            "",
        ],
    ]


def _row(step: Fit, measured: Sequence[Observable]) -> Sequence[str]:
    failing = len({(fail.phi, fail.omega_rad_s) for fail in step.fails})
    return [
        "+ " + " + ".join(step.effects) if step.effects else step.model.base,
        *(f"{CM * step.goodness.rmse[observable.name]:.3f}" for observable in measured),
        f"{CM * step.cv_rmse_m_s:.3f}",
        f"{step.lack_of_fit_p:.2g}",
        str(failing),
    ]
