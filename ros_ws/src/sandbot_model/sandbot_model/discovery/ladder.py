"""A ladder of fits as a table, in a reader's units: what ``compare`` prints and results show of themselves."""

from collections.abc import Sequence
from itertools import pairwise

from sandbot_model.data.conditions import noise_floor
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.text import Rows
from sandbot_model.physics.observables import CM, Observable


def ladder_rows(steps: Sequence[Fit]) -> Rows:
    """Each step's error per observable, in and out of sample, over the noise floor; a step names what it adds."""
    measured = [observable for observable in Observable if observable.name in steps[0].cells.observables]
    head = ["model", *(f"{observable.name.replace('_', ' ')}\n[{observable.readers_unit}]" for observable in measured)]
    floor = noise_floor(steps[0].cells)
    added = [steps[0].effects, *(_added(step, last) for last, step in pairwise(steps))]
    return [
        [*head, "speed out\nof sample", "lack of\nfit p", "cells\nfailing"],
        *(_row(step, names, measured) for step, names in zip(steps, added, strict=True)),
        [
            "noise floor",
            *(f"{CM * floor[observable.name]:.3f}" for observable in measured),
            f"{CM * floor['speed']:.3f}",
            "",
            "",
        ],
    ]


def _added(step: Fit, last: Fit) -> Sequence[str]:
    return [name for name in step.effects if name not in last.effects]


def _row(step: Fit, added: Sequence[str], measured: Sequence[Observable]) -> Sequence[str]:
    failing = len({(fail.phi, fail.omega_rad_s) for fail in step.fails})
    return [
        "+ " + " + ".join(added) if added else step.model.base,
        *(f"{CM * step.goodness.rmse[observable.name]:.3f}" for observable in measured),
        f"{CM * step.cv_rmse_m_s:.3f}",
        f"{step.lack_of_fit_p:.2g}",
        str(failing),
    ]
