"""``read(DATA)`` is the one door by which analysis gets its data: a campaign folder, bags, or a CSV from anywhere."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from sandbot_common.errors import InputError
from sandbot_record.bags.reader import is_bag
from sandbot_record.trials.copies import counted_once, digits, measured
from sandbot_record.trials.csv_table import NAMELESS, read_csv
from sandbot_record.trials.from_bags import campaign, trial_from_bag
from sandbot_record.trials.order import in_order
from sandbot_record.trials.setting import Setting, shared
from sandbot_record.trials.table import Row, Trials, check_ids, check_usable, from_rows

BLOCK = re.compile(r"block\d+")
"""What a campaign calls its batches."""
MANY_DIGITS = 8
"""Digits of what was measured, all together, that no two trials have in common."""


def read(data: Path | str | Sequence[Path | str]) -> Trials:
    """The trials of DATA: a campaign folder, one or more bags, or CSV files (several are joined).

    Where trials are not numbered in the order they were run, or come from several tables, ``started`` tells it; tables
    without it that number their trials anew were run in the order given, and trials of tables that tell no batch share
    one with the others of their table: ``unread`` says so.
    A trial that is in several of them is there once, and ``unread`` says so; another of the same name, as two days on
    one plan give, gets its folder's name before its own, and so do blocks of another campaign. Raises InputError (one
    line: which file, row, column, value) if anything does not fit, if two trials of one table share an id, if they are
    of two robots, or if no trial is usable.

    >>> import sandbot_record
    >>> sandbot_record.read_trials("trial")
    Trials: 1, 1 of them usable; φ 0.619... to 0.619..., ω 12 to 12 rad/s, speed 0.166... to 0.166... m/s
    """
    given = [data] if isinstance(data, Path | str) else list(data)
    if not given:
        raise InputError("no data given: a campaign folder, bags or a trials CSV is needed")
    tables = [_read_one(path) for path in map(Path, given)]
    joined, said = _joined(given, tables)
    by_day = _days(given, joined)
    said += ["no batch is told: the trials of each table are taken for those of one day"] * (by_day != joined)
    where = named(given)
    check_ids(rows := [row for some in by_day for row in some], [where] * len(rows))
    rows, anew = in_order(by_day)
    said += [f"run_order begins anew in {given[at]}, taken for later than what was given before it" for at in anew]
    rows, copied = counted_once(rows)
    said += [*_nearly_one(rows), *copied]
    setting = shared(
        Setting(str(path), table.robot, table.frame_rate_hz, table.accuracy)
        for path, table in zip(given, tables, strict=True)
    )
    unread = tuple(dict.fromkeys([*(clause for table in tables for clause in table.unread), *said]))
    table = replace(from_rows(rows, *setting.for_table), unread=unread)
    check_usable(table, where)
    return table


def named(given: Sequence[Path | str]) -> str:
    """DATA in a message: the first three of its names."""
    return ", ".join(str(path) for path in given[:3]) + (" …" if len(given) > 3 else "")


def _days(given: Sequence[Path | str], tables: list[list[Row]]) -> list[list[Row]]:
    """The same; of several tables each that tells no batch of any trial is one. A single trial has nothing to share."""
    if len(tables) == 1:
        return tables
    return [
        rows if len(rows) < 2 or any(row.batch for row in rows) else [replace(row, batch=str(path)) for row in rows]
        for path, rows in zip(given, tables, strict=True)
    ]


def _nearly_one(rows: Sequence[Row]) -> list[str]:
    """A clause for batches whose names differ in capitals only."""
    names: dict[str, set[str]] = {}
    for row in rows:
        names.setdefault(row.batch.casefold(), set()).add(row.batch)
    alike = [sorted(some) for some in names.values() if len(some) > 1]
    return [f"batches {' and '.join(some)} are taken for {len(some)}" for some in alike]


def _joined(given: Sequence[Path | str], tables: Sequence[Trials]) -> tuple[list[list[Row]], list[str]]:
    """The rows of each table that were not there before, and a clause for each of which some were."""
    joined: list[list[Row]] = []
    again: list[str] = []
    earlier: list[dict[str, Row]] = []
    first_with: dict[str, Path] = {}
    for path, table in zip(given, tables, strict=True):
        own, campaign_of = table.rows(), _campaign_of(Path(path))
        check_ids(own, [str(path)] * len(own))
        by_id = {row.trial_id: row for row in own}
        known = set[str]().union(*(_same(by_id, other) for other in earlier))
        new = [row for row in own if row.trial_id not in known]
        if known:
            again.append(f"{len(known)} trials of {path} are in what was given before it, and count once")
        earlier.append(by_id)
        taken = {row.trial_id for some in joined for row in some}
        joined.append([])
        for row in new:
            trial_id = f"{path}/{row.trial_id}" if row.trial_id in taken else row.trial_id
            # Every campaign numbers its blocks from 1; a day or a preparation is the same in whichever table it stands.
            is_own = BLOCK.fullmatch(row.batch) and first_with.setdefault(row.batch, campaign_of) != campaign_of
            batch = f"{campaign_of}/{row.batch}" if is_own else row.batch
            joined[-1].append(replace(row, trial_id=trial_id, batch=batch))
    return joined, again


def _same(one: Mapping[str, Row], other: Mapping[str, Row]) -> set[str]:
    """Names of the trials that two tables share: all of one name, where none differs; else those that have a name of
    their own and so many digits that no two trials have them all. The 7th row of each day is no one trial, though a
    rounded speed be the same.
    """
    shared = one.keys() & other.keys()
    alike = {name for name in shared if _told(one[name]) == _told(other[name]) or _at_once(one[name], other[name])}
    if alike == shared:
        return alike
    telling = {name for name in alike if sum(map(digits, measured(one[name]))) >= MANY_DIGITS}
    return {name for name in telling if not NAMELESS.fullmatch(name)}


def _told(row: Row) -> list[str]:
    """A row as text, for what was not measured is NaN, which is not itself; in other units its last digits differ."""
    return [value if isinstance(value, str) else f"{value:.9g}" for value in vars(row).values()]


def _at_once(one: Row, other: Row) -> bool:
    """Whether two rows of one name began at the same time of a day: they are one trial, once with fewer digits."""
    return ":" in one.started and one.started == other.started


def _campaign_of(path: Path) -> Path:
    """The folder whose trials are numbered together with those at a path; a table stands for itself."""
    path = path.resolve()
    if is_bag(path):
        path = path.parent
    return path.parent if path.name in ("trials", "trials.csv") else path


def _read_one(path: Path) -> Trials:
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    # What another command writes into a pipe, as in <(grep -v wet trials.csv), can only be a table.
    if path.is_fifo() or (path.is_file() and not is_bag(path)):
        return read_csv(path)
    if is_bag(path):
        return trial_from_bag(path)
    return campaign(path).trials
