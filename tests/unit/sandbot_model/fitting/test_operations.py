"""A chain executed as operations says what it says on arrays: every effect, alone and beside others."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting.fit import fit
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.operations import CompiledChains
from sandbot_model.fitting.points import SEEN, ArrayChains, Conditions, Points
from sandbot_model.fitting.switch import share_of_nodes, switches_of
from sandbot_model.physics.averaging import NODES
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.effect import Effect, Parameter
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.gait import clock
from sandbot_model.physics.model import model_of
from sandbot_model.physics.observables import NAMES
from sandbot_model.physics.tape import record
from sandbot_model.physics.variants import variants_of
from sandbot_model.physics.walking import KCurve

CATALOGUE = catalogue()
FORMULAS = (
    "grip: speed: kept, peak_ratio *= 1 - a*d/R; a [1] in 0..1",
    "boost: strength: k*(1 + a*(phi - 0.6)**2)*where(omega > 8, exp(-d/h), 1); a [1] in -5..5",
    "brake: balance: extra_force += c*hypot(omega, 3)*(first - 0.5)**3; c [N s] in 0..0.1",
    "bend: step: clip(minimum(step, chord) + a*sin(d)*arctan2(d, R), 0, 1); a [m] in 0..0.001",
)
EFFECTS = {
    **CATALOGUE,
    **{f"{one.identifier}: {one.variant}": one for effect in CATALOGUE.values() for one in variants_of(effect)},
    **{text.split(":")[0]: formula_effect(text) for text in FORMULAS},
}
PHI = np.array([0.58, 0.6, 0.633])
OMEGA, LEVEL = np.tile([4.0, 12.0, 20.0, 30.0], 3), np.repeat([0, 1, 2], 4)
CLOCK = clock(["SGCS", "UNIFORM", "HGCS", "SGCS"] * 3)


def model(*effects):
    return model_of("simple", [one.identifier for one in effects], {one.identifier: one for one in effects})


def both(some, theta, k):
    """The chain of a model on arrays and as operations, and the points at which it is evaluated."""
    tape = record(some.walker)
    assert tape is not None
    nodes = k[:, LEVEL, None] * np.array([0.98, 1.0, 1.02])
    at = Conditions.of(some.walker, OMEGA, PHI[LEVEL], CLOCK)
    return ArrayChains(some), CompiledChains(some, tape), Points(theta, at, nodes, KCurve(PHI, k, inner=3))


def agree(some, theta, k):
    arrays, operations, points = both(some, theta, k)
    expected, found = arrays.footing(points), operations.footing(points)
    for name, value in vars(expected).items():
        np.testing.assert_allclose(getattr(found, name), value, rtol=1e-9, err_msg=name)
    feet = list(vars(expected).values())
    outputs = operations.values(SEEN, points, feet)
    np.testing.assert_allclose(outputs, arrays.values(SEEN, points, feet), rtol=1e-9, atol=1e-9)
    track = operations.values(("sigma_phi",), points, feet)
    np.testing.assert_allclose(track, arrays.values(("sigma_phi",), points, feet), rtol=1e-12)


def theta_of(some, share):
    """Parameters at a share of their plausible ranges ``(rows,)``."""
    low, high = np.array([(one.low, one.high) for one in some.parameters]).T
    return low + np.asarray(share)[:, None] * (high - low)


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_alone(name):
    some = model(EFFECTS[name])
    agree(some, theta_of(some, [0.1, 0.4, 0.8]), np.array([[168.0, 190.0, 225.0], [175, 205, 240], [300, 400, 150]]))


@settings(max_examples=30)
@example(["disturbed_ground", "exact_vertical_acceleration"], [0.75], [120.0, 120.0, 181.0])
@given(
    st.lists(st.sampled_from(list(EFFECTS)), min_size=2, max_size=4, unique_by=lambda name: EFFECTS[name].identifier),
    st.lists(st.floats(0, 1), min_size=1, max_size=3),
    st.lists(st.floats(120, 400), min_size=3, max_size=3),
)
def test_any_of_them_together(names, share, k):
    some = model(*(EFFECTS[name] for name in names))
    agree(some, theta_of(some, share), np.tile(k, (len(share), 1)))


@pytest.mark.parametrize("name", EFFECTS)
def test_with_inputs_moved_it_says_what_it_says_where_all_is_done_again(name):
    some = model(EFFECTS[name])
    rows, blocks = 2, len(some.names) + 3
    theta = np.tile(theta_of(some, [0.3, 0.6]), (blocks, 1, 1))
    k = np.tile([[168.0, 190.0, 225.0], [175.0, 205.0, 240.0]], (blocks, 1, 1))
    theta[np.arange(blocks - 3), :, np.arange(blocks - 3)] *= 1.01
    k[blocks - 3] *= 1.01
    if EFFECTS[name].along_the_track:
        k[: blocks - 3] *= 1.005
    arrays, operations, points = both(some, theta.reshape(blocks * rows, -1), k.reshape(blocks * rows, -1))
    feet = [part.reshape(blocks, rows, *points.shape[1:]) for part in vars(arrays.footing(points)).values()]
    feet = [np.tile(part[-1], (blocks, 1, 1, 1)) for part in feet]
    for depth in feet[::2]:
        depth[blocks - 2] += 1e-4
    feet = [part.reshape(points.shape) for part in feet]
    found, expected = operations.seen_moved(points, feet, rows), operations.values(SEEN, points, feet)
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_allclose(found, arrays.seen_moved(points, feet, rows), rtol=1e-9, atol=1e-9)
    # k and the depth do matter.
    of_k, of_depth, unmoved = found.reshape(len(SEEN), blocks, -1)[:, -3:].transpose(1, 0, 2)
    assert (of_k != unmoved).any()
    assert (of_depth != unmoved).any()


@pytest.mark.parametrize("name", ["disturbed_ground", "stance_overlap", "swimming_thrust", "phi_nonuniformity"])
def test_at_once_it_stands_where_it_stands_step_by_step(name):
    some = model(EFFECTS[name])
    _, operations, points = both(some, theta_of(some, [0.1, 0.4, 0.8]), np.tile([168.0, 180.0, 195.0], (3, 1)))
    points = replace(points, k=points.k[..., 1:2] * (1 + 0.01 * NODES))
    independent = np.ones((1, len(OMEGA)), dtype=bool)
    independent[0, 1] = False
    footing, values, share = operations.footing_and_values(points, independent)
    expected = operations.footing(points)
    for part, value in vars(expected).items():
        np.testing.assert_array_equal(getattr(footing, part), value)
    np.testing.assert_array_equal(values, operations.values(NAMES, points, vars(expected).values()))
    found = switches_of(operations, points, expected, independent, remembers=some.walker.remembers)
    assert sum(len(switches.row) for _, switches in found)
    np.testing.assert_array_equal(share, share_of_nodes(found, points.shape))


class Deciding(Effect):
    """A user's effect that can't be recorded: it looks at shapes."""

    identifier, stage, formula, source, seen_in = "deciding", "speed", "-", "-", "-"
    parameters = (Parameter("eta", "1", 0.0, 0.25, 0.1, "share lost", neutral=0.0, hard_low=0.0, hard_high=0.9),)

    def apply(self, chain, p):
        chain.kept = chain.kept * (1 - p["eta"]) if chain.depth.shape else chain.kept


@pytest.mark.slow
def test_an_effect_that_can_not_be_recorded_is_fitted_all_the_same(drawn):
    """On arrays, to the same minimum as its recorded twin."""
    cells = cells_of(drawn(levels=3))
    slow, fast = model(Deciding()), model(CATALOGUE["stance_overlap"])
    assert isinstance(Problem(slow, cells).cell_means.chains, ArrayChains)
    assert isinstance(Problem(fast, cells).cell_means.chains, CompiledChains)
    found = [fit(some, cells) for some in (slow, fast)]
    assert found[0].deviance == pytest.approx(found[1].deviance, rel=1e-6)
    np.testing.assert_allclose(found[0].point.theta, found[1].point.theta, rtol=1e-4, atol=1e-6)


def test_whether_anything_depends_on_phi_is_seen_on_both_ways():
    for name, uses in (("stance_overlap", False), ("phi_dependent_response", True), ("dilation", True)):
        some = model(CATALOGUE[name])
        chains = both(some, theta_of(some, [0.5]), np.full((1, 3), 200.0))[:2]
        assert [one.uses_phi for one in chains] == [uses, uses]
