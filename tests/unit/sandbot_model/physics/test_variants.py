"""Variants of an effect: another formula, the same family."""

import pickle

import numpy as np
import pytest

from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.gait import clock
from sandbot_model.physics.variants import NEW, VARIANTS, variants_of, with_variants
from sandbot_model.physics.walking import Inputs, KCurve, Walker
from sandbot_model.report.effect_facts import words

PAIRS = [(effect, variant) for effect in CATALOGUE for variant in variants_of(effect)]
OMEGA, K = (axis.ravel() for axis in np.meshgrid([4.0, 10.0, 16.0, 24.0], np.linspace(120.0, 220.0, 80)))

GROUND = KCurve(np.array([0.58, 0.633]), np.array([172.0, 220.0]))


NUMBERS = {"power", "log_width", "part", "reach", "reach_m", "d_0_m", "tau_m_s", "bed_m", "share"}
"""Conventions that are numbers."""


def predicted(effect, gait="UNIFORM"):
    """At its start; a ramp as wide as R, so that its width shows."""
    start = {one.name: 0.0 if one.name == "log_width" else one.start for one in effect.parameters}
    turning = clock([gait] * len(K))
    return Walker((effect,)).predict(Inputs(K, OMEGA, 0.4, 0.615, clock=turning, k_of_phi=GROUND), [start]).observables


@pytest.mark.parametrize(("family", "variant"), PAIRS, ids=lambda one: f"{one.identifier} {one.variant}")
def test_a_variant_can_be_typed_as_an_effect_beside_its_family(family, variant):
    typed = catalogue(formulas=[variant.as_formula])[f"{family.identifier}_variant"]
    ranges = [{(one.name, one.unit, one.low, one.high) for one in each.parameters} for each in (typed, variant)]
    assert ranges[0] == ranges[1]
    values = {one.name: one.start for one in variant.parameters}
    here = Inputs(K, OMEGA, 0.4, 0.615, k_of_phi=GROUND)
    one, other = (Walker((effect,)).predict(here, [values]).observables for effect in (typed, variant))
    np.testing.assert_array_equal(one, other)


def test_a_catalogue_under_other_conventions_is_the_same_but_for_these():
    usual = catalogue()
    found = with_variants({"leg_slip": "the first step spared"}, usual)
    assert list(found) == list(usual)
    assert [name for name in usual if found[name] is not usual[name]] == ["leg_slip"]
    assert found["leg_slip"].variant == "the first step spared"
    with pytest.raises(KeyError):
        with_variants({"leg_slip": "none"}, usual)


def test_every_family_with_variants_is_in_the_catalogue():
    assert set(VARIANTS) == {family.identifier for family, _ in PAIRS}


@pytest.mark.parametrize(("family", "variant"), PAIRS, ids=lambda one: f"{one.identifier} {one.variant}")
def test_a_variant_is_of_its_family_but_says_something_else(family, variant):
    assert (variant.identifier, variant.stage) == (family.identifier, family.stage)
    own = len(family.parameters)
    assert variant.parameters[:own] == family.parameters
    assert {one.name for one in variant.parameters[own:]} <= NUMBERS
    assert variant.variant
    assert not family.variant
    assert not np.allclose(predicted(variant, "SGCS"), predicted(family, "SGCS"), rtol=1e-4)
    # In a gait of one rate those that overlook its phases overlook nothing.
    assert np.allclose(predicted(variant), predicted(family), rtol=1e-4) is variant.of_phases
    np.testing.assert_array_equal(predicted(pickle.loads(pickle.dumps(variant))), predicted(variant))


@pytest.mark.parametrize(
    ("family", "variant"),
    [pair for pair in PAIRS if any(one.neutral is not None for one in pair[0].parameters)],
    ids=lambda one: f"{one.identifier} {one.variant}",
)
def test_where_a_family_vanishes_its_variant_does(family, variant):
    neutral = {one.name: one.start if one.neutral is None else one.neutral for one in variant.parameters}
    inputs = Inputs(K, OMEGA, 0.4, 0.6)
    np.testing.assert_allclose(
        Walker((variant,)).predict(inputs, [neutral]).observables, Walker(()).predict(inputs).observables
    )


USUAL = {
    ("stance_overlap", "by a power of ω"): 0,
    ("stance_overlap", "by a power of depth"): 0,
    ("stance_overlap", "the first step spared, by a power of ω"): None,
    ("carried_momentum", "by a power of ω"): 0,
    ("swimming_thrust", "by a power of ω"): 1,
    ("exact_vertical_acceleration", "a power of the sine"): 1,
    ("inertial_drag", "by another power of speed"): 2,
    ("inertial_drag", "by a power of depth"): 0,
    ("inertial_drag", "by a power of how steeply a leg comes down"): 0,
    ("cable_drag", "by another power of depth"): 2,
    ("cable_drag", "by a power of ω"): 0,
    ("leg_slip", "by another power of depth"): 2,
    ("leg_slip", "by a power of ω"): 0,
    ("leg_slip", "the peak spared"): None,
    ("leg_slip", "the peak spared, by a power of ω"): None,
    ("belly_coast", "not cut short by the next step, over a power of speed"): None,
    ("motor_saturation", "another bend"): None,
}
"""The exponent of the catalogue's own formula, where it is of the kind."""
POWERS = [pair for pair in PAIRS if any(one.name == "power" for one in pair[1].parameters)]


@pytest.mark.parametrize(("family", "variant"), POWERS, ids=lambda one: f"{one.identifier} {one.variant}")
def test_at_the_usual_power_a_variant_is_its_family(family, variant):
    start = {one.name: one.start for one in variant.parameters}
    power = USUAL[family.identifier, variant.variant]
    seen = Walker((variant,)).predict(Inputs(K, OMEGA, 0.4, 0.615), [start | {"power": power or 0.0}]).observables
    same = np.allclose(seen, predicted(family), rtol=1e-6)
    assert same is (power is not None)


def test_a_time_or_a_length_is_never_searched_below_zero_and_an_exponent_may_be():
    own = [one for family in CATALOGUE for variant in variants_of(family) for one in variant.parameters]
    new = [one for one in own if one.doc == NEW]
    assert {one.name for one in new if one.unit != "1"} >= {"tau_m_s", "reach_m", "d_0_m"}
    assert all(one.search[0] > 0 for one in new if one.unit != "1")
    assert any(one.search[0] < -2 for one in new if one.name == "power")


def test_a_variant_is_told_in_its_familys_words():
    [family] = [one for one in CATALOGUE if one.identifier == "stance_overlap"]
    assert {words(variant) for variant in variants_of(family)} == {words(family)}


def test_what_a_user_defines_has_no_variants():
    mine = formula_effect("stance_overlap: speed: kept*(1 - a); a [1] in 0..1")
    assert variants_of(mine) == ()
    assert all(variants_of(variant) == () for _, variant in PAIRS)
