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
from sandbot_model.physics import tape
from sandbot_model.physics.chain import Chain
from sandbot_model.physics.model import model_of
from sandbot_model.physics.variants import AT_THE_SLOW_RATE, BY_THE_MEAN_RATE, with_variants
from sandbot_record.trials.table import Row, from_rows

CLOCK = "slow_phase_speed"
HIDDEN = {"motor_saturation": ("omega_s_rad_s", 50.0, BY_THE_MEAN_RATE), "belly_coast": ("mu_b", 0.4, AT_THE_SLOW_RATE)}
"""A parameter's true value, and the convention that overlooks the gait's phases."""
EACH = pytest.mark.parametrize("name", HIDDEN)
# On another mount all of a stance lies in the slow phase. In HGCS a leg would stand for longer than half a period.
CASES = pytest.mark.parametrize(
    ("gait", "mount_rad"), [pytest.param("SGCS", 0.0, marks=pytest.mark.whole), ("SGCS", 0.5), ("HGCS", 0.0)]
)


@cache
def cells(name="", gait="SGCS", mount_rad=0.0):
    effects = {name: {HIDDEN[name][0]: HIDDEN[name][1]}} if name else {}
    robot = replace(SANDBOT, leg_mount_rad=mount_rad)
    world = World(effects=effects, noise=Noise(scale=1.0)).walked_by(robot)
    rows = direct_trials(world, PHI, hidden.OMEGA, gait, 3, 11)
    return cells_of(from_rows([Row(**row) for row in rows], robot))


def fitted(of, name="", effects=EFFECTS):
    names = tuple(one for one in EFFECTS if one in (name, CLOCK))
    return fit(model_of("simple", names, effects, of.robot), of)


@pytest.mark.slow
@EACH
@CASES
def test_the_effect_leaves_nothing_to_explain_and_has_its_true_strength(name, gait, mount_rad):
    key, value, _ = HIDDEN[name]
    found = fitted(cells(name, gait, mount_rad), name)
    assert found.lack_of_fit_p > 0.01
    strength = found.parameters[f"{name}.{key}"]
    # Where a step is cut short it is known by which cells that happens in: the deviance is a staircase.
    assert strength.value == pytest.approx(value, abs=max(4 * strength.stderr, 0.05 * value))


@pytest.mark.slow
@EACH
def test_a_formula_that_overlooks_the_phases_fits_worse(name):
    """Control: motors by the mean rate come near, at another ω_s."""
    overlooked = fitted(cells(name), name, with_variants({name: HIDDEN[name][2]}, EFFECTS))
    assert overlooked.deviance > fitted(cells(name), name).deviance + 20


@pytest.mark.slow
def test_in_the_gait_of_hard_ground_the_next_leg_ends_a_stance(monkeypatch):
    """With a control: stances as long as in a gait whose tripods take turns."""
    assert fitted(cells(gait="HGCS")).lack_of_fit_p > 0.01
    monkeypatch.setattr(Chain, "longest_step", property(lambda chain: chain.chord))
    monkeypatch.setattr(tape, "recorded", tape.recorded.__wrapped__)
    assert fitted(cells(gait="HGCS")).lack_of_fit_p < 1e-8


@pytest.mark.whole
@EACH
@pytest.mark.parametrize("gait", ["SGCS", "HGCS"])
def test_it_is_named(name, gait):
    found = discover(cells(name, gait), EFFECTS, max_effects=2)
    assert (found.verdict.status, set(found.verdict.effects)) == ("identified", {name, CLOCK})
    assert found.variants == {}


@pytest.mark.whole
@pytest.mark.parametrize("gait", ["SGCS", "HGCS"])
def test_where_nothing_is_hidden_the_clock_is_named_and_nothing_else(gait):
    """The fast phase of HGCS turns at 1.96 of the mean rate."""
    found = discover(cells(gait=gait), EFFECTS, max_effects=2)
    assert (found.verdict.status, found.verdict.effects) == ("identified", (CLOCK,))
