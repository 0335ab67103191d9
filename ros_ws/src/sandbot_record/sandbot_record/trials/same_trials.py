"""Trials that two tables share: counted twice, as replicates, they make every error too small."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

from sandbot_record.trials.agreement import Written, agree, agreeing
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


class Table:
    """A table's rows, with what comparing it to many others needs of it."""

    def __init__(self, rows: Sequence[Row]) -> None:
        self.rows = rows
        self.by_name = {row.trial_id: row for row in rows}
        self.counted = [row for row in rows if row.status == OK and not math.isnan(row.speed_m_s)]
        self.written = Written.of(self.counted)

    @cached_property
    def rate_of_equal(self) -> float:
        """How often two of its replicates are equal."""
        return rate_of_equal(self.counted)

    @cached_property
    def measures_phi(self) -> bool:
        """Whether φ is that of each trial."""
        return measures_phi(self.counted)

    @cached_property
    def replicates(self) -> Counter[tuple[float, float, str]]:
        """Number of trials by set-point."""
        return Counter(map(set_point, self.counted))


def same_trials(table: Table, other: Table) -> dict[str, str]:
    """Ids in another table of the trials that are in it too, by their own ids.

    Two rows may be one trial if they agree in all values that both give, to the digits that both give.
    """
    return also_in(table, other) | {name: name for name in _same_by_name(table, other)}


def also_in(table: Table, other: Table) -> dict[str, str]:
    """The same, whatever their names, if one table contains all counted trials of the other, in any order, and more of
    them than agree by chance; else none."""
    pairs = _agreeing(table, other)
    is_copy = len(pairs) == min(len(table.counted), len(other.counted)) and _chance_of(pairs, table, other) < BY_CHANCE
    return {row.trial_id: again.trial_id for row, again in pairs} if is_copy else {}


def overlap(table: Table, other: Table) -> int:
    """Number of trials that agree with trials of another table; 0 if that many may agree by chance."""
    pairs = _agreeing(table, other)
    choices = math.comb(min(len(table.counted), len(other.counted)), len(pairs))
    chance = _chance_of(pairs, table, other)
    # In logarithms, as the number of choices may exceed any float.
    is_likely = chance > 0 and math.log(choices) + math.log(chance) > math.log(BY_CHANCE)
    return 0 if is_likely else len(pairs)


def merged(row: Row, again: Row) -> Row:
    """One trial of two rows of it: what the first lacks, or gives with fewer digits, is taken from the second."""
    return replace(row, **{name: value for name, value in vars(again).items() if _is_fuller(name, value, row)})


def _same_by_name(table: Table, other: Table) -> set[str]:
    """All common names if none of these trials differs; else those of equal trials with a given name and enough digits
    to exclude chance. The 7th rows of two days are different trials, even if their rounded speeds agree."""
    pairs = [(table.by_name[name], other.by_name[name]) for name in table.by_name.keys() & other.by_name.keys()]
    alike = [(a, b) for a, b in pairs if _as_text(a) == _as_text(b) or _same_start(a, b)]
    if len(alike) == len(pairs):
        return {a.trial_id for a, _ in pairs}
    alike = list(dict.fromkeys([*alike, *_agree_by_name(pairs)]))
    if len(alike) == len(pairs) and _chance_of(alike, table, other) < BY_CHANCE:
        return {a.trial_id for a, _ in alike}
    distinctive = {a.trial_id for a, b in alike if sum(_agreed_digits(a, b)) >= MANY_DIGITS}
    return {name for name in distinctive if not NAMELESS.fullmatch(name)}


def _agreeing(table: Table, other: Table) -> list[tuple[Row, Row]]:
    return [(table.counted[at], other.counted[there]) for at, there in agreeing(table.written, other.written)]


def _agree_by_name(pairs: Sequence[tuple[Row, Row]]) -> list[tuple[Row, Row]]:
    """The pairs with a given name that agree in their values and contradict each other in nothing else."""
    given = [(a, b) for a, b in pairs if not NAMELESS.fullmatch(a.trial_id) and _same_otherwise(a, b)]
    if not given:
        return []
    agreed = agree(*(Written.of(rows) for rows in zip(*given, strict=True)))
    return [pair for pair, same in zip(given, agreed, strict=True) if same]


def _chance_of(pairs: Sequence[tuple[Row, Row]], table: Table, other: Table) -> float:
    """Chance that each of the pairs found agrees although the two are replicates.

    That chance is the rate of equal replicates in either table, but no less than the digits of the values suggest.
    """
    rate = max(table.rate_of_equal, other.rate_of_equal)
    larger, at = (table, 0) if len(table.counted) > len(other.counted) else (other, 1)
    with_phi = table.measures_phi and other.measures_phi
    return math.prod(
        min(1.0, larger.replicates[set_point(pair[at])] * max(rate, _chance_of_digits(*pair, with_phi=with_phi)))
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


def _is_fuller(name: str, value: Any, row: Row) -> bool:
    """Whether a value says more than that of the row."""
    present = getattr(row, name)
    if _is_empty(present):
        return not _is_empty(value)
    return name in (*CONDITION, *MEASURED) and digits(value) > digits(present)


def _is_empty(value: Any) -> bool:
    return not value if isinstance(value, str) else math.isnan(value)


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
