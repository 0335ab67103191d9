"""A model's shared parameters: named, held, and turned into what the walker predicts from."""

import numpy as np
import pytest

from sandbot_common.errors import InputError
from sandbot_common.robot import SANDBOT, Robot
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.gait import clock
from sandbot_model.physics.model import model_of
from sandbot_model.physics.walking import Inputs, KCurve

EFFECTS = catalogue()
SGCS = clock(["SGCS"])[0]


def test_parameters_and_names_go_together():
    model = model_of("simple", ("stance_overlap", "swimming_thrust"), EFFECTS)
    assert model.names == ("delta_t_s", "stance_overlap.eta", "swimming_thrust.thrust_m_s2")
    assert [one.name for one in model.parameters] == ["delta_t_s", "eta", "thrust_m_s2"]


def test_a_held_parameter_has_no_range_and_others_keep_theirs():
    free = model_of("simple", ("disturbed_ground",), EFFECTS)
    held = model_of("simple", ("disturbed_ground",), EFFECTS, held={"disturbed_ground.s_c": 1.0})
    by_name = dict(zip(held.names, held.parameters, strict=True))
    assert by_name["disturbed_ground.s_c"].search == (1.0, 1.0)
    assert held.parameters[:-1] == free.parameters[:-1]
    assert free.parameters[-1].search != (1.0, 1.0)
    assert EFFECTS["disturbed_ground"].parameters[-1] == free.parameters[-1]


def test_ranges_are_those_of_the_robot():
    """k_L is near what just carries a leg's load, a crater as deep as legs are large, swimming by Froude's law."""
    names = ("disturbed_ground", "crater_refill", "cable_drag")
    sandbot = model_of("simple", names, EFFECTS)
    assert all(effect is EFFECTS[effect.identifier] for effect in sandbot.effects)
    big = Robot(leg_radius_m=0.071, axle_height_m=0.05, mass_per_leg_kg=4 * SANDBOT.mass_per_leg_kg)
    model = model_of("simple", names, EFFECTS, big)
    k_l, crater = (model.parameter(name) for name in ("disturbed_ground.k_l_n_per_m", "crater_refill.z_0_m"))
    assert (k_l.low, k_l.high, k_l.start) == pytest.approx((2 * 165.0, 2 * 185.0, 2 * 175.0))
    assert (crater.low, crater.high, crater.neutral) == pytest.approx((2 * 0.003, 2 * 0.015, 0.0))
    assert model.parameter("v_swim_m_s").high == pytest.approx(0.05 * np.sqrt(2))
    # Controls: what does not depend on the robot's size, and a catalogue that has its ranges already.
    assert model.parameter("cable_drag.f_c_n") == EFFECTS["cable_drag"].parameters[0]
    assert model_of("simple", names, model.catalogue, big).parameters == model.parameters


def test_a_name_that_is_none_cannot_be_held():
    with pytest.raises(InputError, match=r"leg_slip\.sigma"):
        model_of("simple", ("disturbed_ground",), EFFECTS, held={"leg_slip.sigma": 0.1})


def test_inputs_are_the_parameters_at_conditions():
    model = model_of("simple", ("stance_overlap",), EFFECTS)
    curve = KCurve(np.array([0.58, 0.63]), np.array([170.0, 220.0]))
    theta = np.array([[0.4, 0.02, 0.1], [0.5, 0.03, 0.2]])
    omega = np.array([4.0, 8.0, 12.0])
    inputs, params = model.inputs(theta[:, None, :], 200.0, omega, 0.61, SGCS, curve)
    found = model.walker.predict(inputs, params).observables
    assert found.shape == (2, 3, 4)
    one = Inputs(200.0, omega, 0.5, 0.61, 0.03, SGCS, curve)
    np.testing.assert_array_equal(found[1], model.walker.predict(one, [{"eta": 0.2}]).observables)
