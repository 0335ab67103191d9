"""numba's njit with types kept, and a fingerprint of the compiled sources."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from sandbot_common.compiled import compiled

F = TypeVar("F", bound=Callable[..., Any])


def jit(function: F) -> F:
    """Compile in nopython mode and cache the result on disk."""
    found: F = compiled(function)
    return found


def fingerprint() -> str:
    """A field name that changes with the source of any compiled module.

    numba's cache checks only the entry point's own file: an edit to a function it calls would go unnoticed. A record
    field with this name makes the fingerprint part of the entry point's signature.
    """
    sources = [path.read_bytes() for path in sorted(Path(__file__).parent.glob("*.py"))]
    digest = hashlib.sha256(b"".join(source for source in sources if b"\n@jit\n" in source))
    return f"source_{digest.hexdigest()[:12]}"
