"""Trials duplicated in a table: counted as replicates, they make every error too small, and true models fail."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from sandbot_record.trials.table import OK, Row

LONG_DIGITS = 6
"""Digits from which a measured value does not agree by chance in two trials; a ratio such as 1 m in 5.3 s still may."""
MIN_LONG_VALUES = 2
"""Values of so many digits from which two trials that agree in all measured values are copies."""
SET_POINT_DECIMALS = 3
"""A φ of at most so many decimals is taken for a set-point, not a measurement."""


def mark_copies(rows: Sequence[Row]) -> tuple[list[Row], list[str]]:
    """The same rows, with a status that excludes duplicates of others; and a note on their number, if any.

    Copies are recognised by measured values with many digits or, if all values are rounded, by every trial occurring
    the same number of times. If each set-point has only one such repeated row, rounded replicates may simply agree, and
    all are kept.
    """
    copied = {**_copies_by_digits(rows), **_copies_of_table(rows)}
    if not copied:
        return list(rows), []
    marked = [replace(row, status=f"a copy of {copied[at]}") if at in copied else row for at, row in enumerate(rows)]
    return marked, [f"{len(copied)} trials are exact copies of others and are counted once"]


def _copies_by_digits(rows: Sequence[Row]) -> dict[int, str]:
    """The original's trial id, by the index of each copy."""
    first: dict[str, str] = {}
    found: dict[int, str] = {}
    for at, row in enumerate(rows):
        if row.status == OK and sum(digits(value) >= LONG_DIGITS for value in measured(row)) >= MIN_LONG_VALUES:
            original = first.setdefault(repr((_condition(row), measured(row))), row.trial_id)
            if original != row.trial_id:
                found[at] = original
    return found


def _copies_of_table(rows: Sequence[Row]) -> dict[int, str]:
    """The same for a table pasted several times, in which the number of times each trial occurs has a common factor."""
    counted = [at for at, row in enumerate(rows) if row.status == OK]
    keys = [_key(rows[at]) for at in counted]
    counts = Counter(keys)
    times = math.gcd(*counts.values())
    set_points = all(row.phi == round(row.phi, SET_POINT_DECIMALS) for row in rows if row.status == OK)
    if times < 2 or (set_points and len(set(keys)) == len({_condition(rows[at]) for at in counted})):
        return {}
    first: dict[str, str] = {}
    seen: Counter[str] = Counter()
    found = {}
    for at, key in zip(counted, keys, strict=True):
        original = first.setdefault(key, rows[at].trial_id)
        if seen[key] >= counts[key] // times:
            found[at] = original
        seen[key] += 1
    return found


def digits(value: float) -> int:
    """Significant digits of a value among the first 13; the last of 16 may be rounding error, as in 0.07 from 7 cm."""
    return 0 if math.isnan(value) else len(f"{abs(value):.12e}".partition("e")[0].replace(".", "").rstrip("0"))


def measured(row: Row) -> tuple[float, ...]:
    """The four observables."""
    return row.speed_m_s, row.lift_m, row.peak_speed_m_s, row.first_step_m


def _condition(row: Row) -> tuple[float, float, str]:
    return row.phi, row.omega_rad_s, row.gait


def _key(row: Row) -> str:
    """All of a trial but its id, order and time; as text, because NaN (not measured) is not equal to itself."""
    return repr(replace(row, trial_id="", run_order=math.nan, started=""))
