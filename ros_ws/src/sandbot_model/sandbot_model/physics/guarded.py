"""A user's effect, run so that it can write into nobody's arrays: what it is handed holds the trials' own values.

``chain.k *= 2`` does what ``chain.k = chain.k * 2`` does, on arrays of any shape as on a tape; ``chain.k[...] = 2`` is
an error of numpy's.
"""

from dataclasses import fields
from typing import Any

import numpy as np

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Values

NAMES = tuple(field.name for field in fields(Chain) if "unit" in field.metadata)
"""Quantities of the chain."""


class Replaced:
    """``x *= y`` puts another x in the place of this one, as ``x = x * y`` does."""

    def _replaced(self, _other: Any) -> Any:
        return NotImplemented  # Python then takes the operator that makes a new one

    __iadd__ = __isub__ = __imul__ = __itruediv__ = __ifloordiv__ = __imod__ = __ipow__ = _replaced


class Quantity(Replaced, np.ndarray[Any, np.dtype[np.float64]]):
    """An array that can't be written into."""


def apply(effect: Effect, chain: Chain, p: Values) -> None:
    """Let an effect act; a user's is guarded, and what the chain then holds are plain arrays again."""
    if type(effect).__module__.startswith(f"{__package__}."):
        effect.apply(chain, p)  # of this package, which writes into no array; guarding it would take twice the time
        return
    for name in _set(chain):
        setattr(chain, name, _quantity(getattr(chain, name)))
    effect.apply(chain, {name: _quantity(value) for name, value in p.items()})
    for name in _set(chain):
        value = getattr(chain, name)
        setattr(chain, name, np.asarray(value, dtype=float) if isinstance(value, np.ndarray | float | int) else value)


def _set(chain: Chain) -> list[str]:
    return [name for name in NAMES if hasattr(chain, name)]


def _quantity(value: Any) -> Any:
    """An array as a ``Quantity``; what is on a tape as it is."""
    if not isinstance(value, np.ndarray | np.generic):
        return value
    view = np.asarray(value).view(Quantity)
    view.flags.writeable = False
    return view
