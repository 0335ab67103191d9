"""numba's njit, cached on disk if there is room for the cache, and compiled by each process if there is none.

By itself numba refuses to import a module whose cache has no place, as of an installation that may not be written to by
a user without a home, and ends a command whose cache meets a full disk.
"""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

import numba


def compiled(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """As ``numba.njit(cache=True, **options)``, with or without options."""
    if function is None:
        return partial(compiled, **options)
    try:
        found = numba.njit(cache=True, **options)(function)
    except RuntimeError:  # no locator: nowhere to write
        return numba.njit(**options)(function)
    found._cache.save_overload = partial(_save, found._cache.save_overload)
    return found


def _save(save: Callable[..., None], *overload: Any) -> None:
    with suppress(OSError):
        save(*overload)
