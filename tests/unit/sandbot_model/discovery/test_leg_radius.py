"""Legs of another radius than robot.yaml's are suspected where they explain what a scale or a pair seems to."""

import re
from dataclasses import dataclass, replace
from types import SimpleNamespace

import pytest

from sandbot_common.robot import SANDBOT, Robot
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery import leg_radius
from sandbot_model.discovery.discover import discover
from sandbot_model.physics.catalogue import catalogue

NAMES = ("stance_overlap", "bed_slope", "slow_phase_speed")
FEW = {name: effect for name, effect in catalogue().items() if name in NAMES}
OMEGA = (6, 11, 16, 20, 24)
LEGS = re.compile(r"legs of (\S+) ± (\S+) cm instead of robot.yaml's (\S+) cm")


def found_with(trials, share, **how):
    """What is found if robot.yaml gives this share of the radius on which the trials were walked."""
    robot = replace(SANDBOT, leg_radius_m=share * SANDBOT.leg_radius_m)
    return discover(cells_of(replace(trials, robot=robot)), FEW, **how)


@pytest.fixture(scope="module")
def trials(drawn):
    return drawn(seed=3, levels=3, omega=OMEGA)


def test_a_scale_of_several_priors_may_be_a_wrong_radius(trials):
    found, right = found_with(trials, 1.05, max_effects=1), found_with(trials, 1.0, max_effects=1)
    assert found.verdict.status == right.verdict.status == "adequate"
    because = " ".join(found.verdict.because.split())
    assert "a speed-scale error of" in because
    assert "explain as much: measure them (standard errors of Δt and k cover" in because
    radius_cm, stderr_cm, given_cm = map(float, LEGS.search(because).groups())
    assert radius_cm == pytest.approx(3.55, abs=3 * stderr_cm)
    assert given_cm == pytest.approx(3.55 * 1.05, abs=0.01)
    value, stderr = found.fit.parameters["delta_t_s"]
    assert abs(value - right.fit.parameters["delta_t_s"].value) < 2.5 * stderr
    assert stderr > 2 * right.fit.parameters["delta_t_s"].stderr
    assert "legs of" not in right.verdict.because


@pytest.mark.parametrize("share", [0.925, 0.95])
def test_no_effect_is_claimed_that_a_wrong_radius_explains_as_well(trials, share):
    """Without the radius bed_slope is identified."""
    found = found_with(trials, share, max_effects=2)
    assert found.verdict.status == "unexplained"
    assert found.verdict.because.startswith("robot.yaml may be wrong, so nothing is identified: legs of 3.5")


def test_a_scale_that_is_off_is_not_taken_for_a_radius(trials):
    long = {name: 1.03 * getattr(trials, name) for name in ("speed_m_s", "peak_speed_m_s", "first_step_m")}
    found = discover(cells_of(replace(trials, **long)), FEW, max_effects=1)
    assert "a speed-scale error of" in found.verdict.because
    assert "legs of" not in found.verdict.because


@pytest.mark.parametrize("names", [("bed_slope",), ("disturbed_ground", "stance_overlap")])
def test_what_is_there_is_still_claimed(drawn, names):
    """A calibration error or a radius might look like a slope, and a pair is always asked about."""
    some = {name: effect for name, effect in catalogue().items() if name in {*NAMES, *names}}
    found = discover(cells_of(drawn(names, seed=4, levels=4)), some, max_effects=2)
    assert found.verdict.effects == names


@dataclass(frozen=True)
class Legged:
    robot: Robot


@pytest.mark.parametrize(("share", "suspected"), [(1.0, False), (1.018, False), (0.982, False), (1.03, True)])
def test_a_radius_within_two_standard_errors_is_robot_yamls(share, suspected):
    def near(models, _fit, _nuisances):
        shares = [model.robot.leg_radius_m / SANDBOT.leg_radius_m for model in models]
        return [SimpleNamespace(deviance=((one - share) / 0.01) ** 2) for one in shares]

    search = SimpleNamespace(cells=SimpleNamespace(robot=SANDBOT), near=near)
    legs = leg_radius._with_free_radius(search, SimpleNamespace(model=Legged(SANDBOT)), None)
    assert bool(legs) == suspected
    if legs:
        assert legs.radius_m == pytest.approx(share * SANDBOT.leg_radius_m, rel=1e-3)
