"""The trials table from a pandas DataFrame, without importing pandas."""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from sandbot_record.trials.copies import mark_copies
from sandbot_record.trials.csv_table import rows_of
from sandbot_record.trials.gaits import with_only_gait
from sandbot_record.trials.header import unread
from sandbot_record.trials.order import in_order
from sandbot_record.trials.table import Trials, from_rows

if TYPE_CHECKING:
    from pandas import DataFrame


def is_frame(data: object) -> bool:
    """Whether ``data`` is a pandas DataFrame."""
    return type(data).__module__.split(".")[0] == "pandas" and hasattr(data, "columns")


def from_frame(frame: "DataFrame") -> Trials:
    """The table of a DataFrame with the columns of a trials CSV; NaN and None are "not measured".

    All checks of a CSV apply; row numbers in messages start at 2, as if the frame were written below a header. Raises
    InputError.
    """
    header = [str(name) for name in frame.columns]
    lines = (
        (number, dict(zip(header, map(_text, row), strict=True)))
        for number, row in enumerate(frame.itertuples(index=False, name=None), start=2)
    )
    rows, _ = in_order([rows_of(header, lines, "data")])
    rows, gait_assumed = with_only_gait(rows)
    rows, copied = mark_copies(rows)
    return replace(from_rows(rows), unread=(*unread(header), *gait_assumed, *copied))


def _text(value: Any) -> str:
    return "" if value is None or _is_missing(value) else str(value)


def _is_missing(value: Any) -> bool:
    """Whether a value is NaN or NaT, which are not equal to themselves, or pandas.NA, whose comparisons are NA."""
    unlike = value != value
    return unlike is value or bool(unlike)
