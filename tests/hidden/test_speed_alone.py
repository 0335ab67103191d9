"""From mean speed alone, at the noise of a plain lab, nothing is named that something smooth explains as well."""

import numpy as np
import pytest
from worlds import BY_NAME, EFFECTS, hidden

from sandbot_lab.direct import direct_trials
from sandbot_lab.week import Week
from sandbot_lab.world import Noise, World
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery import judgement
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.smooth import smooth_gain
from sandbot_model.physics.observables import Observable
from sandbot_record.trials.table import Row, from_rows

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]
OTHERS = dict.fromkeys(("lift_m", "peak_speed_m_s", "first_step_m"), np.nan)
OUTSIDE = "x_traction_loss(loss=0.4)"


def cells(name, seed):
    effects = {one: dict(values) for one, values in BY_NAME[name].effects.items()}
    world = World(effects=effects, noise=Noise(speed_sd_m_s=0.008))
    rows = direct_trials(world, hidden.PHI, hidden.OMEGA, "UNIFORM", 3, seed)
    return cells_of(from_rows([Row(**{**row, **OTHERS}) for row in rows]))


def verdict(name, seed, only=EFFECTS):
    effects = {one: effect for one, effect in EFFECTS.items() if one in only}
    return discover(cells(name, seed), effects, max_effects=1).verdict


def test_a_ground_outside_the_catalogue_is_not_named():
    """The one effect that could pass for it is not what fits best."""
    found = verdict(OUTSIDE, 3)
    assert (found.status, found.effects) == ("unexplained", ())
    assert "dilation fits within the scatter of replicates" in found.because
    assert "but phi_dependent_response fits better still" in found.because


def test_nor_where_no_other_effect_is_known():
    found = verdict(OUTSIDE, 2, ("dilation",))
    assert (found.status, found.effects) == ("unexplained", ())
    assert "any smooth change of mean speed over φ and ω" in found.because
    assert "measure body lift" in found.because


@pytest.mark.whole
def test_it_would_be_named_if_nothing_smooth_were_thought_of(monkeypatch):
    monkeypatch.setattr(judgement, "refused_from_one_observable", lambda verdict, fits: None)
    assert verdict(OUTSIDE, 2, ("dilation",)).effects == ("dilation",)


def test_an_effect_that_is_there_is_still_in_the_set():
    assert ("exact_vertical_acceleration",) in verdict("exact_vertical_acceleration()", 1).alternatives


@pytest.mark.whole
def test_nothing_is_named_that_needs_a_bed_that_scatters_from_condition_to_condition():
    """An offset for each mean there is: with it belly_coast passes for ground that steps disturb."""
    effects = {name: EFFECTS[name] for name in ("disturbed_ground", "belly_coast")}
    week = Week(k_batch_sd=0.01)
    disturbed = World(effects={"disturbed_ground": {"k_l_n_per_m": 175.0, "s_c": 0.95}}, week=week)
    rows = direct_trials(disturbed, hidden.PHI, hidden.OMEGA, "UNIFORM", 3, 1, None, "randomised", "condition")
    seen = cells_of(from_rows([Row(**{**row, **OTHERS, "batch": "", "speed_sd_m_s": np.nan}) for row in rows]))
    found = discover(seen, effects, max_effects=1).verdict
    assert (found.status, found.effects) == ("unexplained", ())
    assert "would repair it, but only on a bed that scatters from condition to condition" in found.because


@pytest.mark.whole
def test_something_smooth_gains_where_there_is_something_and_little_where_there_is_nothing():
    there, nothing = (
        smooth_gain(discover(cells(name, 2), EFFECTS, max_effects=1).steps[0], Observable.speed)
        for name in (OUTSIDE, "null")
    )
    assert there > 30
    assert 0 <= nothing < 12
