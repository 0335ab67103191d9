"""In which order trials were run, where the clock tells it and nobody has numbered them."""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import datetime

from sandbot_record.trials.table import OK, Row


def in_order(tables: Sequence[Sequence[Row]]) -> tuple[list[Row], list[int]]:
    """The rows of all tables, ``run_order`` as the clock tells it, else as tables are numbered; also which of these, of
    whose trials the clock does not tell, begin anew and are taken for later than those before."""
    clocked = by_the_clock([row for rows in tables for row in rows], joined=len(tables) > 1)
    return (clocked, []) if clocked is not None else one_after_the_other(tables)


def by_the_clock(rows: Sequence[Row], *, joined: bool) -> list[Row] | None:
    """The same rows, ``run_order`` as ``started`` has it: where it is missing, or several tables are ``joined``.

    None where they are numbered, or the clock does not tell when each trial that is ok began, always with a zone or
    never.
    """
    counted = [row for row in rows if row.status == OK]
    if not joined and not any(math.isnan(row.run_order) for row in counted):
        return None
    when = {row.trial_id: began for row in rows if (began := began_at(row.started)) is not None}
    if len({began.tzinfo is None for began in when.values()}) != 1 or any(row.trial_id not in when for row in counted):
        return None
    place = _places(when)
    return [replace(row, run_order=place.get(row.trial_id, math.nan)) for row in rows]


def one_after_the_other(tables: Sequence[Sequence[Row]]) -> tuple[list[Row], list[int]]:
    """The rows of all tables; where one has numbers that were there before, as each day begins with 1, all of its own
    go on from the last. Also which tables these are."""
    found: list[Row] = []
    anew: list[int] = []
    taken: set[float] = set()
    for at, rows in enumerate(tables):
        own = {row.run_order for row in rows if not math.isnan(row.run_order)}
        last = max(taken) if own & taken else 0.0
        found += [replace(row, run_order=row.run_order + last) for row in rows]
        anew += [at] * bool(last)
        taken |= {number + last for number in own}
    return found, anew


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
