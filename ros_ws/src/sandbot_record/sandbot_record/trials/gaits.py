"""Trials that name no gait, where all others name the same."""

from collections.abc import Sequence
from dataclasses import replace

from sandbot_common.terminal import counted
from sandbot_record.trials.table import OK, Row


def with_only_gait(rows: Sequence[Row]) -> tuple[list[Row], list[str]]:
    """The same rows, those without a gait in the only one that the others name; and a note on their number, if any.

    Where the others name several gaits, or none does, it stays unknown: analysis then assumes one, and says so.
    """
    counting = [row for row in rows if row.status == OK]
    named, nameless = {row.gait for row in counting} - {""}, sum(not row.gait for row in counting)
    if len(named) != 1 or not nameless:
        return list(rows), []
    (gait,) = named
    return [row if row.gait else replace(row, gait=gait) for row in rows], [
        f"{counted(nameless, 'trial')} without a gait: {gait} is assumed, the only one that others name"
    ]
