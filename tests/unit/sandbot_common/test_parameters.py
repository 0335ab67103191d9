import math
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_common.errors import InputError
from sandbot_common.parameters import from_mapping, parameter, specs


@dataclass(frozen=True)
class Place:
    x_m: float = parameter(unit="m", doc="where", low=0.0)


@dataclass(frozen=True)
class Example:
    length_m: float = parameter(unit="m", doc="a length", low=0.0, high=2.0)
    count: int = parameter(3, doc="a count", low=1)
    kind: str = parameter("soft", doc="a kind", choices=("soft", "hard"))
    gait: str = parameter("", doc="a gait", choices=("", "even"))
    levels: tuple[float, ...] = parameter((0.5,), doc="levels", low=0.0, high=1.0)
    on: bool = parameter(False, doc="a switch")
    extra: dict[str, float] = parameter({}, doc="anything")
    limit_s: float | None = parameter(None, doc="a limit", low=0.0)
    place: Place = parameter(Place(0.0), doc="a place")
    rows: tuple[tuple[float, ...], ...] = parameter((), doc="rows")


def build(**values):
    return from_mapping(Example, {"length_m": 1, **values}, "plan.yaml: robot")


def test_defaults_and_conversion():
    example = build(levels=[0, 1], limit_s=2)
    assert (example.length_m, type(example.length_m)) == (1.0, float)
    assert example.levels == (0.0, 1.0)
    assert example.limit_s == 2.0
    assert build().limit_s is None
    assert build(place={"x_m": 2}).place == Place(2.0)
    assert build(rows=[[1, 2], [3]]).rows == ((1.0, 2.0), (3.0,))


def test_defaults_are_not_shared():
    assert build().extra is not build().extra


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"length_m": 2.1}, r"plan.yaml: robot: length_m: 2.1 is outside \[0, 2\] m \(a length\)"),
        ({"length_m": math.nan}, r"length_m: nan is not a finite number \(a length\)"),
        ({"length_m": "1"}, "length_m: '1' is not a number"),
        ({"length_m": True}, "length_m: True is not a number"),
        ({"count": 1.5}, "count: 1.5 is not a whole number"),
        ({"count": 0}, "count: 0 is outside"),
        ({"kind": "wet"}, "kind: 'wet' is not one of soft, hard"),
        ({"gait": "TROT"}, r"gait: 'TROT' is not one of '' \(empty\), even"),
        ({"levels": 0.5}, "levels: 0.5 is not a list"),
        ({"levels": [0.5, 1.5]}, "levels: 1.5 is outside"),
        ({"extra": 1}, "extra: 1 is not a mapping"),
        ({"on": 1}, "on: 1 is not true or false"),
        ({"limit_s": -1}, "limit_s: -1 is outside"),
        ({"place": 1}, "robot: place: expected a mapping"),
        ({"place": {"x_m": -1}}, r"robot: place: x_m: -1 is outside"),
        ({"rows": [1]}, "rows: 1 is not a list"),
        ({"lenght_m": 1}, "unknown key 'lenght_m', did you mean 'length_m'"),
        ({"zzz": 1}, "unknown key 'zzz'; known: length_m, count"),
    ],
)
def test_refuses_with_the_place_the_value_and_what_is_right(values, complaint):
    with pytest.raises(InputError, match=complaint):
        build(**values)


def test_refuses_a_missing_key_and_what_is_no_mapping():
    with pytest.raises(InputError, match=r"missing key 'length_m' \(a length\)"):
        from_mapping(Example, {}, "x")
    with pytest.raises(InputError, match="expected a mapping"):
        from_mapping(Example, [1], "x")


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_bounds_hold_for_every_number(value):
    if 0.0 <= value <= 2.0:
        assert build(length_m=value).length_m == value
    else:
        with pytest.raises(InputError, match="outside" if math.isfinite(value) else "finite"):
            build(length_m=value)


def test_specs_keep_order_unit_and_meaning():
    assert [spec.name for spec in specs(Example)][:2] == ["length_m", "count"]
    assert (specs(Example)[0].unit, specs(Example)[0].doc) == ("m", "a length")
