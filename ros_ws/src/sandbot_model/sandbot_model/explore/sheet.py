"""The cells as CSV: predictions of each step of the ladder, then of the model with the values held by hand."""

from collections.abc import Sequence
from dataclasses import replace

from sandbot_model.report.data_section import cells_csv
from sandbot_model.report.view import Step


def sheet(steps: Sequence[Step], current: Step, by_hand: Sequence[tuple[str, float]]) -> str:
    """``cells_csv`` of the ladder and, if values are held by hand, of ``current``."""
    if not by_hand:
        return cells_csv(tuple(steps))
    fit = current.fit
    held = replace(current, fit=replace(fit, model=replace(fit.model, held=dict(by_hand))))
    return cells_csv((*steps, held))
