"""The cells as CSV, as the page shows them: the steps of the ladder, then the model with the values held by hand."""

import csv
import io
from collections.abc import Sequence

from sandbot_model.report.data_section import cells_csv
from sandbot_model.report.view import Step


def sheet(steps: Sequence[Step], current: Step, by_hand: Sequence[tuple[str, float]]) -> str:
    """``cells_csv`` of the ladder; where values are held, those of ``current`` follow, tagged with what is held."""
    fitted = cells_csv(tuple(steps))
    if not by_hand:
        return fitted
    rows, held_rows = _rows(fitted), _rows(cells_csv((current,)))
    # Columns of a step end with its effects in brackets; the others are measured and stand there already.
    own = [i for i, name in enumerate(held_rows[0]) if name.endswith("]")]
    tag = ", ".join(f"{name}={value:.7g}" for name, value in by_hand)
    head = [f"{held_rows[0][i].removesuffix(']')}; held by hand: {tag}]" for i in own]
    more = [head, *([row[i] for i in own] for row in held_rows[1:])]
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([*row, *extra] for row, extra in zip(rows, more, strict=True))
    return out.getvalue()


def _rows(text: str) -> list[list[str]]:
    return list(csv.reader(io.StringIO(text)))
