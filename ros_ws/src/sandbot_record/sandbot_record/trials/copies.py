"""Trials that are in a table more than once: as replicates they make every error too small, and true models fail."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from sandbot_record.trials.table import OK, Row

LONG = 6
"""Digits of a measured value that are no chance in two trials, unless it is 1 m in 5.3 s."""
SEVERAL = 2
"""Such values from which two trials that agree in all are one."""
SET_POINT = 3
"""Decimals of a φ that was asked for, and not measured."""


def counted_once(rows: Sequence[Row]) -> tuple[list[Row], list[str]]:
    """The same rows, those that are copies of others with a status that says so; and a clause if there are any.

    Copies are known by values of many digits; where all are rounded, by every trial being there several times. Where
    each set-point has but one row so repeated, that may be rounding, and they are left.
    """
    copied = {**_many_digits(rows), **_whole_table(rows)}
    if not copied:
        return list(rows), []
    marked = [replace(row, status=f"a copy of {copied[at]}") if at in copied else row for at, row in enumerate(rows)]
    return marked, [f"{len(copied)} trials are copies of others, to the last digit, and count once"]


def _many_digits(rows: Sequence[Row]) -> dict[int, str]:
    """Of each copy, by its place, which trial it is a copy of."""
    first: dict[str, str] = {}
    found: dict[int, str] = {}
    for at, row in enumerate(rows):
        if row.status == OK and sum(digits(value) >= LONG for value in measured(row)) >= SEVERAL:
            original = first.setdefault(repr((_condition(row), measured(row))), row.trial_id)
            if original != row.trial_id:
                found[at] = original
    return found


def _whole_table(rows: Sequence[Row]) -> dict[int, str]:
    """The same where every trial is there several times."""
    counted = [at for at, row in enumerate(rows) if row.status == OK]
    keys = [_key(rows[at]) for at in counted]
    there = Counter(keys)
    times = math.gcd(*there.values())
    set_points = all(row.phi == round(row.phi, SET_POINT) for row in rows if row.status == OK)
    if times < 2 or (set_points and len(set(keys)) == len({_condition(rows[at]) for at in counted})):
        return {}
    first: dict[str, str] = {}
    seen: Counter[str] = Counter()
    found = {}
    for at, key in zip(counted, keys, strict=True):
        original = first.setdefault(key, rows[at].trial_id)
        if seen[key] >= there[key] // times:
            found[at] = original
        seen[key] += 1
    return found


def digits(value: float) -> int:
    """How many digits a value has; of 16 the last may be the computer's: 0.07 from 7 cm."""
    return 0 if math.isnan(value) else len(f"{abs(value):.12e}".partition("e")[0].replace(".", "").rstrip("0"))


def measured(row: Row) -> tuple[float, ...]:
    """The four observables."""
    return row.speed_m_s, row.lift_m, row.peak_speed_m_s, row.first_step_m


def _condition(row: Row) -> tuple[float, float, str]:
    return row.phi, row.omega_rad_s, row.gait


def _key(row: Row) -> str:
    """All that a trial says but its name and when it was run; as text, for what was not measured is NaN, not itself."""
    return repr(replace(row, trial_id="", run_order=math.nan, started=""))
