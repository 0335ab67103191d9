"""Tables as pandas DataFrames, where pandas is installed."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from sandbot_common.errors import InputError

if TYPE_CHECKING:
    from pandas import DataFrame


def data_frame(table: Mapping[str, Any] | Sequence[Mapping[str, Any]], instead: str) -> "DataFrame":
    """A table, given by columns or by rows, as a DataFrame.

    Raises InputError if pandas is not installed, naming what gives the same numbers ``instead``.
    """
    try:
        from pandas import DataFrame
    except ImportError:
        raise InputError(f"pandas is not installed; pip install pandas (the same numbers: {instead})") from None
    return DataFrame(table)
