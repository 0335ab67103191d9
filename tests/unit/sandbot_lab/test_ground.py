"""The ground: force laws against certified numbers, and its memory."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rig import QUIET, H, R, with_effect

from sandbot_lab.ground import disturb, force, resistive_stress, strength, surface
from sandbot_lab.physics import fresh_state, physics_record
from sandbot_lab.world import World


class Ground:
    """The ground of one trial, from outside the kernel."""

    def __init__(self, world=QUIET, phi=0.62):
        self.p, self.s = physics_record(world, phi, 0)[0], fresh_state(world, 0.0)[0]

    def strength(self, x):
        return strength(self.p, self.s, x, self.p["k"])

    def surface(self, x, t):
        return surface(self.p, self.s, x, t)

    def force(self, theta, rate, x, z, t):
        return force(self.p, self.s, theta, rate, x, z, t, self.p["k"])

    def disturb(self, x, t):
        disturb(self.s, x, t)


def force_at(world, depth, phi=0.62, rate=0.0):
    return Ground(world, phi).force(-np.arccos(min((depth + H - R) / R, 1.0)), rate, 0.0, H, 0.0)


def test_linear_ground_pushes_back_k_times_depth():
    k = QUIET.stiffness_n_per_m(0.62)
    assert force_at(QUIET, 0.03) == pytest.approx(k * 0.03, rel=1e-9)
    assert Ground().force(np.pi, 0.0, 0.0, H, 0.0) == 0.0


@pytest.mark.parametrize(
    ("depth", "ratio"), [(0.02, 1.289), (0.03, 1.494), (0.0355, 1.571), (0.04, 1.614), (0.046, 1.488)]
)
def test_leg_arc_has_the_certified_forces(depth, ratio):
    """physics.md section 5: F_z/(alpha w R d) of a 225 degree arc."""
    k = QUIET.stiffness_n_per_m(0.62)
    assert force_at(with_effect("exact_leg_arc", tip_deg=45.0), depth) / (k * depth) == pytest.approx(ratio, abs=6e-4)


def test_resistive_stress_is_one_for_a_flat_plate_and_larger_head_on():
    assert resistive_stress(0.0, np.pi / 2) == pytest.approx(1.0)
    assert resistive_stress(np.pi / 4, np.pi / 4) > resistive_stress(-np.pi / 4, np.pi / 4)


@given(distance=st.floats(0.0, 0.06))
def test_overlap_of_footprints_is_linear_between_its_ends(distance):
    s_c, k_l = 0.95, 165.0
    world = with_effect("disturbed_ground", k_l_n_per_m=k_l, s_c=s_c)
    k, track = world.stiffness_n_per_m(0.62), Ground(world)
    track.disturb(0.3, 0.0)
    part = np.clip((s_c * R - distance) / (0.1 * R), 0.0, 1.0)
    assert track.strength(0.3 + distance) == pytest.approx(k - (k - k_l) * part, rel=1e-9)
    assert track.strength(0.3 - distance) == pytest.approx(k - (k - k_l) * part, rel=1e-9)


def test_disturbed_ground_is_never_stronger_than_before():
    world = with_effect("disturbed_ground", k_l_n_per_m=195.0)
    track = Ground(world, phi=0.585)
    track.disturb(0.3, 0.0)
    assert track.strength(0.3) == world.stiffness_n_per_m(0.585) < 195.0


def test_virgin_ground_forgets_nothing_it_was_not_told():
    track = Ground(with_effect("disturbed_ground"))
    assert track.strength(0.3) == pytest.approx(QUIET.stiffness_n_per_m(0.62))
    quiet = Ground()
    quiet.disturb(0.3, 0.0)
    assert quiet.strength(0.3) == pytest.approx(QUIET.stiffness_n_per_m(0.62))


def test_craters_refill():
    track = Ground(with_effect("crater_refill", z0_m=0.01, tau_s=0.2))
    track.disturb(0.3, 1.0)
    assert track.surface(0.3, 1.0) == pytest.approx(-0.01)
    assert track.surface(0.3, 1.2) == pytest.approx(-0.01 / np.e)
    assert track.surface(0.3 + 1.3 * R, 1.0) == 0.0


def test_dilation_changes_sign_at_the_critical_volume_fraction():
    world = with_effect("dilation", phi_c=0.6)
    for phi, sign in ((0.585, 1.0), (0.625, -1.0)):
        track = Ground(world, phi)
        track.disturb(0.3, 0.0)
        assert np.sign(track.strength(0.3) - world.stiffness_n_per_m(phi)) == sign


@pytest.mark.parametrize(
    ("name", "parameters", "extra"),
    [
        ("cohesion", {"c_pa": 200.0}, 2 * 200.0 * 0.012 * R),
        ("inertial_drag", {"lambda_": 1.0}, 600.0 * 0.012 * R * (R * 20.0) ** 2),
    ],
)
def test_added_forces(name, parameters, extra):
    assert force_at(with_effect(name, **parameters), 0.03, rate=20.0) - force_at(QUIET, 0.03) == pytest.approx(extra)


def test_depth_law_meets_the_linear_one_at_the_reference_depth():
    world = with_effect("depth_nonlinearity", n=1.4)
    assert force_at(world, 0.039) == pytest.approx(force_at(QUIET, 0.039))
    assert force_at(world, 0.030) < force_at(QUIET, 0.030)


def test_local_strength_varies_from_sweep_to_sweep_only_where_switched_on():
    assert np.ptp(physics_record(QUIET, 0.62, 0)["k_sweep"]) == 0.0
    varied = physics_record(World(effects={"phi_nonuniformity": {"sigma_phi": 0.003}}), 0.62, 0)["k_sweep"]
    slope = (220.0 - 205.0) / 0.033
    assert varied.std() == pytest.approx(0.003 * slope, rel=0.15)
