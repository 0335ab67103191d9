import dataclasses
import json

import numpy as np
import pytest

from sandbot_common.errors import InputError
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.variants import with_variants
from sandbot_model.physics.walking import Inputs, Walker
from sandbot_model.predictor_parameters import PredictorParameters, predictor_of

PARAMETERS = PredictorParameters()


def test_mean_speed_is_the_models():
    found = predictor_of(PARAMETERS).mean_speed(0.633, 16.0)
    assert found == pytest.approx(float(Walker().predict(Inputs(220.0, 16.0, 0.4)).speed_m_s))


@pytest.mark.parametrize("effects", ["", "stance_overlap", "slow_phase_speed,disturbed_ground", "phi_nonuniformity"])
def test_a_curve_is_the_mean_speed_at_each_frequency(effects):
    predictor = predictor_of(PredictorParameters(effects=effects))
    omega = np.array([4.0, 12.0, 24.0, 38.5])
    for phi, gait in ((0.59, "UNIFORM"), (0.633, "SGCS")):
        alone = [predictor.mean_speed(phi, one, gait) for one in omega]
        assert predictor.mean_speeds(phi, omega, gait) == pytest.approx(alone, rel=1e-9)


def test_instant_speed_over_half_a_period_makes_the_mean():
    """UNIFORM: v_x(t) of one tripod's stance, averaged over half a period, is ωs/π."""
    predictor = predictor_of(PARAMETERS)
    omega, n = 12.0, 20001
    theta = np.linspace(-np.pi / 2, np.pi / 2, n)
    legs = np.stack([theta] * 3 + [theta + np.pi] * 3, axis=-1)
    rates = np.full(6, omega)
    v_x = [predictor.velocity(0.62, omega, "UNIFORM", angles, rates).v_x for angles in legs[::20]]
    assert np.mean(v_x) == pytest.approx(predictor.mean_speed(0.62, omega, "UNIFORM"), rel=5e-3)
    assert max(v_x) == pytest.approx(0.0355 * omega, rel=1e-6)
    assert min(v_x) == 0.0


def test_ground_that_differs_along_the_track_is_averaged_over():
    """Beside the switch some steps swim; by brute force over k, straight in φ."""
    straight = PredictorParameters(phi=(0.58, 0.62), k_n_per_m=(180.0, 220.0))
    values = "phi_nonuniformity.sigma_phi=0.004"
    varied = predictor_of(dataclasses.replace(straight, effects="phi_nonuniformity", values=values))
    found, even = (one.mean_speed(0.6, 24.0) for one in (varied, predictor_of(straight)))
    local = 200.0 + 4.0 * np.random.default_rng(0).standard_normal(4000)
    assert found == pytest.approx(Walker().predict(Inputs(local, 24.0, 0.4)).speed_m_s.mean(), abs=3e-3)
    assert abs(found - even) > 5e-3


def test_a_swimmer_keeps_its_speed():
    predictor = predictor_of(PARAMETERS)
    assert predictor.velocity(0.58, 24.0, "UNIFORM", np.zeros(6), np.full(6, 24.0)).v_x == 0.02


def test_takes_the_last_step_of_a_result(tmp_path):
    step = {
        "effects": ["stance_overlap"],
        "parameters": {
            "delta_t_s": {"value": 0.4},
            "v_swim_m_s": {"value": 0.02},
            "stance_overlap.eta": {"value": 0.2},
        },
        "k_n_per_m": [{"phi": 0.6, "value": 205.0}, {"phi": 0.633, "value": 220.0}],
    }
    path = tmp_path / "result.json"
    path.write_text(json.dumps({"model": "simple", "steps": [{"effects": []}, step]}))
    found = predictor_of(PredictorParameters(result=str(path)))
    assert found.mean_speed(0.633, 16.0) == pytest.approx(0.8 * predictor_of(PARAMETERS).mean_speed(0.633, 16.0))


@pytest.mark.parametrize("kept", ["step", "file"])
def test_a_result_is_run_under_the_convention_that_was_fitted(tmp_path, kept):
    """Control: without it the catalogue's formula."""
    convention = {"variants": {"cable_drag": "by the ground's stiffness, the peak spared"}}
    step = {
        "effects": ["cable_drag"],
        "parameters": {"delta_t_s": {"value": 0.4}, "cable_drag.f_c_n": {"value": 0.5}},
        "k_n_per_m": [{"phi": 0.6, "value": 205.0}, {"phi": 0.633, "value": 220.0}],
    }
    path = tmp_path / "result.json"

    def speed(in_step, in_file):
        path.write_text(json.dumps({"model": "simple", "steps": [step | in_step]} | in_file))
        return predictor_of(PredictorParameters(result=str(path))).mean_speed(0.6, 16.0)

    found = speed(convention, {}) if kept == "step" else speed({}, convention)
    variant = with_variants(convention["variants"], catalogue())["cable_drag"]
    assert found == Walker((variant,)).predict(Inputs(205.0, 16.0, 0.4), [{"f_c_n": 0.5}]).speed_m_s
    assert abs(found - speed({}, {})) > 0.01


BRAKE = "brake: speed: kept *= 1 - a; a [1] in 0..0.5"
BRAKE_PY = """
from sandbot_model import Chain, Effect, Parameter, Values


class Brake(Effect):
    identifier, stage, formula, source, seen_in = "brake", "speed", "kept *= 1 - a", "-", "v"
    parameters = (Parameter("a", "1", 0.0, 0.5, 0.1, "share lost"),)

    def apply(self, chain: Chain, p: Values) -> None:
        chain.kept = chain.kept * (1 - p["a"])
"""


@pytest.mark.parametrize("given", ["effect", "effects_from"])
def test_effects_of_your_own_are_run_by_name_and_in_a_result(tmp_path, given):
    """Control: without them the effect is named, and the file is not said to be no result."""
    file, result = tmp_path / "brake.py", tmp_path / "result.json"
    file.write_text(BRAKE_PY)
    step = {
        "effects": ["brake"],
        "parameters": {"delta_t_s": {"value": 0.4}, "brake.a": {"value": 0.2}},
        "k_n_per_m": [{"phi": 0.6, "value": 205.0}, {"phi": 0.633, "value": 220.0}],
    }
    result.write_text(json.dumps({"model": "simple", "steps": [step]}))
    own = {given: (BRAKE if given == "effect" else str(file),)}
    braked = 0.8 * predictor_of(PARAMETERS).mean_speed(0.633, 16.0)
    for asked in ({"effects": "brake", "values": "brake.a=0.2"}, {"result": str(result)}):
        assert predictor_of(PredictorParameters(**asked, **own)).mean_speed(0.633, 16.0) == pytest.approx(braked)
    with pytest.raises(InputError, match=r"result\.json: effect 'brake' is not in the catalogue; effect or"):
        predictor_of(PredictorParameters(result=str(result)))


def test_effects_and_values_by_name():
    found = predictor_of(PredictorParameters(effects="stance_overlap", values="stance_overlap.eta=0.2"))
    assert found.mean_speed(0.633, 16.0) == pytest.approx(0.8 * predictor_of(PARAMETERS).mean_speed(0.633, 16.0))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"effects": "overlap"}, "not in the catalogue"),
        ({"values": "stance_overlap.eta=0.2"}, "not a parameter of this model"),
        (
            {"effects": "stance_overlap", "values": "stance_overlap.eta=12"},
            "values: stance_overlap.eta=12: at least 0 and",
        ),
        ({"effects": "disturbed_ground", "values": "disturbed_ground.s_c=-3"}, "s_c=-3: at least"),
        ({"values": "delta_t_s=-1"}, "values: delta_t_s=-1: at least 0.02 is needed"),
        ({"effects": "stance_overlap", "values": "stance_overlap.eta"}, "is not 'effect.parameter=number'"),
        ({"phi": (0.6, 0.58), "k_n_per_m": (200.0, 210.0)}, "phi must rise"),
        ({"phi": (0.58, 0.6)}, "as many values"),
        ({"result": "none.json"}, "no such file"),
        (
            {"result": "res.json", "model": "full"},
            "model: result res.json specifies the whole model; leave one of the two",
        ),
        ({"result": "res.json", "delta_t_s": 0.3}, "delta_t_s: result res.json specifies the whole model"),
    ],
)
def test_refuses_what_does_not_fit(given, message):
    with pytest.raises(InputError, match=message):
        predictor_of(PredictorParameters(**given))


def test_refuses_a_file_that_is_no_result(tmp_path):
    path = tmp_path / "result.json"
    path.write_text("{}")
    with pytest.raises(InputError, match="not a result"):
        predictor_of(PredictorParameters(result=str(path)))
