"""The order in which trials were run, from their start times where they are not numbered."""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import datetime
from functools import partial
from itertools import product

from sandbot_record.trials.table import OK, Row

_DATES = ("%Y/%m/%d", "%d.%m.%Y", "%d.%m.%y", "%d/%m/%Y", "%d/%m/%y", "%m/%d/%Y", "%m/%d/%y", "%d %b %Y", "%b %d, %Y")
_TIMES = ("", " %H:%M", " %H:%M:%S", " %I:%M %p", " %I:%M:%S %p")


def _written_as(form: str, text: str) -> datetime:
    return datetime.strptime(text, form)


_NOTATIONS: tuple[Callable[[str], datetime | float], ...] = (
    datetime.fromisoformat,
    float,  # as spreadsheets count days, and clocks seconds
    *(partial(_written_as, date + time) for date, time in product(_DATES, _TIMES)),
)
"""Ways to read a start time; each raises ValueError for any other text."""


def in_order(tables: Sequence[Sequence[Row]]) -> tuple[list[Row], list[int]]:
    """The rows of all tables with ``run_order`` by start time, else by the tables' own numbers; also the indices of the
    tables whose numbers start again and are assumed to follow those before."""
    timed = ordered_by_start([row for rows in tables for row in rows], joined=len(tables) > 1)
    return (timed, []) if timed is not None else renumbered(tables)


def ordered_by_start(rows: Sequence[Row], *, joined: bool) -> list[Row] | None:
    """The same rows with ``run_order`` from ``started``, if it is missing or several tables are ``joined``.

    None if a single table is numbered, or unless every trial that is ok has a start time in one notation, all with a
    time zone or all without. Where several notations fit, as 05/03 is in May or in March, they must agree in the order.
    """
    counted = [row for row in rows if row.status == OK]
    if not counted or (not joined and not any(math.isnan(row.run_order) for row in counted)):
        return None
    fitting = [notation for notation in _NOTATIONS if _time(notation, counted[0].started) is not None]
    orders = [order for notation in fitting if (order := _order(rows, notation)) is not None]
    if not orders or any(order != orders[0] for order in orders):
        return None
    return [replace(row, run_order=orders[0].get(row.trial_id, math.nan)) for row in rows]


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


def is_time(started: str) -> bool:
    """Whether a text is a time: in ISO 8601, a date as spreadsheets write it, or a number of days or seconds."""
    return any(_time(notation, started) is not None for notation in _NOTATIONS)


def _order(rows: Sequence[Row], notation: Callable[[str], datetime | float]) -> dict[str, float] | None:
    """Ranks from 1 by trial id; equal times, as when only the day is given, share their mean rank. None if a trial that
    is ok has no time, or if only some times have a zone."""
    times = {row.trial_id: time for row in rows if (time := _time(notation, row.started)) is not None}
    if any(row.status == OK and row.trial_id not in times for row in rows):
        return None
    try:
        ordered = sorted(times.values())
    except TypeError:
        return None
    return {name: 0.5 * (bisect_left(ordered, at) + 1 + bisect_right(ordered, at)) for name, at in times.items()}


def _time(notation: Callable[[str], datetime | float], text: str) -> datetime | float | None:
    try:
        return notation(text)
    except ValueError:
        return None
