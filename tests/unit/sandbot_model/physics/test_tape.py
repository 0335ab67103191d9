"""Recording: each operation does what numpy's does, and what can't be written down is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_model.physics import machine
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.machine import BINARY, COMPARISONS, OF_FEET, UNARY
from sandbot_model.physics.tape import Tape, Unrecordable, by_depth, depth_last, moved, program, record
from sandbot_model.physics.walking import Walker

X = np.array([-2.5, -1.0, -0.5, 0.0, 0.3, 1.0, 2.0, np.nan])
Y = np.array([2.0, -1.0, 0.5, 0.0, -3.0, 1.0, 0.25, 1.0])
TABLE = np.array([-1.0, 0.0, 0.5, 2.0]), np.array([3.0, 1.0, -1.0, 5.0])
FUNCTIONS = {
    **{name: lambda x, _, name=name: getattr(np, name)(x) for name in UNARY},
    **{name: lambda x, y, name=name: getattr(np, name)(x, y) for name in (*BINARY, *COMPARISONS)},
    "where": lambda x, y: np.where((x < y) & ~(x == 0.3) | np.logical_not(y <= 1), x, y * 2),
    "clip": lambda x, y: np.clip(x, -0.7, y),
    "interp": lambda x, _: np.interp(x, *TABLE),
    "powers": lambda x, _: x**2 + x**1 + abs(x) ** 0.5 + 3 / x - 1.0 * x + 0.0,
}


def executed(function, x, y):
    tape = Tape(["x", "y"])
    tape.output("z", function(tape.input("x"), tape.input("y")))
    made = program(tape, ("z",), {"x": (OF_FEET, 0), "y": (OF_FEET, 1)}, {})
    n = len(x)
    rows = np.zeros((1, 0)), np.zeros((0, 1, 1)), np.zeros((1, 1, n)), np.zeros(0), np.zeros((1, 0))
    return machine.evaluate(made, rows, np.stack([x, y])[:, None])[0, 0]


@pytest.mark.filterwarnings("ignore:invalid value|divide by zero")
@pytest.mark.parametrize("name", FUNCTIONS)
def test_an_operation_is_that_of_numpy(name):
    expected = FUNCTIONS[name](X, Y)
    np.testing.assert_allclose(executed(FUNCTIONS[name], X, Y), expected, rtol=4e-16)


@given(st.lists(st.floats(-10, 10), min_size=1, max_size=600))
def test_of_any_number_of_points(values):
    x = np.array(values)
    np.testing.assert_array_equal(executed(lambda x, y: x * y - x / 3, x, x + 1), x * (x + 1) - x / 3)


def test_the_same_operation_is_done_once_and_what_no_output_needs_is_not():
    tape = Tape(["x", "y"])
    x, y = tape.input("x"), tape.input("y")
    _unused = np.exp(y)
    tape.output("z", (x * y) + (x * y))
    assert len(program(tape, ("z",), {}, {}).code) == 2


def test_what_is_the_same_at_all_points_is_done_once_for_them_and_so_is_what_is_the_same_in_a_row_or_cell():
    tape = Tape(["theta", "omega", "k", "depth"])
    theta, omega, k, depth = (tape.input(name) for name in ("theta", "omega", "k", "depth"))
    tape.output("z", np.exp(theta * theta) * depth + np.sqrt(omega) - k * np.cos(depth))
    of = {"theta": (machine.OF_ROW, 0), "omega": (machine.OF_CELL, 0), "k": (machine.OF_NODE, 0)}
    scan, levels = by_depth(program(tape, ("z",), of, {}))
    names = ("cos", "multiply", "exp", "multiply", "sqrt", "add", "multiply", "subtract")
    assert [machine.NUMBER[name] for name in names] == scan.code[:, 0].tolist()
    assert levels.tolist() == [1, 4, 6]
    # A result is put down at all points where something that is not the same at all of them reads it.
    each, once, spread = machine.EACH, machine.ONCE, machine.BROADCAST
    assert scan.code[:, 5].tolist() == [each, once, spread, each, spread, each, each, each]


def test_of_a_move_nothing_is_done_again_but_what_follows_from_it():
    tape = Tape(["theta", "k", "depth"])
    theta, k, depth = (tape.input(name) for name in ("theta", "k", "depth"))
    tape.output("z", np.exp(depth) * np.sqrt(theta) - k * theta)
    of = {"theta": (machine.OF_ROW, 0), "k": (machine.OF_NODE, 0), "depth": (machine.OF_FEET, 0)}
    plain = program(tape, ("z",), of, {})
    again = moved(plain, [{tape.inputs["k"]}, {tape.inputs["depth"]}, set()])
    names = [machine.NUMBER[name] for name in ("multiply", "subtract", "exp", "multiply", "subtract")]
    assert again.code[:, 0].tolist() == names
    assert again.lines.tolist() == [0, 2, 5, 5]
    assert again.own.tolist() == [0, 1, 2, 2]
    # What nothing was moved of is where the program has it.
    result = plain.outputs[0]
    assert again.results.ravel().tolist() == [result + plain.registers, result + plain.registers, result]


def test_what_the_depth_changes_comes_last_whatever_came_between():
    tape = Tape(["theta", "k", "depth"])
    theta, k, depth = (tape.input(name) for name in ("theta", "k", "depth"))
    tape.output("z", np.exp(depth) * np.sqrt(theta) - k * theta)
    of = {"theta": (machine.OF_ROW, 0), "k": (machine.OF_NODE, 0)}
    arranged, first = depth_last(program(tape, ("z",), of, {}), tape.inputs["depth"])
    names = [machine.NUMBER[name] for name in ("sqrt", "multiply", "exp", "multiply", "subtract")]
    assert arranged.code[:, 0].tolist() == names
    assert first == 2


REFUSED = {
    "a decision by value": lambda x, y: x if x > 0 else y,
    "an array by value": lambda x, _: np.asarray(x),
    "a table of other numbers": lambda x, _: x + np.arange(3.0),
    "a reduction": lambda x, y: np.maximum.reduce([x, y]),
    "a function that is not listed": lambda x, _: np.sinc(x),
    "arithmetic of truth values": lambda x, y: (x > 0) + (y > 0),
    "logic of numbers": lambda x, y: np.logical_and(x, y),
}


@pytest.mark.parametrize("why", REFUSED)
def test_what_can_not_be_written_down_is_refused(why):
    tape = Tape(["x", "y"])
    with pytest.raises((Unrecordable, AttributeError)):
        REFUSED[why](tape.input("x"), tape.input("y"))


class Deciding(Effect):
    """A user's effect that looks at values."""

    identifier, stage, formula, source, seen_in = "deciding", "strength", "-", "-", "-"

    def apply(self, chain, p):
        chain.k = chain.k * (0.9 if np.all(chain.omega > 10) else 1.0)


@pytest.mark.parametrize("effect", catalogue().values(), ids=lambda effect: effect.identifier)
def test_the_whole_catalogue_can_be_recorded(effect):
    assert record(Walker((effect,))) is not None


def test_a_formula_can_be_recorded_and_an_effect_that_decides_by_value_can_not():
    assert record(Walker((formula_effect("grip: speed: kept, peak_ratio *= 1 - a*d/R; a [1] in 0..1"),))) is not None
    assert record(Walker((Deciding(),))) is None
