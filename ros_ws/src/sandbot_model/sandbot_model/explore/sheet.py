"""The cells as CSV: predictions of each step of the ladder, then of the model with the values held by hand."""

from collections.abc import Sequence

from sandbot_model.report.data_section import cells_csv
from sandbot_model.report.view import Step


def sheet(steps: Sequence[Step], current: Step, by_hand: Sequence[tuple[str, float]]) -> str:
    """``cells_csv`` of the ladder and, if values are held by hand, of ``current``."""
    return cells_csv((*steps, current) if by_hand else tuple(steps))
