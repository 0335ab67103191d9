"""What a function of the Python API takes, and what its errors name."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from sandbot_common.errors import InputError
from sandbot_common.typed import check_types, is_a, number_or_nan


def api(
    data: "anything",  # noqa: F821
    names: Sequence[str | Path] = (),
    count: int = 1,
    rate: float | None = None,
    heard: Callable[[int], None] = print,
    by_name: Mapping[str, int] | str = "",
) -> int:
    check_types(api, locals())
    return 0


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"names": ["a", Path("b")], "count": np.int64(3), "rate": 2},
        {"names": np.array(["a"]), "rate": np.float32(2.0), "by_name": {"a": 1}},
        {"names": {"a"}, "rate": None, "heard": len},
    ],
)
def test_what_is_of_its_type_is_taken(given):
    assert api(object(), **given) == 0


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"names": "a"}, "names: 'a' is one string; a list is needed, ['a']"),
        ({"names": ["a", 3]}, "names: ['a', 3]; a list (a string or Path each) is needed"),
        ({"names": None}, "names: None; a list (a string or Path each) is needed"),
        ({"count": 1.5}, "count: 1.5; a whole number is needed"),
        ({"count": True}, "count: True; a whole number is needed"),
        ({"rate": "2"}, "rate: '2'; a number or None is needed"),
        ({"heard": None}, "heard: None; a function is needed"),
        ({"by_name": {"a": "b"}}, "by_name: {'a': 'b'}; a mapping to a whole number or a string is needed"),
        (
            {"by_name": np.zeros((3, 40))},
            "by_name: array([[0., 0., 0., 0., 0., 0., 0., 0., 0., 0., 0., [...]; a mapping",
        ),
    ],
)
def test_what_is_not_is_named_in_one_line(given, said):
    with pytest.raises(InputError) as caught:
        api(object(), **given)
    assert str(caught.value).startswith(said)
    assert "\n" not in str(caught.value)


def test_a_number_is_no_truth_value_and_no_text():
    assert [is_a(value, float) for value in (1, 0.5, np.float64(2), True, np.True_, "1", None)] == [True] * 3 + [
        False
    ] * 4


@pytest.mark.parametrize("said", ["", "abc", "²", None, [], [10**5000], "nan"])
def test_what_is_no_number_is_nan(said):
    assert np.isnan(number_or_nan(said))


@pytest.mark.parametrize(("said", "number"), [("1.5", 1.5), (" -2 ", -2.0), (3, 3.0), ("inf", np.inf)])
def test_a_number_is_read_however_it_is_given(said, number):
    assert number_or_nan(said) == number
