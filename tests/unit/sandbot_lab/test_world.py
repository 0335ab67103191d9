"""World files: what is written is read back; what does not fit is refused with one line."""

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rig import SGCS

from sandbot_common.errors import InputError
from sandbot_lab.effects import DRAWN, EFFECTS
from sandbot_lab.world import (
    World,
    draw_additional,
    draw_world,
    null_world,
    read_world,
    world_from_mapping,
    write_world,
)
from sandbot_model.physics.effects import CATALOGUE


@pytest.mark.parametrize("world", [null_world(), SGCS, draw_world(3), World(effects={name: {} for name in EFFECTS})])
def test_round_trip(tmp_path, world):
    write_world(world, tmp_path / "world.yaml")
    assert read_world(tmp_path / "world.yaml") == world


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"efects": {}}, "unknown key 'efects', did you mean 'effects'"),
        ({"schema": "sandbot.world/9"}, "schema"),
        ({"effects": {"magic": {}}}, "unknown effect 'magic'; known: disturbed_ground, "),
        ({"effects": {"leg_slipp": {}}}, "unknown effect 'leg_slipp', did you mean 'leg_slip'?"),
        ({"effects": {"crater_refill": {"z0": 0.01}}}, "unknown parameter 'z0', did you mean 'z0_m'?"),
        ({"effects": {"exact_vertical_acceleration": {"a": 1}}}, "unknown parameter 'a'; known: none"),
        ({"effects": ["leg_slip"]}, "expected a mapping of effects"),
        ({"effects": {"leg_slip": {"sigma": 7.0}}}, "leg_slip: sigma: 7.0 is outside [0, 0.4] (slip"),
        ({"effects": {"leg_slip": {"sigma": float("nan")}}}, "sigma: nan is not a finite number"),
        ({"effects": {"bed_slope": {"chi_rad": 0.1}}}, "chi_deg: 5.7"),
        ({"effects": {"inertial_drag": {"lambda_1": 1, "lambda_": 1}}}, "lambda_1 and lambda_ are the same; give one"),
        ({"effects": {"leg_slip": {"sigma": "much"}}}, "'much' is not a number"),
        ({"effects": {"leg_slip": {"slip": 0.1}}}, "unknown parameter 'slip'; known: sigma"),
        ({"effects": {"leg_slip": 0.1}}, "expected a mapping of parameters"),
        ({"noise": {"scale": -1.0}}, "noise: scale: -1.0 is outside"),
        ({"robot": {"wheels": 4}}, "robot: unknown key 'wheels'"),
        ({"delta_t_s": 0.0}, "delta_t_s: 0.0 is outside"),
        ({"phi_knots": [0.6, 0.58], "k_knots_n_per_m": [1.0, 2.0]}, "phi rising"),
        ({"phi_knots": [0.58, 0.6], "k_knots_n_per_m": [170.0]}, "at least two knots each"),
    ],
)
def test_refusals_name_file_and_value(content, words):
    with pytest.raises(InputError) as refusal:
        world_from_mapping(content, "sealed.yaml")
    text = str(refusal.value)
    assert words in text
    assert text.startswith("sealed.yaml")
    assert "\n" not in text


@pytest.mark.parametrize("effect", [one for one in CATALOGUE if one.identifier in EFFECTS], ids=lambda e: e.identifier)
def test_a_world_takes_every_parameter_by_the_name_it_has_in_the_catalogue(effect):
    given = {one.name: one.start for one in effect.parameters}
    own = world_from_mapping({"effects": {effect.identifier: given}}, "world").effects[effect.identifier]
    assert set(own) == set(EFFECTS[effect.identifier].defaults())
    for one in effect.parameters:
        if one.unit != "rad":
            assert one.start in own.values()


def test_an_angle_of_the_catalogue_is_in_rad_and_one_of_the_lab_in_degrees():
    for said, degrees in (({"chi_rad": 0.02}, 1.1459), ({"chi_deg": 0.5}, 0.5)):
        own = world_from_mapping({"effects": {"bed_slope": said}}, "world").effects["bed_slope"]
        assert own == {"chi_deg": pytest.approx(degrees, abs=1e-4)}


def test_stiffness_goes_through_its_knots_and_bends_at_the_knee():
    world = null_world()
    assert [world.stiffness_n_per_m(phi) for phi in world.phi_knots] == pytest.approx([170.0, 205.0, 220.0])
    assert world.stiffness_n_per_m(0.59) == pytest.approx(187.5)
    assert world.stiffness_n_per_m(0.57) < 170.0
    assert world.stiffness_n_per_m(0.64) > 220.0


@given(seed=st.integers(0, 2**31))
def test_a_drawn_world_holds_one_effect_within_bounds_and_is_the_same_again(seed):
    world = draw_world(seed)
    (name,) = world.effects
    assert name in DRAWN
    assert draw_world(seed) == world


def test_draws_reach_every_effect():
    assert {next(iter(draw_world(seed).effects)) for seed in range(60)} == set(DRAWN)


@given(seed=st.integers(0, 2**31))
def test_an_effect_drawn_beside_others_leaves_them_as_they_are(seed):
    before = World(delta_t_s=0.18, effects={"belly_coast": {"mu_b": 0.35}})
    world = draw_additional(before, seed)
    (name,) = world.effects.keys() - before.effects.keys()
    assert name != "belly_coast"
    kept = {key: values for key, values in world.effects.items() if key != name}
    assert dataclasses.replace(world, effects=kept) == before
    assert draw_additional(before, seed) == world
    # What was drawn is left as it is, too, by the next seed; and then none is left.
    full = draw_additional(world, seed)
    assert len(full.effects) == 3
    assert full.effects[name] == world.effects[name]
    with pytest.raises(InputError, match="swimming_thrust and crater_refill are present already"):
        draw_additional(full, seed)


def test_keys_of_earlier_versions_are_read_and_their_new_names_said(capsys):
    old = {
        "k_knots_n_m": [100.0, 110.0, 120.0],
        "effects": {"disturbed_ground": {"k_l_n_m": 171.0}},
        "robot": {"radius_m": 0.04, "mass_kg": 0.8, "swim_m_s": 0.03},
    }
    world = world_from_mapping(old, "w.yaml")
    assert world.k_knots_n_per_m == (100.0, 110.0, 120.0)
    assert world.effects["disturbed_ground"]["k_l_n_per_m"] == 171.0
    assert (world.body.leg_radius_m, world.body.mass_per_leg_kg, world.swim_m_s) == (0.04, 0.8, 0.03)
    assert capsys.readouterr().err.splitlines() == [
        "w.yaml: k_knots_n_m is now called k_knots_n_per_m",
        "w.yaml: k_l_n_m is now called k_l_n_per_m",
        "w.yaml: radius_m is now called leg_radius_m",
        "w.yaml: mass_kg is now called mass_per_leg_kg",
        "w.yaml: robot: swim_m_s is now a key of the world itself, next to robot:",
    ]


def test_keys_of_this_version_say_nothing(capsys):
    """Control."""
    world_from_mapping({"k_knots_n_per_m": [100.0, 110.0, 120.0], "robot": {"leg_radius_m": 0.04}}, "w.yaml")
    assert capsys.readouterr().err == ""
