"""Trials that two tables share: counted twice, as replicates, they make every error too small."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from sandbot_record.trials.agreement import agree, agreeing
from sandbot_record.trials.copies import (
    BY_CHANCE,
    COMMON_DIGITS,
    SET_POINT_DECIMALS,
    TELLING_DIGITS,
    digits,
    measured,
    measures_phi,
    rate_of_equal,
    set_point,
)
from sandbot_record.trials.csv_table import NAMELESS
from sandbot_record.trials.table import CONDITION, MEASURED, OK, Row

MANY_DIGITS = 8
"""Total digits of the measured values from which two trials do not agree by chance."""
_OTHERWISE = ("batch", "replicate", "run_order", "started", "status")
"""Columns that tell trials of one name apart, where both tables have them."""


def same_trials(rows: Sequence[Row], other: Sequence[Row]) -> dict[str, str]:
    """Ids in another table of the ``rows`` that are in it too, by their own ids.

    Two rows may be one trial if they agree in all values that both give, to the digits that both give.
    """
    return also_in(rows, other) | {name: name for name in _same_by_name(rows, other)}


def also_in(rows: Sequence[Row], other: Sequence[Row]) -> dict[str, str]:
    """The same, whatever their names, if one table contains all counted trials of the other, in any order, and more of
    them than agree by chance; else none."""
    own, there = ([row for row in table if _is_counted(row)] for table in (rows, other))
    pairs = agreeing(own, there)
    is_copy = len(pairs) == min(len(own), len(there)) and _chance_of(pairs, own, there) < BY_CHANCE
    return {row.trial_id: again.trial_id for row, again in pairs} if is_copy else {}


def merged(row: Row, again: Row) -> Row:
    """One trial of two rows of it: what the first lacks, or gives with fewer digits, is taken from the second."""
    return replace(row, **{name: value for name, value in vars(again).items() if _is_fuller(name, value, row)})


def _same_by_name(rows: Sequence[Row], other: Sequence[Row]) -> set[str]:
    """All common names if none of these trials differs; else those of equal trials with a given name and enough digits
    to exclude chance. The 7th rows of two days are different trials, even if their rounded speeds agree."""
    first, second = ({row.trial_id: row for row in table} for table in (rows, other))
    pairs = [(row, second[name]) for name, row in first.items() if name in second]
    equal = {a.trial_id for a, b in pairs if _as_text(a) == _as_text(b) or _same_start(a, b)}
    if len(equal) == len(pairs):
        return equal
    agreed = agree([a for a, _ in pairs], [b for _, b in pairs])
    alike = [
        (a, b)
        for (a, b), same in zip(pairs, agreed, strict=True)
        if a.trial_id in equal or (same and not NAMELESS.fullmatch(a.trial_id) and _same_otherwise(a, b))
    ]
    if len(alike) == len(pairs) and _chance_of(alike, rows, other) < BY_CHANCE:
        return {a.trial_id for a, _ in alike}
    distinctive = {a.trial_id for a, b in alike if sum(_agreed_digits(a, b)) >= MANY_DIGITS}
    return {name for name in distinctive if not NAMELESS.fullmatch(name)}


def _chance_of(pairs: Sequence[tuple[Row, Row]], rows: Sequence[Row], other: Sequence[Row]) -> float:
    """Chance that each of the pairs found agrees although the two are replicates.

    Two replicates agree as often as those of either table are equal, at least as often as their digits suggest.
    """
    rate = max(map(rate_of_equal, (rows, other)))
    larger, at = (rows, 0) if len(rows) > len(other) else (other, 1)
    replicates = Counter(map(set_point, larger))
    with_phi = measures_phi(rows) and measures_phi(other)
    return math.prod(
        min(1.0, replicates[set_point(pair[at])] * max(rate, _chance_of_digits(*pair, with_phi=with_phi)))
        for pair in pairs
        if max(_agreed_digits(*pair)) >= TELLING_DIGITS
    )


def _chance_of_digits(a: Row, b: Row, *, with_phi: bool) -> float:
    """Chance that two replicates agree in all digits beyond the leading ones that replicates share."""
    beyond = sum(max(number - COMMON_DIGITS, 0) for number in _agreed_digits(a, b))
    in_phi = max(min(digits(a.phi), digits(b.phi)) - SET_POINT_DECIMALS, 0) if with_phi else 0
    return 10.0 ** -(beyond + in_phi)


def _agreed_digits(a: Row, b: Row) -> list[int]:
    """Digits to which two rows that agree give each observable; 0 where one of both lacks it."""
    return [min(digits(one), digits(again)) for one, again in zip(measured(a), measured(b), strict=True)]


def _is_counted(row: Row) -> bool:
    return row.status == OK and not math.isnan(row.speed_m_s)


def _is_fuller(name: str, value: Any, row: Row) -> bool:
    """Whether a value says more than that of the row."""
    present = getattr(row, name)
    if _is_empty(present):
        return not _is_empty(value)
    return name in (*CONDITION, *MEASURED) and digits(value) > digits(present)


def _is_empty(value: Any) -> bool:
    return value == "" or value != value


def _as_text(row: Row) -> list[str]:
    """A row as text to 9 digits: NaN is not equal to itself, and unit conversion changes the last digits."""
    return [value if isinstance(value, str) else f"{value:.9g}" for value in vars(row).values()]


def _same_otherwise(a: Row, b: Row) -> bool:
    """Whether two rows do not contradict each other in what else tells trials apart."""
    pairs = [(getattr(a, name), getattr(b, name)) for name in _OTHERWISE]
    return all(one == again or _is_empty(one) or _is_empty(again) for one, again in pairs)


def _same_start(a: Row, b: Row) -> bool:
    """Whether two rows of one name started at the same time of day: they are one trial, perhaps rounded differently."""
    return ":" in a.started and a.started == b.started
