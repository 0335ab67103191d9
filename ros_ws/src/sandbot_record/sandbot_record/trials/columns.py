"""What a column of the trials table may hold: kinds of quantities, with the units in which tables give them."""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Kind:
    """A kind of quantity [SI]."""

    needed: str = ""
    """What a value has to be, for an error message."""
    low: float = -math.inf
    high: float = math.inf
    """Bounds, both excluded."""
    factors: Mapping[str, float] = field(default_factory=dict)
    """Factors to the table's unit, by the unit in a column's name; "1": none is needed."""
    whole: bool = False
    """Whether only whole numbers are meant."""

    def admits(self, value: float) -> bool:
        """Whether a value is one of this kind."""
        return self.low < value < self.high and not (self.whole and value % 1)


@dataclass(frozen=True)
class Column:
    """A column: of numbers of a kind, NaN where not measured, or of text."""

    kind: Kind | None = None
    """None: text."""
    names: tuple[str, ...] = ()
    """Names of the quantity without its unit, which a table may use with another unit; a pure number needs none."""
    optional: bool = False
    """Whether it is left out of a file where it is empty."""

    @property
    def is_text(self) -> bool:
        """Whether it holds text."""
        return self.kind is None

    @property
    def factors(self) -> Mapping[str, float]:
        """Factors to the table's unit; none if the column has no unit."""
        return self.kind.factors if self.kind else {}


_BELOW_0 = -math.ulp(0.0)
_SPEEDS = {"m/s": 1.0, "cm/s": 0.01, "mm/s": 0.001}

NUMBER = Kind()
VOLUME_FRACTION = Kind(
    "a volume fraction between 0 and 1, both excluded", 0.0, 1.0, factors={"1": 1.0, "-": 1.0, "%": 0.01}
)
LEG_FREQUENCY = Kind(
    "a leg frequency above 0 rad/s",
    0.0,
    1000.0,
    factors={"rad/s": 1.0, "hz": 2 * math.pi, "rpm": math.pi / 30, "deg/s": math.pi / 180},
)
SPEED = Kind("a speed in m/s", -10.0, 10.0, factors=_SPEEDS)
LENGTH = Kind("a length in m", -10.0, 10.0, factors={"m": 1.0, "cm": 0.01, "mm": 0.001, "μm": 1e-6, "um": 1e-6})
LIFT = dataclasses.replace(LENGTH, low=-1.0, high=1.0)
STANDARD_DEVIATION = Kind("a standard deviation of 0 or more", _BELOW_0)
SD_OF_SPEED = dataclasses.replace(STANDARD_DEVIATION, factors=_SPEEDS)
NUMBER_OF_TRIALS = Kind("a whole number of trials above 0", 0.0, 1e6, factors={"1": 1.0, "-": 1.0}, whole=True)


def number(kind: Kind = NUMBER, *names: str, optional: bool = False) -> Any:
    """A dataclass field that is a column of numbers; NaN: not measured."""
    return field(default=math.nan, metadata={"column": Column(kind, names, optional)})


def text(default: str = "", *, optional: bool = False) -> Any:
    """A dataclass field that is a column of text."""
    return field(default=default, metadata={"column": Column(optional=optional)})
