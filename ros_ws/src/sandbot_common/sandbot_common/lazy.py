"""A package's public names, each imported on first access, so that importing the package is cheap (PEP 562)."""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def attach(package: str, modules: Mapping[str, str]) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """``__getattr__`` and ``__dir__`` of ``package``; ``modules`` maps each name to the module that defines it.

    ".module" is one of the package's own; "module:name" if the module calls it by another name.
    """

    def get(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module, _, there = modules[name].partition(":")
        return getattr(import_module(module, package), there or name)

    return get, lambda: sorted(modules)
