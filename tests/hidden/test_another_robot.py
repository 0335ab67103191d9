"""The lab walks a robot with longer legs and twice the mass: named with its robot.yaml, doubted with another's."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from worlds import BY_NAME, EFFECTS

from sandbot_common.robot import SANDBOT, Robot
from sandbot_lab.direct import direct_trials
from sandbot_lab.week import Week
from sandbot_lab.world import Noise, World
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.plausibility import doubts, in_doubt
from sandbot_model.fitting.fit import fit
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.model import model_of
from sandbot_model.physics.observables import Observable
from sandbot_record.trials.table import Row, Trials, from_rows

BIG = Robot(leg_radius_m=0.05, mass_per_leg_kg=2 * SANDBOT.mass_per_leg_kg)
ETA = 0.15
PHI, OMEGA = (0.58, 0.595, 0.61, 0.633), (4, 8, 12, 16, 20)


@cache
def table(eta: float, robot: Robot, k_scale: float) -> tuple[Row, ...]:
    """What the lab measures of ``robot`` directly, on ground that carries its weight as SandBot's carries SandBot."""
    ground = tuple(k_scale * k for k in (170.0, 205.0, 220.0))
    effects = {"stance_overlap": {"eta": eta}} if eta else {}
    world = World(k_knots_n_per_m=ground, effects=effects, robot=robot)
    return tuple(Row(**row) for row in direct_trials(world, PHI, OMEGA, "UNIFORM", 3, seed=1))


def walked_by_big(told: Robot, eta: float = ETA) -> Trials:
    """Its trials, as the robot that the analysis is told of; filmed at 200 frames/s."""
    return from_rows(table(eta, BIG, 1.23), told, frame_rate_hz=200.0)


@pytest.mark.whole  # the others say when a robot is doubted and when not
@pytest.mark.slow
def test_the_effect_is_named_with_the_right_robot():
    found = discover(cells_of(walked_by_big(BIG)), EFFECTS, max_effects=1)
    assert (found.verdict.status, found.verdict.effects) == ("identified", ("stance_overlap",))
    eta = found.steps[-1].parameters["stance_overlap.eta"]
    assert abs(eta.value - ETA) < 3 * eta.stderr
    delta_t = found.steps[-1].parameters["delta_t_s"]
    assert abs(delta_t.value - 0.4) < 3 * delta_t.stderr
    assert found.to_dict()["robot"]["leg_radius_m"] == 0.05


def test_disturbed_ground_fits_where_it_carries_this_robot_as_it_does_sandbot():
    """Its k_L is 249 N/m, which is beyond SandBot's range; on less than 229 N/m this robot swims."""
    heavier = 1.4
    robot = Robot(mass_per_leg_kg=heavier * SANDBOT.mass_per_leg_kg)
    world = World(
        k_knots_n_per_m=tuple(heavier * k for k in (170.0, 205.0, 220.0)),
        effects={"disturbed_ground": {"k_l_n_per_m": heavier * 178.0}},
        robot=robot,
    )
    phi, omega = (0.58, 0.59, 0.6, 0.611, 0.622, 0.633), (6, 9, 12, 16, 20, 24)
    rows = [Row(**row) for row in direct_trials(world, phi, omega, "UNIFORM", 3, seed=1)]
    cells = cells_of(from_rows(rows, robot))
    found = fit(model_of("simple", ("disturbed_ground",), EFFECTS, robot), cells)
    assert found.lack_of_fit_p > 0.01
    assert not found.implausible
    k_l = found.parameters["disturbed_ground.k_l_n_per_m"]
    assert abs(k_l.value - heavier * 178.0) < 3 * k_l.stderr
    # Control: with SandBot's ranges.
    rigid = {name: fixed(effect) for name, effect in EFFECTS.items()}
    assert fit(model_of("simple", ("disturbed_ground",), rigid, robot), cells).lack_of_fit_p < 1e-6


def fixed(effect: Effect) -> Effect:
    """The effect with SandBot's ranges for every robot."""
    return effect.with_parameters(tuple(replace(one, scales_with=None) for one in effect.parameters))


def test_with_another_robots_file_nothing_is_identified_and_the_message_says_why():
    verdict = discover(cells_of(walked_by_big(SANDBOT)), EFFECTS, max_effects=2).verdict
    assert (verdict.status, verdict.effects) == ("unexplained", ())
    assert verdict.because.startswith("robot.yaml may be wrong, so nothing is identified: peak speeds are 1.4")


@pytest.mark.parametrize("told", [SANDBOT, Robot(leg_radius_m=0.043)])
def test_without_any_effect_two_measurements_of_the_radius_agree_on_the_right_one(told):
    assert any("agree on a leg radius of 4.98 and 5.02 cm" in one for one in doubts(cells_of(walked_by_big(told, 0.0))))


def test_a_robot_told_too_big_is_doubted_too():
    trials = from_rows(table(0.0, SANDBOT, 1.0), BIG)
    assert any("not on 5 cm" in one for one in doubts(cells_of(trials)))


def test_the_right_robot_is_not_doubted():
    """Control, with the effect and without."""
    assert [doubts(cells_of(walked_by_big(BIG, eta))) for eta in (0.0, ETA)] == [(), ()]


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [name if at % 8 == 0 else pytest.param(name, marks=pytest.mark.whole) for at, name in enumerate(BY_NAME)]
)
def test_no_hidden_world_is_blamed_on_robot_yaml(name):
    """Control: in the catalogue or outside it."""
    assert doubts(cells_of(BY_NAME[name].trials(1))) == ()


def pushed(robot: Robot) -> Trials:
    """SandBot 3° downhill, steeper than the catalogue has it: 1.27 times the speed its legs could give it."""
    world = World(effects={"bed_slope": {"chi_deg": -3.0}})
    return from_rows([Row(**row) for row in direct_trials(world, PHI, OMEGA, "UNIFORM", 3, seed=1)], robot)


def test_a_push_that_peak_step_and_lift_agree_on_is_no_other_robot():
    cells = cells_of(pushed(SANDBOT))
    assert np.median(cells.mean[:, Observable.peak_speed] / cells.omega) > 1.25 * SANDBOT.leg_radius_m
    assert doubts(cells) == ()
    assert any("peak speeds are" in one for one in doubts(cells_of(pushed(Robot(leg_radius_m=0.03)))))


def test_the_whole_mass_in_place_of_a_leg_s_share_is_pointed_out():
    heavy = Robot(mass_per_leg_kg=3 * SANDBOT.mass_per_leg_kg)
    found = discover(cells_of(from_rows(table(0.0, SANDBOT, 1.0), heavy)), EFFECTS, max_effects=0)
    assert "are mass_per_leg_kg (a third of the robot's)" in found.verdict.because
    right = discover(cells_of(from_rows(table(0.0, SANDBOT, 1.0), SANDBOT)), EFFECTS, max_effects=0)
    assert "mass_per_leg_kg" not in right.verdict.because


def measured(robot=SANDBOT, batches="replicate", **lab) -> list[Row]:
    """A campaign with nothing hidden, run in blocks."""
    rows = direct_trials(World(robot=robot, **lab), PHI, OMEGA, "UNIFORM", 3, 1, None, "randomised", batches)
    return [Row(**row) for row in rows]


def with_longer_legs(**as_of) -> list[Row]:
    """SandBot's trials, below them those of a robot with legs 15 % longer, as ``as_of`` has them."""
    second = measured(Robot(leg_radius_m=1.15 * SANDBOT.leg_radius_m))
    rows = [*measured(batches="none"), *(replace(row, batch="", **as_of) for row in second)]
    return [replace(row, trial_id=f"t{at}", run_order=at) for at, row in enumerate(rows, 1)]


def test_two_robots_in_one_table_are_told_from_replicates_in_two_groups():
    found = discover(cells_of(from_rows(with_longer_legs())), EFFECTS, max_effects=1)
    assert (found.verdict.status, found.verdict.effects) == ("unexplained", ())
    assert "the table may mix two robots or set-ups, so nothing is identified" in found.verdict.because
    assert "up to t60 and from t61 on" in found.verdict.because
    assert found.residual is None


@pytest.mark.parametrize(
    ("rows", "lab"),
    [
        (measured, {"week": Week(k_jump=0.03, k_jumps_at=(0.5,))}),
        (measured, {"week": Week(k_drift=0.03)}),
        (measured, {"week": Week(k_batch_sd=0.015)}),
        (measured, {"noise": Noise(scale=15.0)}),
        (with_longer_legs, {"lift_m": np.nan, "peak_speed_m_s": np.nan, "first_step_m": np.nan}),
    ],
    ids=["jump", "drift", "days", "noisy", "speed alone"],
)
def test_a_bad_week_and_a_noisy_lab_are_no_two_robots(rows, lab):
    assert in_doubt(cells_of(from_rows(rows(**lab)))) == ""
