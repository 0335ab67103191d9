"""What a real week shares: batches, drift, jumps, readings off their zero; and nothing of it where nothing is said."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from rig import QUIET
from test_cameras import CAMERAS

from sandbot_common.errors import InputError
from sandbot_lab.direct import ReadingErrors, direct_trials
from sandbot_lab.live_trial import LiveTrial
from sandbot_lab.robot import as_seen, simulate
from sandbot_lab.week import Occasion, Week, seen_x_m
from sandbot_lab.world import null_world, read_world, world_from_mapping, write_world

EXACT = ReadingErrors(phi=0.0, speed_m_s=0.0, lift_m=0.0, peak=0.0, peak_m_s=0.0, first_step_m=0.0)
LATE = Occasion(batch_seed=5, trial_seed=7, progress=1.0)
GRID = {"phis": [0.6, 0.62], "omegas": [8.0, 16.0], "replicates": 2, "errors": EXACT}


def in_a_week(**keys):
    return dataclasses.replace(QUIET, week=Week(**keys))


def test_a_world_that_says_nothing_of_its_week_is_the_same_at_any_moment():
    world = null_world()
    assert world.at(LATE) == world
    assert world.week.strength(LATE) == 1.0
    assert world.week.lift_offset_m(LATE) == 0.0
    x_m = np.random.default_rng(0).normal(size=50)
    assert (seen_x_m(x_m, 0.15, world.week.scale_error(LATE)) == x_m).all()
    plain = direct_trials(world, [0.6], [8.0], replicates=2)
    told = direct_trials(world, [0.6], [8.0], replicates=2, order="randomised", batches="replicate")
    for one, other in zip(plain, told, strict=True):
        assert {**one, "batch": 0, "run_order": 0} == {**other, "batch": 0, "run_order": 0}


def test_batches_scatter_each_by_its_own_and_trials_of_one_share_it():
    week = Week(k_batch_sd=0.02)
    factors = [week.strength(Occasion(batch_seed=batch, trial_seed=trial)) for batch in range(300) for trial in (1, 2)]
    assert factors[::2] == factors[1::2]
    assert np.std(np.log(factors[::2])) == pytest.approx(0.02, rel=0.2)
    own = [Week(k_preparation_sd=0.01).strength(Occasion(1, trial)) for trial in range(300)]
    assert np.std(np.log(own)) == pytest.approx(0.01, rel=0.2)


def test_a_drift_grows_along_the_campaign_and_a_jump_comes_at_its_place():
    drift = [Week(k_drift=0.04).strength(Occasion(progress=place)) for place in (0.0, 0.5, 1.0)]
    assert drift == pytest.approx([1.0, 1.02, 1.04], abs=3e-4)
    jumps = [Week(k_jump=-0.1, k_jumps_at=(0.25, 0.75)).strength(Occasion(progress=place)) for place in (0.2, 0.25, 1)]
    assert jumps == pytest.approx([1.0, 0.9, 0.81])


def test_direct_trials_drift_with_their_run_order_not_with_their_place_in_the_list():
    # Replicates without noise differ by nothing but when they were run.
    world = in_a_week(k_drift=0.2)
    one = direct_trials(world, **GRID, order="randomised", batches="replicate")
    assert sorted(row["run_order"] for row in one) == list(range(1, 9))
    for early, late in zip(one[::2], one[1::2], strict=True):
        assert (early["batch"], late["batch"]) == ("block1", "block2") or early["run_order"] > late["run_order"]
        sooner, later = sorted((early, late), key=lambda row: row["run_order"])
        assert later["lift_m"] > sooner["lift_m"]
    steady = direct_trials(QUIET, **GRID, order="randomised", batches="replicate")
    assert all(a["lift_m"] == pytest.approx(b["lift_m"]) for a, b in zip(steady[::2], steady[1::2], strict=True))


@pytest.mark.parametrize("order", ["as_listed", "randomised"])
@pytest.mark.parametrize(("kind", "key"), [("omega", "omega_rad_s"), ("replicate", "replicate")])
def test_batches_are_run_one_after_the_other(order, kind, key):
    rows = direct_trials(QUIET, **GRID, order=order, batches=kind)
    run = [row["batch"] for row in sorted(rows, key=lambda row: row["run_order"])]
    assert len({(row["batch"], row[key]) for row in rows}) == len(set(run)) == 2
    assert sum(one != other for one, other in pairwise(run)) == 1
    if order == "as_listed" and kind == "omega":
        assert [row["run_order"] for row in rows] == list(range(1, 9))


def test_the_order_follows_from_the_seed():
    orders = [
        [row["run_order"] for row in direct_trials(QUIET, **GRID, order="randomised", seed=seed)] for seed in (1, 1, 2)
    ]
    assert orders[0] == orders[1] != orders[2]


def test_readings_off_their_zero_and_scale():
    true = direct_trials(QUIET, [0.61], [10.0], replicates=1, errors=EXACT)[0]
    off = direct_trials(in_a_week(lift_zero_m=1e-3, speed_scale=0.01), [0.61], [10.0], replicates=1, errors=EXACT)[0]
    assert off["lift_m"] - true["lift_m"] == pytest.approx(1e-3)
    for name in ("speed_m_s", "peak_speed_m_s", "first_step_m"):
        assert off[name] == pytest.approx(1.01 * true[name])
    denser = direct_trials(QUIET, [0.60], [10.0], replicates=1, errors=EXACT)[0]
    read_high = direct_trials(in_a_week(phi_zero=0.01), [0.61], [10.0], replicates=1, errors=EXACT)[0]
    assert read_high["speed_m_s"] == pytest.approx(denser["speed_m_s"])
    assert read_high["phi"] == pytest.approx(0.61)


def test_readings_set_anew_each_day_are_off_alike_within_one_and_at_random_from_day_to_day():
    week = Week(lift_zero_batch_sd_m=5e-4, speed_scale_batch_sd=0.01)
    zeros, scales = np.array(
        [(week.lift_offset_m(Occasion(day)), week.scale_error(Occasion(day))) for day in range(300)]
    ).T
    assert (np.std(zeros), np.std(scales)) == (pytest.approx(5e-4, rel=0.15), pytest.approx(0.01, rel=0.15))
    assert abs(np.corrcoef(zeros, scales)[0, 1]) < 0.2
    assert week.scale_error(Occasion(3, 1)) == week.scale_error(Occasion(3, 2, 0.5))


def test_cameras_show_the_same_live_and_in_batch():
    world = in_a_week(k_drift=0.1, lift_zero_m=1e-3, speed_scale=0.02, speed_scale_batch_sd=0.01, phi_zero=0.004)
    t_s = np.arange(200) / 200.0
    angles = np.tile((10.0 * t_s)[:, None], (1, 6))
    rates = np.full((200, 6), 10.0)
    trace = simulate(world.at(LATE), 0.61 - 0.004, t_s, angles, rates, 3)
    seen = as_seen(trace, world.week, LATE)
    assert seen.z_m[0] == pytest.approx(trace.z_m[0] - 1e-3)
    assert (seen.z_m[1:] == trace.z_m[1:]).all()
    scale = 1.0 + world.week.scale_error(LATE)
    assert abs(scale - 1.02) > 1e-4
    assert np.ptp(seen.x_m) == pytest.approx(scale * np.ptp(trace.x_m))
    live = LiveTrial(world, 0.61, 3, trace.x_m[0], {"dorsal": CAMERAS["dorsal"]}, 0, LATE)
    for index, t in enumerate(t_s[:60]):
        live.advance(round(t * 1e9), angles[index], rates[index])
    shown = live._motion.until(t_s[59])
    np.testing.assert_allclose(shown.x_m, seen.x_m[:60], atol=1e-12)
    np.testing.assert_allclose(shown.z_m, seen.z_m[:60], atol=1e-12)


def test_a_week_is_written_and_read_back(tmp_path):
    world = in_a_week(k_batch_sd=0.005, k_jump=0.02, k_jumps_at=(0.3, 0.6), lift_zero_m=5e-4)
    write_world(world, tmp_path / "world.yaml")
    assert read_world(tmp_path / "world.yaml") == world


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: world_from_mapping({"week": {"k_drif": 0.1}}, "w.yaml"), "did you mean 'k_drift'"),
        (lambda: world_from_mapping({"week": {"lift_zero_m": 1.0}}, "w.yaml"), "lift_zero_m: 1.0 is outside"),
        (lambda: direct_trials(QUIET, [0.6], [8.0], order="sorted"), "order: 'sorted' is not one of"),
        (lambda: direct_trials(QUIET, [0.6], [8.0], batches="moon"), "batches: 'moon' is not one of"),
    ],
)
def test_refusals(call, words):
    with pytest.raises(InputError, match=words):
        call()
