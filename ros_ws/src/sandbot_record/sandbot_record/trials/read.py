"""``read(DATA)``: the single way by which analysis gets its data, from a campaign folder, bags or any trials CSV."""

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, islice
from pathlib import Path

from sandbot_common.errors import InputError
from sandbot_common.terminal import counted
from sandbot_record.bags.reader import is_bag
from sandbot_record.trials.copies import mark_copies
from sandbot_record.trials.from_bags import campaign, table_of, trial_from_bag
from sandbot_record.trials.gaits import with_only_gait
from sandbot_record.trials.order import in_order
from sandbot_record.trials.same_trials import Table, merged, overlap, same_trials
from sandbot_record.trials.setting import Setting, shared
from sandbot_record.trials.table import Row, Trials, check_ids, check_usable, from_rows

BLOCK = re.compile(r"block\d+")
"""Names of the batches of a campaign."""
NO_TABLES = (".yaml", ".json")
"""What the project writes beside trials, and is given in their place by mistake."""


def read(data: Path | str | Sequence[Path | str]) -> Trials:
    """The trials of DATA: a campaign folder, one or more bags, or CSV files (several are joined).

    The order of the trials is taken from ``started`` if they are not numbered or come from several tables; tables
    without it that restart the numbering are assumed to follow each other as given, and a table without batches, of
    several, is treated as one batch. A trial that is in several of them is counted once; different trials of the same
    name, as from two days on one plan, get their folder's name as a prefix, and so do blocks of another campaign.
    ``unread`` notes all but the prefixes. Raises InputError (one line: which file, row, column, value) if anything does
    not fit, if two trials of one table share an id, if they are of two robots, or if no trial is usable.

    >>> import sandbot_record
    >>> sandbot_record.read_trials("trial")
    Trials: 1, 1 of them usable; φ 0.619... to 0.619..., ω 12 to 12 rad/s, speed 0.166... to 0.166... m/s
    """
    given = [data] if isinstance(data, Path | str) else list(data)
    if not given:
        raise InputError("no data given: a campaign folder, bags or a trials CSV is needed")
    tables = [_read_one(path) for path in map(Path, given)]
    joined, notes = _joined(given, tables)
    batched = _with_batches(given, joined)
    notes += ["no batch is given: each table is treated as the trials of one day"] * (batched != joined)
    where = named(given)
    check_ids(rows := [row for table_rows in batched for row in table_rows], [where] * len(rows))
    rows, restarted = in_order(batched)
    notes += [f"run_order starts again in {given[at]}, assumed later than the data before it" for at in restarted]
    rows, gait_assumed = with_only_gait(rows)
    rows, copied = mark_copies(rows)
    notes += [*gait_assumed, *_similar_batches(rows), *copied, *_overlaps(given, batched, rows)]
    setting = shared(
        Setting(str(path), table.robot, table.frame_rate_hz, table.accuracy)
        for path, table in zip(given, tables, strict=True)
    )
    unread = tuple(dict.fromkeys([*(clause for table in tables for clause in table.unread), *notes]))
    table = replace(from_rows(rows, *setting.for_table), unread=unread)
    check_usable(table, where)
    return table


def named(given: Sequence[Path | str]) -> str:
    """DATA as written in messages: the first three names."""
    return ", ".join(str(path) for path in given[:3]) + (" …" if len(given) > 3 else "")


def _with_batches(given: Sequence[Path | str], tables: list[list[Row]]) -> list[list[Row]]:
    """The same rows; of several tables with rows, each without any batch becomes one, unless it is a single trial."""
    if sum(map(bool, tables)) == 1:
        return tables
    return [
        rows if len(rows) < 2 or any(row.batch for row in rows) else [replace(row, batch=str(path)) for row in rows]
        for path, rows in zip(given, tables, strict=True)
    ]


def _similar_batches(rows: Sequence[Row]) -> list[str]:
    """A note on batches whose names differ only in capitals."""
    names: dict[str, set[str]] = {}
    for row in rows:
        names.setdefault(row.batch.casefold(), set()).add(row.batch)
    alike = [sorted(some) for some in names.values() if len(some) > 1]
    return [f"batches {' and '.join(some)} are treated as {len(some)} batches" for some in alike]


def _joined(given: Sequence[Path | str], tables: Sequence[Trials]) -> tuple[list[list[Row]], list[str]]:
    """The rows of each table that are not in earlier ones, with all that any table says of them, and a note for each
    table of which some are."""
    joined: list[list[Row]] = []
    notes: list[str] = []
    earlier: list[tuple[Table, dict[str, tuple[int, int]]]] = []  # each with the places of its trials in ``joined``
    first_with: dict[str, Path] = {}
    for path, table in zip(given, tables, strict=True):
        own, campaign_of = Table(table.rows()), _campaign_of(Path(path))
        check_ids(own.rows, [str(path)] * len(own.rows))
        known: dict[str, tuple[int, int]] = {}
        for other, place in earlier:
            known = {name: place[there] for name, there in same_trials(own, other).items()} | known
        if known:
            notes.append(f"{len(known)} trials of {path} are also in the data before it and are counted once")
        taken = {row.trial_id for earlier_rows in joined for row in earlier_rows}
        joined.append([])
        earlier.append((own, known))
        for row in own.rows:
            if row.trial_id in known:
                at, index = known[row.trial_id]
                joined[at][index] = merged(joined[at][index], row)
                continue
            trial_id = f"{path}/{row.trial_id}" if row.trial_id in taken else row.trial_id
            # Every campaign numbers its blocks from 1; other batches, such as days, are the same in every table.
            is_own = BLOCK.fullmatch(row.batch) and first_with.setdefault(row.batch, campaign_of) != campaign_of
            batch = f"{campaign_of}/{row.batch}" if is_own else row.batch
            known[row.trial_id] = len(joined) - 1, len(joined[-1])
            joined[-1].append(replace(row, trial_id=trial_id, batch=batch))
    return joined, notes


def _overlaps(given: Sequence[Path | str], tables: Sequence[Sequence[Row]], rows: Sequence[Row]) -> list[str]:
    """A note on each two tables that seem to share trials, none of which is certain; ``rows``: those of all tables."""
    each = iter(rows)
    left = [(path, Table(list(islice(each, len(own))))) for path, own in zip(given, tables, strict=True)]
    return [
        f"{number} trials of {path} have the values of trials of {before}, as far as both give digits, and are counted "
        "as others: if they are the same, leave them out of one of both"
        for (before, earlier), (path, later) in combinations(left, 2)
        if (number := overlap(later, earlier))
    ]


def _campaign_of(path: Path) -> Path:
    """The campaign folder of a path; any other table is its own."""
    path = path.resolve()
    if is_bag(path):
        path = path.parent
    return path.parent if path.name in ("trials", "trials.csv") else path


def _read_one(path: Path) -> Trials:
    if not path.exists():
        raise InputError(f"{path}: no such file or folder{'; standard input is /dev/stdin' * (str(path) == '-')}")
    if path.is_file() and path.suffix in NO_TABLES:
        raise InputError(f"{path}: not trials; a campaign folder, bags or a trials CSV is needed")
    # A pipe, as in <(grep -v wet trials.csv), can only be a table.
    if path.is_fifo() or (path.is_file() and not is_bag(path)):
        return table_of(path)
    if is_bag(path):
        return trial_from_bag(path)
    report = campaign(path)
    return replace(report.trials, unread=(*report.trials.unread, *_skipped([*report.skipped.values()])))


def _skipped(reasons: Sequence[str]) -> list[str]:
    """A note on the bags that were skipped, with the reason for the first."""
    more = f" (and {counted(len(reasons) - 1, 'more bag')}: see trackway table)" if len(reasons) > 1 else ""
    return [f"skipped: {reasons[0]}{more}"] if reasons else []
