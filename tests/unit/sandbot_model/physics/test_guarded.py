"""A user's effect may work in place: it changes its chain, never the arrays that a fit holds."""

import numpy as np
import pytest

from sandbot_model.physics.effect import Effect, Parameter
from sandbot_model.physics.tape import record
from sandbot_model.physics.walking import Inputs, Walker


def effect(stage, does):
    """An effect of a user's file: ``does(chain, p)``."""
    said = {"identifier": "own", "stage": stage, "formula": "-", "source": "-", "seen_in": "-"}
    parameters = (Parameter("a", "1", 0.0, 0.5, 0.1, "-"),)
    return type("Own", (Effect,), {**said, "parameters": parameters, "apply": lambda _, chain, p: does(chain, p)})()


def arrays():
    """Shaped as a fit has them."""
    inputs = Inputs(np.array([180.0, 220.0]), np.linspace(4.0, 28.0, 5)[:, None], 0.4, 0.6)
    return inputs, np.array([0.1, 0.2, 0.3])[:, None, None]


def kept(chain, p):
    chain.kept *= 1 - p["a"]


def step(chain, p):
    chain.step -= 0.1 * p["a"] * chain.step


def stiffness(chain, p):
    chain.k /= 1 + p["a"]


def frequency(chain, p):
    chain.omega *= 1 - p["a"]


def its_own_parameter(chain, p):
    share = p["a"]
    share *= 2
    chain.kept = chain.kept * (1 - p["a"])


WRITTEN_OUT = {
    kept: ("speed", lambda chain, p: setattr(chain, "kept", chain.kept * (1 - p["a"]))),
    step: ("step", lambda chain, p: setattr(chain, "step", chain.step - 0.1 * p["a"] * chain.step)),
    stiffness: ("strength", lambda chain, p: setattr(chain, "k", chain.k / (1 + p["a"]))),
    frequency: ("clock", lambda chain, p: setattr(chain, "omega", chain.omega * (1 - p["a"]))),
    its_own_parameter: ("speed", lambda chain, p: (p["a"] * 2, setattr(chain, "kept", chain.kept * (1 - p["a"])))),
}


@pytest.mark.parametrize("in_place", WRITTEN_OUT)
def test_an_operation_in_place_is_the_one_written_out_and_changes_no_input(in_place):
    stage, written_out = WRITTEN_OUT[in_place]
    inputs, a = arrays()
    short, long = Walker((effect(stage, in_place),)), Walker((effect(stage, written_out),))
    found = short.predict(inputs, [{"a": a}]).observables
    np.testing.assert_array_equal(found, long.predict(inputs, [{"a": a}]).observables)
    assert not np.array_equal(found, np.broadcast_to(Walker().predict(inputs).observables, found.shape))
    for now, before in zip((*vars(inputs).values(), a), (*vars(arrays()[0]).values(), arrays()[1]), strict=True):
        np.testing.assert_array_equal(now, before)
    tapes = record(short), record(long)
    assert [tape.code for tape in tapes] == [tapes[0].code] * 2


def test_a_number_stands_for_all_depths_and_conditions():
    found = Walker((effect("step", lambda chain, _: setattr(chain, "step", 0.05)),)).predict(arrays()[0], [{"a": 0.1}])
    np.testing.assert_allclose(found.step_m[found.walking], 0.05)


@pytest.mark.parametrize("name", ["omega", "k", "step", "depth"])
def test_writing_into_an_array_is_refused(name):
    def write(chain, _):
        getattr(chain, name)[...] = 1.0

    def write_into_the_curve(chain, _):
        here = chain.k_of_phi(chain.phi)
        here *= 0.9

    for writes in (write, write_into_the_curve):
        with pytest.raises(ValueError, match="read-only"):
            Walker((effect("speed", writes),)).predict(arrays()[0], [{"a": 0.1}])


def test_what_is_written_into_a_copy_is_not():
    def write(chain, _):
        copy = np.array(chain.kept)
        copy[...] = 0.9
        chain.kept = copy

    assert (Walker((effect("speed", write),)).predict(arrays()[0], [{"a": 0.1}]).speed_m_s > 0).all()
