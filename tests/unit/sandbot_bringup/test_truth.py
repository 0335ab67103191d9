import pytest

from sandbot_bringup.truth import judge


def verdict(status, effects=(), alternatives=()):
    return {"status": status, "effects": list(effects), "alternatives": [list(one) for one in alternatives]}


@pytest.mark.parametrize(
    ("truth", "given", "agrees"),
    [
        (set(), verdict("adequate"), True),
        ({"a"}, verdict("adequate"), False),
        ({"a"}, verdict("identified", ["a"]), True),
        ({"a"}, verdict("identified", ["b"]), False),
        ({"a"}, verdict("identified", ["a", "b"]), False),
        ({"a", "b"}, verdict("identified", ["b", "a"]), True),
        (set(), verdict("identified", ["a"]), False),
        ({"a"}, verdict("ambiguous", ["b"], [["b"], ["a"]]), True),
        ({"a"}, verdict("ambiguous", ["b"], [["b"], ["c"]]), False),
        ({"a"}, verdict("unexplained"), False),
        ({"a"}, verdict("untested"), False),
        (set(), verdict("untested"), False),
    ],
)
def test_only_the_truth_agrees(truth, given, agrees):
    assert judge(frozenset(truth), given).agrees is agrees
