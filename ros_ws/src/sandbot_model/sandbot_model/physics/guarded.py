"""Runs a user's effect so that it cannot write into the arrays it is given, some of which hold the trials' own values.

``chain.k *= 2`` does what ``chain.k = chain.k * 2`` does, on arrays of any shape and on a tape; ``chain.k[...] = 2``
raises numpy's error for read-only arrays.
"""

from dataclasses import fields
from typing import Any

import numpy as np

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Values

NAMES = tuple(field.name for field in fields(Chain) if "unit" in field.metadata)
"""Quantities of the chain."""


class Replaced:
    """``x *= y`` makes a new object, as ``x = x * y`` does."""

    def _replaced(self, _other: Any) -> Any:
        return NotImplemented  # Python then takes the operator that makes a new one

    __iadd__ = __isub__ = __imul__ = __itruediv__ = __ifloordiv__ = __imod__ = __ipow__ = _replaced


class Quantity(Replaced, np.ndarray[Any, np.dtype[np.float64]]):
    """A read-only array."""


def apply(effect: Effect, chain: Chain, p: Values) -> None:
    """Let an effect act; a user's is guarded, and the chain holds plain arrays again afterwards."""
    if type(effect).__module__.startswith(f"{__package__}."):
        effect.apply(chain, p)  # effects of this package write into no array, and guarding them would double the time
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
    """An array as a ``Quantity``; a recorded quantity unchanged."""
    if not isinstance(value, np.ndarray | np.generic):
        return value
    view = np.asarray(value).view(Quantity)
    view.flags.writeable = False
    return view
