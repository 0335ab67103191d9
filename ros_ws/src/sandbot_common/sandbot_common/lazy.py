"""A package's public names, each imported on first access, so that importing the package is cheap (PEP 562)."""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def door(package: str, homes: Mapping[str, str]) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """``__getattr__`` and ``__dir__`` of ``package``; ``homes`` maps each name to the module that defines it.

    ".module" is one of the package's own; "module:name" if the module calls it by another name.
    """

    def get(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module, _, there = homes[name].partition(":")
        return getattr(import_module(module, package), there or name)

    return get, lambda: sorted(homes)
