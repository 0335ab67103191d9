"""The mechanism, against physics.md section 2 where every effect is off, and against each effect's own signature."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rig import QUIET, SGCS, R, expected, read, setpoints, trial, with_effect, with_noise

from sandbot_clock.gait import PRESETS, leg_angles
from sandbot_common.errors import InputError
from sandbot_common.robot import Robot
from sandbot_lab.effects import EFFECTS
from sandbot_lab.robot import LabRobot, simulate
from sandbot_lab.world import World, null_world

CELLS = [(phi, omega) for phi in (0.58, 0.595, 0.61, 0.633) for omega in (4.0, 10.0, 16.0, 22.0, 28.0)]


@pytest.mark.parametrize(("phi", "omega"), CELLS)
def test_null_world_is_the_simple_model(phi, omega):
    seen, model = read(QUIET, phi, omega), expected(QUIET.stiffness_n_per_m(phi), omega)
    if model is None:
        assert seen.speed_m_s == pytest.approx(0.02, rel=1e-6)
        assert seen.peak_speed_m_s == pytest.approx(0.02, rel=1e-6)
        assert seen.lift_m == 0.0
        # Thrust begins half way through the first step.
        assert seen.first_step_m == pytest.approx(0.02 * np.pi / (2 * omega), rel=1e-3)
    else:
        speed, lift, peak, step = model
        assert seen.speed_m_s == pytest.approx(speed, rel=0.005)
        assert seen.lift_m == pytest.approx(lift, rel=0.02, abs=2e-5)
        assert seen.peak_speed_m_s == pytest.approx(peak, rel=0.005)
        assert seen.first_step_m == pytest.approx(step, rel=0.005)


def test_the_rate_of_set_points_does_not_matter():
    coarse, fine = (read(QUIET, 0.62, 16.0, rate_hz=rate) for rate in (200.0, 1000.0))
    assert coarse.speed_m_s == pytest.approx(fine.speed_m_s, rel=1e-4)
    assert coarse.lift_m == pytest.approx(fine.lift_m, rel=0.01)


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_changes_some_observable(name):
    with_it = with_noise(World(effects={name: {"a_m_s2": 0.45} if name == "swimming_thrust" else {}}), 0.0)
    cells = ((0.62, 18.0), (0.59, 20.0), (0.633, 26.0))
    changed = [
        np.abs(np.subtract(list(vars(read(with_it, *cell)).values()), list(vars(read(QUIET, *cell)).values())))
        for cell in cells
    ]
    assert np.max(changed) > 3e-4


def test_disturbed_ground_collapses_after_a_normal_first_step():
    world = with_effect("disturbed_ground", k_l_n_per_m=170.0, s_c=0.95)
    seen, virgin = read(world, 0.61, 22.0), read(QUIET, 0.61, 22.0)
    assert seen.first_step_m == pytest.approx(virgin.first_step_m, rel=1e-6)
    assert seen.speed_m_s == pytest.approx(0.02, rel=0.01)
    # Footholds far enough apart never meet: control.
    assert read(world, 0.633, 10.0) == read(QUIET, 0.633, 10.0)


def test_exact_vertical_acceleration_needs_less_and_never_swims_above_the_weight():
    world = with_effect("exact_vertical_acceleration")
    assert read(QUIET, 0.60, 30.0).lift_m == 0.0
    seen = read(world, 0.60, 30.0)
    assert seen.lift_m > 0.0005
    # On the geometry lock: speed and lift belong to the same step.
    step = 2 * np.sqrt(seen.lift_m * (2 * R - seen.lift_m))
    assert seen.speed_m_s == pytest.approx(30.0 * step / np.pi, rel=0.01)


def test_stance_overlap_shortens_the_step_only():
    seen, null = read(with_effect("stance_overlap", eta=0.2), 0.62, 16.0), read(QUIET, 0.62, 16.0)
    assert seen.speed_m_s == pytest.approx(0.8 * null.speed_m_s, rel=0.002)
    assert seen.lift_m == pytest.approx(null.lift_m, rel=1e-9)
    assert seen.peak_speed_m_s == pytest.approx(null.peak_speed_m_s, rel=1e-9)


def test_leg_slip_takes_from_speed_and_peak_alike_but_not_from_lift():
    seen, null = read(with_effect("leg_slip", sigma=0.15), 0.62, 16.0), read(QUIET, 0.62, 16.0)
    kept = 1 - 0.15 * (0.039 / (2 * R - 0.025 - null.lift_m)) ** 2
    assert seen.speed_m_s == pytest.approx(kept * null.speed_m_s, rel=0.002)
    assert seen.peak_speed_m_s == pytest.approx(kept * null.peak_speed_m_s, rel=0.002)
    assert seen.lift_m == pytest.approx(null.lift_m, rel=1e-9)


@pytest.mark.parametrize("omega", [12.0, 20.0, 28.0])
def test_swimming_thrust_acts_on_swimmers_only(omega):
    world = with_effect("swimming_thrust", a_m_s2=0.45)
    assert read(world, 0.58, omega).speed_m_s == pytest.approx(min(0.45 / omega, R * omega / np.pi), rel=1e-3)
    assert read(world, 0.633, 8.0) == read(QUIET, 0.633, 8.0)


def test_belly_coast_slides_as_far_as_friction_lets_it():
    mu, omega = 1.5, 6.0
    seen, null = read(with_effect("belly_coast", mu_b=mu), 0.62, omega), read(QUIET, 0.62, omega)
    touchdown = R * omega * (1 - null.lift_m / R)
    extra = touchdown**2 / (2 * mu * 9.81)
    assert seen.speed_m_s - null.speed_m_s == pytest.approx(omega * extra / np.pi, rel=0.01)


def test_motor_saturation_is_seen_at_the_legs():
    trace = trial(with_effect("motor_saturation", omega_s_rad_s=30.0), 0.62, 20.0)
    turned = trace.leg_angle_rad[-1, 0] - trace.leg_angle_rad[0, 0]
    assert turned / trace.t_s[-1] == pytest.approx(20.0 / np.hypot(1.0, 20.0 / 30.0), rel=1e-6)
    assert trace.leg_rate_rad_s[10, 0] == pytest.approx(20.0 / np.hypot(1.0, 20.0 / 30.0), rel=1e-6)


def test_motors_that_fall_behind_are_slow_and_fast_at_the_same_angles():
    """Turns behind its set-points, a leg has their clock all the same: two rates only, each in its own phase."""
    gait, omega, give_out = PRESETS["SGCS"], 20.0, 30.0
    trace = trial(with_effect("motor_saturation", omega_s_rad_s=give_out), 0.62, omega, gait="SGCS")
    slow = omega * gait.theta_s_rad / (2 * np.pi * gait.duty)
    fast = omega * (2 * np.pi - gait.theta_s_rad) / (2 * np.pi * (1 - gait.duty))
    angle, rate = trace.leg_angle_rad[:, 0], trace.leg_rate_rad_s[:, 0]
    beyond = np.abs((angle - gait.theta_0_rad + np.pi) % (2 * np.pi) - np.pi) - gait.theta_s_rad / 2
    sure = np.abs(beyond) > 1e-6
    expected_rate = np.where(beyond < 0, slow / np.hypot(1, slow / give_out), fast / np.hypot(1, fast / give_out))
    assert rate[sure] == pytest.approx(expected_rate[sure], rel=1e-9)
    lasts_s = gait.theta_s_rad / expected_rate[beyond < 0][0] + (2 * np.pi - gait.theta_s_rad) / expected_rate.max()
    assert np.interp(angle[0] + 6 * np.pi, angle, trace.t_s) == pytest.approx(3 * lasts_s, rel=1e-3)


def test_sgcs_walks_at_the_slow_phase_rate():
    beta, world = 1.1 / (2 * np.pi * 0.45), with_noise(SGCS, 0.0)
    for phi in np.linspace(0.593, 0.633, 3):
        for omega in (4.0, 8.0, 12.0):
            speed, lift, peak, _ = expected(world.stiffness_n_per_m(phi), omega, world.delta_t_s, beta)
            seen = read(world, phi, omega, gait="SGCS")
            assert (seen.speed_m_s, seen.peak_speed_m_s) == pytest.approx((speed, peak), rel=0.01)
            assert seen.lift_m == pytest.approx(lift, rel=0.02)


def test_legs_of_a_tripod_share_the_load():
    """Each carries the same on the level, however many; uphill the whole robot's weight pulls on what they hold."""

    def climbed(tripod, **effects):
        legs = Robot(legs_per_tripod=tripod, leg_order=tuple(f"leg_{i}" for i in range(2 * tripod)))
        world = with_noise(replace(null_world(), effects=effects).walked_by(legs), 0.0)
        t_s = setpoints(14.0)[0]
        return simulate(world, 0.62, t_s, *leg_angles(PRESETS["UNIFORM"], 14.0, t_s, tripod), seed=5)

    two, three, four = (climbed(tripod) for tripod in (2, 3, 4))
    assert two.leg_angle_rad.shape == (len(two.t_s), 4)
    np.testing.assert_allclose(two.x_m, three.x_m, rtol=1e-12)
    np.testing.assert_allclose(four.x_m, three.x_m, rtol=1e-12)
    uphill = [climbed(tripod, bed_slope={"chi_deg": 1.5}).x_m[-1] for tripod in (2, 3, 4)]
    lost = two.x_m[-1] - np.array(uphill)
    assert lost[0] < lost[1] < lost[2]
    with pytest.raises(InputError, match="expected"):
        simulate(null_world(), 0.62, two.t_s, two.leg_angle_rad, two.leg_rate_rad_s, seed=5)


def test_live_equals_batch():
    world = World(effects={"disturbed_ground": {}, "phi_nonuniformity": {}})
    t_s, angles, rates = setpoints(14.0)
    trace = simulate(world, 0.61, t_s, angles, rates, seed=5)
    robot = LabRobot(world, 0.61, seed=5)
    states = [robot.advance(*row) for row in zip(t_s, angles, rates, strict=True)]
    assert [state.x_m for state in states] == trace.x_m.tolist()
    assert [state.z_m for state in states] == trace.z_m.tolist()
    assert np.array_equal([state.leg_effort_n_m for state in states], trace.leg_effort_n_m)


def test_replicates_differ_as_the_noise_says():
    seen = np.array([list(vars(read(null_world(), 0.62, 12.0, seed=seed)).values()) for seed in range(60)])
    speed, lift, peak, first = seen.std(axis=0, ddof=1)
    # 60 draws know a standard deviation to 9 %; three of that.
    assert speed == pytest.approx(0.005, rel=0.3)
    assert lift == pytest.approx(0.0003, rel=0.3)
    assert peak == pytest.approx(np.hypot(0.005, 0.01 * R * 12.0), rel=0.3)
    assert first == pytest.approx(np.hypot(0.001, 0.005 * np.pi / 12.0), rel=0.3)
    assert read(null_world(), 0.62, 12.0, seed=7) == read(null_world(), 0.62, 12.0, seed=7)


@settings(max_examples=30)
@given(
    effects=st.sets(st.sampled_from(sorted(EFFECTS)), max_size=4),
    phi=st.floats(0.57, 0.64),
    omega=st.floats(1.0, 40.0),
    gait=st.sampled_from(["UNIFORM", "SGCS", "HGCS"]),
)
def test_whatever_the_world_the_robot_stays_on_the_track(effects, phi, omega, gait):
    trace = trial(with_noise(World(effects={name: {} for name in effects}), 0.0), phi, omega, gait)
    assert np.isfinite(trace.x_m).all()
    assert (np.diff(trace.x_m) >= -1e-9).all()
    assert trace.z_m.min() >= 0.025 - 1e-9
    assert trace.z_m.max() <= 2 * R + 1e-9


def test_legs_that_stand_move_nothing():
    t_s = np.arange(0.0, 1.0, 0.005)
    trace = simulate(null_world(), 0.6, t_s, np.zeros((t_s.size, 6)), np.zeros((t_s.size, 6)), seed=1)
    assert np.ptp(trace.x_m) == 0.0
    assert np.ptp(trace.z_m) == 0.0


@pytest.mark.parametrize(
    ("t_s", "angles", "rates", "phi", "words"),
    [
        ([0.0, 0.0], np.zeros((2, 6)), np.zeros((2, 6)), 0.6, "time must be finite and rise"),
        ([0.0, 1.0], np.zeros((2, 5)), np.zeros((2, 5)), 0.6, "expected (n,) and (n, 6)"),
        ([0.0, 1.0], np.full((2, 6), np.nan), np.zeros((2, 6)), 0.6, "not finite"),
        (
            [0.0, 0.01],
            np.outer([0.0, 100.0], np.ones(6)),
            np.zeros((2, 6)),
            0.6,
            "would turn at 1e+04 rad/s, at most 1000",
        ),
        ([0.0, 1.0], np.zeros((2, 6)), np.full((2, 6), -1e9), 0.6, "would turn at 1e+09 rad/s, at most 1000"),
        ([0.0, 1.0], np.zeros((2, 6)), np.zeros((2, 6)), 1.2, "phi: 1.2 is outside"),
        ([0.0, 1.0], np.zeros((2, 6)), np.zeros((2, 6)), float("nan"), "phi: nan is outside"),
    ],
)
def test_bad_set_points_are_refused(t_s, angles, rates, phi, words):
    with pytest.raises(InputError) as refusal:
        simulate(null_world(), phi, t_s, angles, rates, seed=0)
    assert words in str(refusal.value)


def test_live_time_never_runs_backwards():
    robot = LabRobot(null_world(), 0.6, seed=0)
    robot.advance(1.0, np.zeros(6), np.zeros(6))
    with pytest.raises(InputError, match="rise"):
        robot.advance(0.5, np.zeros(6), np.zeros(6))


def test_sgcs_on_strong_ground_holds_from_the_edge_of_the_slow_phase():
    """Control: outside the region of sgcs_world.yaml a step is set by the clock, not by the balance at slow rate."""
    strong = with_noise(World(k_knots_n_per_m=(200.0, 200.0, 200.0), delta_t_s=0.3, robot=SGCS.robot), 0.0)
    step = np.pi / 8.0 * read(strong, 0.61, 8.0, gait="SGCS").speed_m_s
    assert step == pytest.approx(2 * R * np.sin(0.55), rel=0.01)
    assert expected(200.0, 8.0, 0.3, 1.1 / (2 * np.pi * 0.45))[3] > 1.05 * step


def test_a_swimmer_that_once_walked_swims_like_one_that_never_did():
    """The stroke rate behind the thrust is that of the strokes, not of the walk before them."""
    effects = {"disturbed_ground": {"k_l_n_per_m": 165.0, "s_c": 0.95}, "swimming_thrust": {"a_m_s2": 0.45}}
    seen = read(with_noise(World(effects=effects), 0.0), 0.61, 22.0)
    assert seen.first_step_m > 0.02
    assert seen.speed_m_s == pytest.approx(0.45 / 22.0, rel=1e-3)


@pytest.mark.parametrize(("phi", "omega"), [(0.57, 16.0), (0.6, 30.0), (0.63, 8.0)])
def test_tripods_in_step_swim_or_walk(phi, omega):
    """Both pass their lowest point at once: there is no time between such strokes."""
    t_s = np.arange(0.0, 2.0, 0.005)
    x_m = simulate(null_world(), phi, t_s, np.outer(omega * t_s, np.ones(6)), np.full((t_s.size, 6), omega), seed=1).x_m
    assert np.isfinite(x_m).all()
    assert x_m[-1] > x_m[t_s.size // 2] > x_m[0]


def test_a_leg_that_jumps_half_a_turn_or_more_is_refused_or_followed_and_ends_nothing():
    refused = 0
    for angle in np.linspace(2.0, 1e3, 60):
        robot = LabRobot(null_world(), 0.6, seed=0)
        robot.advance(0.0, np.zeros(6), np.full(6, 8.0))
        try:
            robot.advance(0.01, np.full(6, angle), np.full(6, 8.0))
            robot.advance(0.02, np.full(6, angle), np.full(6, 8.0))
        except InputError:
            refused += 1
            robot.advance(0.03, np.zeros(6), np.zeros(6))
    assert refused > 50
