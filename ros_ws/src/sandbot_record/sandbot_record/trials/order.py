"""In which order trials were run, where the clock tells it and nobody has numbered them."""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import datetime

from sandbot_record.trials.table import OK, Row


def by_the_clock(rows: Sequence[Row], *, joined: bool) -> list[Row]:
    """The same rows, ``run_order`` as ``started`` has it: where it is missing, or several tables are ``joined``.

    They stay as they are unless the clock tells when each trial that is ok began, always with a zone or never.
    """
    counted = [row for row in rows if row.status == OK]
    if not joined and not any(math.isnan(row.run_order) for row in counted):
        return list(rows)
    when = {row.trial_id: began for row in rows if (began := began_at(row.started)) is not None}
    if len({began.tzinfo is None for began in when.values()}) != 1 or any(row.trial_id not in when for row in counted):
        return list(rows)
    place = _places(when)
    return [replace(row, run_order=place.get(row.trial_id, math.nan)) for row in rows]


def _places(when: Mapping[str, datetime]) -> dict[str, float]:
    """From 1; trials of one time, of which a day alone may be told, share the mean of their places."""
    times = sorted(when.values())
    return {name: 0.5 * (bisect_left(times, began) + 1 + bisect_right(times, began)) for name, began in when.items()}


def began_at(started: str) -> datetime | None:
    """The time of a text as ISO 8601 has it; None of any other."""
    try:
        return datetime.fromisoformat(started)
    except ValueError:
        return None
