"""Whether the robot of robot.yaml can have walked: silent for the right one, and each line of evidence by itself."""

import re
from dataclasses import replace

import numpy as np
import pytest

from sandbot_common.robot import SANDBOT, Robot
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.plausibility import doubts, effects_may_explain, implausible_k
from sandbot_model.fitting.fit import fit
from sandbot_model.physics.model import model_of
from sandbot_model.physics.observables import Observable


@pytest.fixture(scope="module")
def trials(drawn):
    return drawn(levels=3, omega=(4, 8, 12, 16))


def as_of(trials, **of_robot):
    """The trials as another robot's."""
    return cells_of(replace(trials, robot=Robot(**of_robot)))


@pytest.mark.parametrize("effects", [(), ("stance_overlap",), ("leg_slip",), ("disturbed_ground",)])
def test_the_right_robot_is_not_doubted(drawn, effects):
    assert doubts(cells_of(drawn(effects, levels=3, omega=(4, 8, 12, 16)))) == ()


def test_legs_too_short_for_the_peak_speeds_are_doubted(trials):
    short = {"leg_radius_m": 0.025, "axle_height_m": 0.02}
    found = doubts(as_of(trials, **short))
    assert any(said.startswith("peak speeds are 1.4") for said in found)
    # Without the peaks, only what else is measured speaks.
    blind = cells_of(replace(trials, robot=Robot(**short), peak_speed_m_s=np.full(len(trials), np.nan)))
    assert not any("peak speeds" in said for said in doubts(blind))


def test_effects_may_explain_another_radius_but_no_legs_beyond_their_limits(trials):
    assert effects_may_explain(as_of(trials, leg_radius_m=0.045))
    assert not effects_may_explain(as_of(trials, leg_radius_m=0.025, axle_height_m=0.02))
    assert not effects_may_explain(cells_of(trials))


def test_a_body_that_rises_higher_than_legs_can_lift_it_is_doubted(trials):
    cells = as_of(trials)
    cells.mean[:, Observable.lift] = 1.4 * (2 * SANDBOT.leg_radius_m - SANDBOT.axle_height_m)
    assert any("rises 1.40 times as high" in said for said in doubts(cells))


@pytest.mark.parametrize("radius_m", [0.028, 0.045])
def test_lift_and_peak_that_agree_on_another_radius_are_believed(trials, radius_m):
    (said,) = (said for said in doubts(as_of(trials, leg_radius_m=radius_m)) if "agree" in said)
    radii = [float(number) for number in re.findall(r"(\d\.\d\d) ", said)]
    assert radii == pytest.approx([3.55, 3.55], rel=0.03)
    assert doubts(as_of(trials, leg_radius_m=0.037)) == ()


def test_cells_between_walking_and_swimming_tell_no_radius(trials):
    """A third of their replicates get nowhere, so peak and lift have two thirds of their value; control: all walk."""
    swims = trials.replicate == 0
    low = {name: np.where(swims, 0.0, getattr(trials, name)) for name in ("speed_m_s", "peak_speed_m_s")}
    between = replace(trials, **low, lift_m=np.where(swims, 0.0, trials.lift_m))
    assert doubts(cells_of(between)) == ()
    assert any("agree" in said for said in doubts(cells_of(replace(trials, robot=Robot(leg_radius_m=0.1)))))


def test_few_cells_prove_nothing(trials):
    few = trials.select(np.isin(np.round(trials.omega_rad_s), (4, 8)) & (trials.phi < 0.6))
    assert doubts(cells_of(replace(few, robot=Robot(leg_radius_m=0.025, axle_height_m=0.02)))) == ()


def test_stiffness_far_from_the_grains_is_pointed_out(trials):
    right = fit(model_of("simple", (), {}), as_of(trials))
    assert implausible_k(right) == ""
    heavy = Robot(mass_per_leg_kg=3 * SANDBOT.mass_per_leg_kg)
    found = implausible_k(fit(model_of("simple", (), {}, heavy), as_of(trials, mass_per_leg_kg=heavy.mass_per_leg_kg)))
    assert "times what a leg of this size meets in poppy seeds" in found


def test_a_peak_of_0_for_one_that_was_not_measured_gives_no_radius(trials):
    """No warning of a division by it either: pytest makes that an error."""
    none = np.where(trials.speed_m_s > 0.1, 0.0, trials.peak_speed_m_s)
    assert not any("agree on a leg radius" in doubt for doubt in doubts(cells_of(replace(trials, peak_speed_m_s=none))))
