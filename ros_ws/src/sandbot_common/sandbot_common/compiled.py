"""numba's njit, cached on disk if there is room for the cache, and compiled by each process if there is none.

By itself numba refuses to import a module whose cache has no place, as of an installation that may not be written to by
a user without a home, and ends a command whose cache meets a full disk. It also compares a cached function with the
source of its own module only: after a change in another module, whose functions are compiled into it, it would run as
it was before.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from itertools import product
from types import ModuleType
from typing import Any

import numba
from numba.core.registry import CPUDispatcher


def compiled(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """As ``numba.njit(cache=True, **options)``, with or without options."""
    if function is None:
        return partial(compiled, **options)
    try:
        found = numba.njit(cache=True, **options)(function)
    except RuntimeError:  # no locator: nowhere to write
        return numba.njit(**options)(function)
    index = found._cache._cache_file
    index._source_stamp = (index._source_stamp, *_compiled_in(function))
    found._cache.save_overload = partial(_save, found._cache.save_overload)
    return found


def _compiled_in(function: Callable[..., Any]) -> Iterator[Any]:
    """What identifies the compiled functions and constants that a function names, also those of modules."""
    own = function.__globals__
    modules = [own[name] for name in function.__code__.co_names if isinstance(own.get(name), ModuleType)]
    for name, names in product(function.__code__.co_names, (own, *map(vars, modules))):
        used: Any = names.get(name)
        if isinstance(used, CPUDispatcher) and hasattr(used._cache, "_cache_file"):
            yield used._cache._cache_file._source_stamp
        elif isinstance(used, (int, float, tuple)):
            yield repr(used)


def _save(save: Callable[..., None], *overload: Any) -> None:
    with suppress(OSError):
        save(*overload)
