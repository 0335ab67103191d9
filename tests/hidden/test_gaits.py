"""Effects that mind in which phase of the gait a leg is: the lab's legs turn as the clock says, moment by moment."""

from dataclasses import replace
from functools import cache

import pytest
from worlds import EFFECTS, PHI, World, hidden

from sandbot_common.robot import SANDBOT
from sandbot_lab.direct import direct_trials
from sandbot_lab.world import Noise
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.discover import discover
from sandbot_model.fitting.fit import fit
from sandbot_model.physics.model import model_of
from sandbot_model.physics.variants import AT_THE_SLOW_RATE, BY_THE_MEAN_RATE, under
from sandbot_record.trials.table import Row, from_rows

CLOCK = "slow_phase_speed"
HIDDEN = {
    "motor_saturation": ("omega_s_rad_s", 50.0, BY_THE_MEAN_RATE),
    "belly_coast": ("mu_b", 0.4, AT_THE_SLOW_RATE),
}
"""A parameter's true value, and the convention that overlooks the gait's phases."""
EACH = pytest.mark.parametrize("name", HIDDEN)
# On another mount all of a stance lies in the slow phase.
MOUNTS = pytest.mark.parametrize("mount_rad", [0.0, 0.5])


@cache
def cells(name, mount_rad=0.0):
    key, value, _ = HIDDEN[name]
    robot = replace(SANDBOT, leg_mount_rad=mount_rad)
    world = World(effects={name: {key: value}}, noise=Noise(scale=1.0)).walked_by(robot)
    rows = direct_trials(world, PHI, hidden.OMEGA, "SGCS", 3, 11)
    return cells_of(from_rows([Row(**row) for row in rows], robot))


def fitted(name, mount_rad=0.0, effects=EFFECTS):
    names, of = tuple(one for one in EFFECTS if one in (name, CLOCK)), cells(name, mount_rad)
    return fit(model_of("simple", names, effects, of.robot), of)


@pytest.mark.slow
@EACH
@MOUNTS
def test_the_effect_leaves_nothing_to_explain_and_has_its_true_strength(name, mount_rad):
    key, value, _ = HIDDEN[name]
    found = fitted(name, mount_rad)
    assert found.lack_of_fit_p > 0.01
    strength = found.parameters[f"{name}.{key}"]
    assert strength.value == pytest.approx(value, abs=4 * strength.stderr)


@pytest.mark.slow
@EACH
def test_a_formula_that_overlooks_the_phases_fits_worse(name):
    """Control: motors by the mean rate come near, at another ω_s."""
    overlooked = fitted(name, effects=under({name: HIDDEN[name][2]}, EFFECTS))
    assert overlooked.deviance > fitted(name).deviance + 20


@pytest.mark.whole
@EACH
def test_it_is_named(name):
    found = discover(cells(name), EFFECTS, max_effects=2)
    assert (found.verdict.status, set(found.verdict.effects)) == ("identified", {name, CLOCK})
    assert found.variants == {}
