"""Effects that look alike: the analysis says so, names the measurement that splits them, and that splits them."""

import dataclasses
import re

import numpy as np
import pytest
from worlds import BY_NAME, EFFECTS, PHI, World

from sandbot_lab.penetrometer import press
from sandbot_model.data.conditions import cells_of
from sandbot_model.data.penetrometer import Readings
from sandbot_model.discovery.discover import discover

pytestmark = pytest.mark.slow
FEW = PHI[::2]
"""Levels enough for what needs no curve over φ."""


def pressed(world, seed):
    rows = press(World(effects={name: dict(values) for name, values in world.effects.items()}), PHI, seed=seed)
    return Readings(*(np.array([row[name] for row in rows]) for name in ("phi", "depth_m", "force_n", "force_sd_n")))


def proposed(found, effect):
    """The observable that is said to show an effect, perhaps in a trial that shows another one better."""
    shown = re.search(rf"(?:show |; )(?:\w+, )*{effect}(?:, \w+)*: (\w+) at", found.verdict.because)
    return shown and shown[1]


@pytest.mark.whole  # the next ones are of its kind
def test_mean_speed_cannot_see_the_slow_phase_and_its_peak_can():
    trials = BY_NAME["slow_phase_speed(SGCS)"].trials(22, FEW)
    unknown = np.full(len(trials.phi), np.nan)
    alone = dataclasses.replace(trials, lift_m=unknown, peak_speed_m_s=unknown, first_step_m=unknown)
    found = discover(cells_of(alone), EFFECTS, max_effects=1)
    assert found.verdict.status == "adequate"
    assert "slow_phase_speed" in found.unseen
    assert proposed(found, "slow_phase_speed") == "peak_speed"
    measured = dataclasses.replace(alone, peak_speed_m_s=trials.peak_speed_m_s)
    found = discover(cells_of(measured), EFFECTS, max_effects=1)
    assert (found.verdict.status, found.verdict.effects) == ("identified", ("slow_phase_speed",))


SOME = ("cohesion", "depth_nonlinearity", "stance_overlap", "disturbed_ground", "bed_slope")


@pytest.mark.parametrize(
    ("name", "tried"),
    [
        # test_power has it without the lab
        pytest.param("cohesion(c_pa=300)", SOME, marks=pytest.mark.whole),
        pytest.param("cohesion(c_pa=300)", tuple(EFFECTS), marks=pytest.mark.whole),
        pytest.param("depth_nonlinearity(n=1.25)", tuple(EFFECTS), marks=pytest.mark.whole),
    ],
)
def test_trials_cannot_see_the_law_of_force_and_a_penetrometer_can(name, tried):
    effects = {one: EFFECTS[one] for one in tried}
    world = BY_NAME[name]
    trials = world.trials(21, FEW)
    found = discover(cells_of(trials), effects, max_effects=1)
    assert found.verdict.status == "adequate"
    assert set(world.truth) <= set(found.unseen)
    assert proposed(found, world.truth[0]) == "penetration_force"
    found = discover(cells_of(trials, pressed(world, 2)), effects, max_effects=1)
    assert found.verdict.status in ("identified", "ambiguous")
    assert world.truth in found.verdict.alternatives
    assert found.verdict.effects == world.truth


def test_a_penetrometer_on_plain_ground_claims_nothing():
    world = BY_NAME["null"]
    found = discover(cells_of(world.trials(23, FEW), pressed(world, 3)), EFFECTS, max_effects=1)
    assert found.verdict.status == "adequate"
    assert not {"cohesion", "depth_nonlinearity"} & set(found.unseen)


def test_added_mass_shows_in_nothing_that_is_measured_here():
    found = discover(cells_of(BY_NAME["added_mass(c_g=2.7)"].trials(25, FEW)), EFFECTS, max_effects=1)
    assert found.verdict.status == "adequate"
    assert "added_mass" in found.unseen
    assert not proposed(found, "added_mass")
