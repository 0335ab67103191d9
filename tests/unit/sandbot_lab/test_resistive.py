"""The ground that resists: dissipates, carries the stronger the better, remembers, and is the same live and at once."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rig import H, setpoints

from sandbot_common.errors import InputError
from sandbot_lab import resistive_kernel
from sandbot_lab.direct import direct_trials, readings
from sandbot_lab.penetrometer import press
from sandbot_lab.resistive import ResistiveGround
from sandbot_lab.robot import LabRobot, simulate
from sandbot_lab.week import Occasion, Week
from sandbot_lab.world import World, read_world, world_from_mapping, write_world

GROUND = ResistiveGround(patch_sd=0.0)
WORLD = World(resistive=GROUND)


def read(ground, phi=0.61, omega=8.0):
    world = World(resistive=ground)
    return readings(simulate(world, phi, *setpoints(omega), seed=1), world.body.leg_mount_rad)


@given(
    *(st.floats(-1, 1) for _ in range(2)), st.floats(0.0, 0.05), st.floats(-np.pi, np.pi), st.floats(-30, 30)
)  # fmt: skip
def test_what_the_ground_does_to_a_leg_takes_energy(v_x, v_z, z, theta, rate):
    (p,), (s,) = resistive_kernel.records(WORLD, GROUND, 0.61, 1, 1.0)
    s["v_x"], s["v_z"], s["z"] = v_x, v_z, z
    f_x, f_z = resistive_kernel.resist(p, s, 0, theta, rate, 1e-4)
    assert f_x * v_x + f_z * v_z - rate * s["torque"][0] <= 1e-12
    assert p["softened"] <= s["sheared"].min() <= s["sheared"].max() <= 1


def test_a_leg_in_the_air_is_free_and_one_pressed_down_is_pushed_up():
    (p,), (s,) = resistive_kernel.records(WORLD, GROUND, 0.61, 1, 1.0)
    assert resistive_kernel.resist(p, s, 0, np.pi, 8.0, 1e-4) == (0.0, 0.0)
    s["v_z"] = -0.5
    f_x, f_z = resistive_kernel.resist(p, s, 0, -0.3, 0.0, 1e-4)
    assert f_z > 5 * abs(f_x) > 0


def test_a_robot_that_does_not_move_its_legs_stays():
    t_s = np.arange(0.0, 1.0, 0.01)
    trace = simulate(WORLD, 0.6, t_s, np.full((100, 6), np.pi), np.zeros((100, 6)), seed=1)
    assert np.ptp(trace.x_m) == 0.0
    assert np.ptp(trace.z_m) < 1e-9
    assert 0 < H - trace.z_m[0] < 0.002  # the belly lies in the grains


def test_strong_ground_lifts_and_weak_ground_lets_slide():
    weak, usual, strong = (
        read(replace(GROUND, strength_n_per_m3=factor * GROUND.strength_n_per_m3)) for factor in (0.4, 1.0, 2.0)
    )
    assert weak.lift_m < 0.001 < 0.005 < usual.lift_m < strong.lift_m
    assert weak.speed_m_s < 0.5 * usual.speed_m_s < usual.speed_m_s < strong.speed_m_s


def test_ground_that_forgets_carries_better_than_ground_that_softens():
    assert read(replace(GROUND, softened=1.0)).speed_m_s > 1.1 * read(GROUND).speed_m_s


def test_half_the_step_makes_no_difference():
    motion = setpoints(8.0)
    ends = []
    for step_s in (resistive_kernel.STEP_S, resistive_kernel.STEP_S / 2):
        p, s = resistive_kernel.records(WORLD, GROUND, 0.61, 1, 0.15)
        p["step"] = step_s
        out = np.zeros((len(motion[0]), 23))
        resistive_kernel.run(p, s, *motion, out)
        ends.append(out[-1, 0] - 0.15)
    assert ends[0] == pytest.approx(ends[1], rel=0.01)


def test_step_by_step_is_the_same_as_at_once():
    world = World(resistive=ResistiveGround())
    t_s, angles, rates = setpoints(12.0)
    trace = simulate(world, 0.61, t_s, angles, rates, seed=5)
    robot = LabRobot(world, 0.61, seed=5)
    for i, t in enumerate(t_s):
        body = robot.advance(t, angles[i], rates[i])
        assert (body.x_m, body.z_m, body.v_x_m_s, body.mode) == tuple(
            getattr(trace, name)[i] for name in ("x_m", "z_m", "v_x_m_s", "mode")
        )
        assert (body.leg_effort_n_m == trace.leg_effort_n_m[i]).all()


def test_the_bed_of_a_day_is_as_much_stronger_as_the_week_says():
    world = World(resistive=GROUND, week=Week(k_drift=0.1)).at(Occasion(progress=1.0))
    assert world.resistive.strength_n_per_m3 == pytest.approx(1.1 * GROUND.strength_n_per_m3)


def test_replicates_differ_by_the_patches_they_walk_on():
    patchy, even = (direct_trials(World(resistive=one), [0.61], [8.0], seed=3) for one in (ResistiveGround(), GROUND))
    spread = [np.std([row["speed_m_s"] for row in rows]) for rows in (patchy, even)]
    assert spread[0] > spread[1]


def test_it_is_written_and_read(tmp_path):
    world = World(resistive=replace(GROUND, softened=0.3), week=Week(k_drift=0.01))
    write_world(world, tmp_path / "world.yaml")
    assert read_world(tmp_path / "world.yaml") == world
    assert world_from_mapping({"resistive": None}, "w").resistive == ResistiveGround()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"resistive": {}, "delta_t_s": 0.3}, "w: delta_t_s: means nothing on the ground of resistive:; leave it out"),
        ({"resistive": {}, "noise": {"peak_sd": 0.1}}, "w: noise: peak_sd: means nothing"),
        ({"resistive": {}, "effects": {"cohesion": {}}}, "effects: cohesion: they act on ground that holds"),
        ({"resistive": {"softend": 0.3}}, "did you mean 'softened'"),
        ({"resistive": {"softened": 1.3}}, "softened: 1.3"),
    ],
)
def test_what_would_be_ignored_is_refused(content, said):
    with pytest.raises(InputError, match=said):
        world_from_mapping(content, "w")


def test_there_is_no_penetrometer_for_it():
    with pytest.raises(InputError, match="creeps"):
        press(WORLD, [0.6])


@pytest.mark.parametrize("given", [False, 0, [], "no"])
def test_no_is_not_the_ground_with_all_its_defaults(given):
    with pytest.raises(InputError, match="resistive"):
        world_from_mapping({"resistive": given}, "world.yaml")
    with pytest.raises(InputError, match="effects"):
        world_from_mapping({"effects": given}, "world.yaml")
    with pytest.raises(InputError, match="noise"):
        world_from_mapping({"resistive": None, "noise": 3}, "world.yaml")
    assert world_from_mapping({"resistive": None}, "world.yaml").resistive is not None
    assert world_from_mapping({"effects": None}, "world.yaml").effects == {}
