"""Trials duplicated in a table: counted as replicates, they make every error too small, and true models fail."""

import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations, groupby

from sandbot_record.trials.table import MEASURED, OK, Row

LONG_DIGITS = 6
"""Digits from which a measured value does not agree by chance in two trials; a ratio such as 1 m in 5.3 s still may."""
MIN_LONG_VALUES = 2
"""Two trials that agree in all measured values are copies if at least this many of these have ``LONG_DIGITS``."""
SET_POINT_DECIMALS = 3
"""A φ of at most so many decimals is taken for a set-point, not a measurement."""
TELLING_DIGITS = 3
"""Digits from which a value tells trials apart; 0 or 0.02 m/s is measured again and again."""
COMMON_DIGITS = 2
"""Leading digits that replicates share: each further digit agrees by chance once in ten."""
BY_CHANCE = 1e-3
"""Below this, rows are copies: the expected number of equally long blocks that repeat by chance, or the chance that all
trials of a table agree with trials of another."""
TOO_OFTEN = 10
"""Number of equal rows beyond which they are due to rounding."""
MOST_NAMED = 5


def mark_copies(rows: Sequence[Row]) -> tuple[list[Row], list[str]]:
    """The same rows, with a status that excludes duplicates of others; and a note on their number, if any.

    Copies are recognised by measured values with many digits, whatever their condition is said to be. If all values are
    rounded, they are recognised by a block of rows that repeats in its order, longer than chance explains, or by every
    trial occurring the same number of times. If each set-point has only one such repeated row, rounded replicates may
    simply agree, and all are kept.
    """
    copied = {**_copies_by_digits(rows), **_copies_of_table(rows), **_copies_of_blocks(rows)}
    if not copied:
        return list(rows), []
    marked = [replace(row, status=f"a copy of {copied[at]}") if at in copied else row for at, row in enumerate(rows)]
    named = [f"{rows[at].trial_id} = {copied[at]}" for at in sorted(copied)]
    more = f" and {len(named) - MOST_NAMED} more" if len(named) > MOST_NAMED else ""
    are = (
        "1 trial is an exact copy of another" if len(named) == 1 else f"{len(named)} trials are exact copies of others"
    )
    return marked, [f"{are} and counted once: {', '.join(named[:MOST_NAMED])}{more}"]


def _copies_by_digits(rows: Sequence[Row]) -> dict[int, str]:
    """The original's trial id, by the index of each copy; of two rows, that with more values is the original."""
    with_phi = measures_phi(rows)
    counted = [at for at, row in enumerate(rows) if row.status == OK and digits(row.speed_m_s) >= LONG_DIGITS]
    originals: defaultdict[float, list[Row]] = defaultdict(list)
    found: dict[int, str] = {}
    for at in sorted(counted, key=lambda at: sum(map(math.isnan, measured(rows[at])))):
        alike = originals[rows[at].speed_m_s]
        original = next((row for row in alike if _agree_in_long_values(row, rows[at], with_phi=with_phi)), None)
        if original is None:
            alike.append(rows[at])
        elif original.trial_id != rows[at].trial_id:
            found[at] = original.trial_id
    return found


def _agree_in_long_values(a: Row, b: Row, *, with_phi: bool) -> bool:
    """Whether all values measured in both rows are equal, and enough of them have many digits."""
    pairs = [(one, again) for one, again in zip(measured(a), measured(b), strict=True) if one == one and again == again]
    equal = all(one == again for one, again in pairs)
    pairs += [(a.phi, b.phi)] * (with_phi and a.phi == b.phi)
    return equal and sum(digits(one) >= LONG_DIGITS for one, _ in pairs) >= MIN_LONG_VALUES


def _copies_of_blocks(rows: Sequence[Row]) -> dict[int, str]:
    """The same for consecutive rows that follow each other a second time, if chance does not explain so many."""
    counted = [at for at, row in enumerate(rows) if row.status == OK]
    texts = [repr((_condition(rows[at]), measured(rows[at]))) for at in counted]
    condition = {at: set_point(rows[of]) for at, of in enumerate(counted) if _is_telling(rows[of])}
    pairs = _pairs_of_replicates(condition, texts)
    starts = sum(number for number, _ in pairs.values())
    found: dict[int, str] = {}
    for lag, block in _repeated_blocks(texts):
        telling = [condition[at] for at in block if at in condition]
        number, equal = (sum(pairs[where][i] for where in set(telling)) - len(telling) for i in (0, 1))
        # Rule of succession: the chance that one more pair of replicates is equal, given all others.
        chances = ((equal + 1 + more) / (number + 2 + more) for more in range(len(telling)))
        if starts * math.prod(chances) < BY_CHANCE and telling:
            found |= {counted[at + lag]: rows[counted[at]].trial_id for at in block}
    return found


def _repeated_blocks(texts: Sequence[str]) -> Iterator[tuple[int, list[int]]]:
    """Lag and indices of consecutive rows, each of which is equal to the row that follows it by the lag."""
    places: defaultdict[str, list[int]] = defaultdict(list)
    for at, text in enumerate(texts):
        places[text].append(at)
    again = sorted(
        (second - first, first)
        for same in places.values()
        if len(same) <= TOO_OFTEN
        for first, second in combinations(same, 2)
    )
    for (lag, _), block in groupby(enumerate(again), lambda one: (one[1][0], one[1][1] - one[0])):
        yield lag, [first for _, (_, first) in block]


def rate_of_equal(rows: Sequence[Row]) -> float:
    """How often two replicates of a table have equal values."""
    condition = {at: set_point(row) for at, row in enumerate(rows) if _is_telling(row)}
    pairs = _pairs_of_replicates(condition, [*map(_values, rows)]).values()
    return sum(equal for _, equal in pairs) / max(sum(number for number, _ in pairs), 1)


def _pairs_of_replicates(
    condition: Mapping[int, tuple[float, float, str]], texts: Sequence[str]
) -> dict[tuple[float, float, str], tuple[int, int]]:
    """At each condition, the number of pairs of its rows, and of those that are equal."""
    of: defaultdict[tuple[float, float, str], Counter[str]] = defaultdict(Counter)
    for at, where in condition.items():
        of[where][texts[at]] += 1
    return {
        where: (math.comb(count.total(), 2), sum(math.comb(number, 2) for number in count.values()))
        for where, count in of.items()
    }


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
    return tuple(getattr(row, name) for name in MEASURED)


def measures_phi(rows: Sequence[Row]) -> bool:
    """Whether φ was measured in each trial; if many have the same, it is a set-point or that of a preparation."""
    return 2 * len({row.phi for row in rows}) > len({(row.phi, row.speed_m_s) for row in rows})


def _condition(row: Row) -> tuple[float, float, str]:
    return row.phi, row.omega_rad_s, row.gait


def _values(row: Row) -> str:
    """Condition and observables to 9 digits: unit conversion changes the last."""
    return " ".join(f"{value:.9g}" for value in (row.phi, row.omega_rad_s, *measured(row))) + row.gait


def set_point(row: Row) -> tuple[float, float, str]:
    """What replicates have in common: φ as aimed at, ω in rad/s and the gait."""
    return round(row.phi, SET_POINT_DECIMALS), row.omega_rad_s, row.gait


def _is_telling(row: Row) -> bool:
    return any(digits(value) >= TELLING_DIGITS for value in measured(row))


def _key(row: Row) -> str:
    """All of a trial but its id, order and time; as text, because NaN (not measured) is not equal to itself."""
    return repr(replace(row, trial_id="", run_order=math.nan, started=""))
