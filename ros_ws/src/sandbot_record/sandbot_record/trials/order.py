"""The order in which trials were run, from their start times where they are not numbered."""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import datetime

from sandbot_record.trials.table import OK, Row


def in_order(tables: Sequence[Sequence[Row]]) -> tuple[list[Row], list[int]]:
    """The rows of all tables with ``run_order`` by start time, else by the tables' own numbers; also the indices of the
    tables whose numbers start again and are assumed to follow those before."""
    timed = ordered_by_start([row for rows in tables for row in rows], joined=len(tables) > 1)
    return (timed, []) if timed is not None else renumbered(tables)


def ordered_by_start(rows: Sequence[Row], *, joined: bool) -> list[Row] | None:
    """The same rows with ``run_order`` from ``started``, if it is missing or several tables are ``joined``.

    None if a single table is numbered, or unless every trial that is ok has a start time, all with a time zone or all
    without.
    """
    counted = [row for row in rows if row.status == OK]
    if not joined and not any(math.isnan(row.run_order) for row in counted):
        return None
    when = {row.trial_id: began for row in rows if (began := began_at(row.started)) is not None}
    if len({began.tzinfo is None for began in when.values()}) != 1 or any(row.trial_id not in when for row in counted):
        return None
    ranks = _ranks(when)
    return [replace(row, run_order=ranks.get(row.trial_id, math.nan)) for row in rows]


def renumbered(tables: Sequence[Sequence[Row]]) -> tuple[list[Row], list[int]]:
    """The rows of all tables; if a table repeats earlier numbers, as when each day starts from 1, its numbers continue
    from the last. Also the indices of these tables."""
    found: list[Row] = []
    restarted: list[int] = []
    taken: set[float] = set()
    for at, rows in enumerate(tables):
        own = {row.run_order for row in rows if not math.isnan(row.run_order)}
        last = max(taken) if own & taken else 0.0
        found += [replace(row, run_order=row.run_order + last) for row in rows]
        restarted += [at] * bool(last)
        taken |= {number + last for number in own}
    return found, restarted


def _ranks(when: Mapping[str, datetime]) -> dict[str, float]:
    """Ranks from 1; trials with equal times, as when only the day is given, share their mean rank."""
    times = sorted(when.values())
    return {name: 0.5 * (bisect_left(times, began) + 1 + bisect_right(times, began)) for name, began in when.items()}


def began_at(started: str) -> datetime | None:
    """The time given by a text in ISO 8601; None for any other text."""
    try:
        return datetime.fromisoformat(started)
    except ValueError:
        return None
