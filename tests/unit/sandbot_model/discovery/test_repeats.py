"""What a verdict asks to be run again is proposed as a trial; where nothing is far off, nothing is."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery import repeats
from sandbot_model.discovery.criteria import DEFAULT
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.verdict import Verdict
from sandbot_model.physics.catalogue import catalogue

FEW = {name: catalogue()[name] for name in ("stance_overlap", "swimming_thrust")}
SLOW = 12.0


def off(trials, by_m):
    """The trials with the first steps of one condition off by ``by_m``."""
    there = (np.abs(trials.phi - trials.phi.max()) < 0.004) & (trials.omega_rad_s == SLOW)
    assert there.any()
    return replace(trials, first_step_m=np.where(there, trials.first_step_m + by_m, trials.first_step_m))


@pytest.mark.parametrize(("by_m", "asked"), [(0.007, True), (0.0, False)])
def test_a_condition_that_an_adequate_model_misses_by_more_than_chance_is_asked_for_again(drawn, by_m, asked):
    found = discover(cells_of(off(drawn(seed=5), by_m)), FEW, max_effects=1)
    assert found.verdict.status == "adequate"
    said = [remark for remark in found.verdict.remarks if remark.endswith("run that again")]
    again = [trial for trial in found.next_trials if trial.separates == repeats.SLIP_OR_MISS]
    assert len(said) == len(again) == asked
    for trial in again:
        assert said[0].startswith("first_step at φ 0.6")
        assert (trial.observable, trial.omega_rad_s, trial.replicates) == ("first_step", SLOW, 2)
        assert trial is found.next_trials[0]


def hand_made(*effects, first_cell, speed_m_s):
    """A fit to four cells, of which the first adds ``first_cell`` to the deviance."""
    deviance, predicted = np.array([first_cell, 1.0, 1.0, 1.0]), np.full((4, 4), 0.1)
    predicted[0, 0] = speed_m_s
    return SimpleNamespace(
        effects=effects,
        variants=(),
        at_bounds=(),
        implausible=(),
        deviance=deviance.sum(),
        bic=deviance.sum() + 5.0 * len(effects),
        lack_of_fit_p=0.5,
        goodness=SimpleNamespace(chi2=50.0, dof=60, lack_of_fit={"speed": 0.5}),
        parameters={"delta_t_s": (0.4, 0.01)},
        predicted=predicted,
        level_phi=np.array([0.6]),
        state=SimpleNamespace(cell_deviance=deviance[None], pressed=np.zeros((1, 0)), shared=np.zeros((1, 0))),
        cells=SimpleNamespace(
            pressed=None,
            pure_error_dof=np.full(4, 10_000),
            phi=np.full(4, 0.6),
            level=np.zeros(4, dtype=int),
            level_phi=np.array([0.6]),
            omega=np.array([8.0, 12.0, 16.0, 20.0]),
            gait=("SGCS",) * 4,
            mean=np.full((4, 4), 0.1),
            noise=np.full(4, 0.005),
            accuracy=None,
            trials=12,
        ),
    )


@pytest.mark.parametrize(("first_cell", "replicates"), [(61.0, [7]), (11.0, []), (1.0, [])])
def test_the_condition_on_which_a_claim_hangs_is_proposed(monkeypatch, first_cell, replicates):
    """Controls: too small a gain, and none, ask for nothing."""
    monkeypatch.setattr(repeats, "usual_noise", lambda _accuracy: np.full(4, 0.005))
    base, one = hand_made(first_cell=first_cell, speed_m_s=0.1), hand_made("a", first_cell=1.0, speed_m_s=0.11)
    proposed = repeats.decisive({(): base, ("a",): one}, Verdict("adequate", (), (), ""), DEFAULT)
    assert [trial.replicates for trial in proposed] == replicates
    for trial in proposed:
        assert (trial.phi, trial.omega_rad_s, trial.gait, trial.observable) == (0.6, 8.0, "SGCS", "speed")
        assert trial.separates == ("base", "a")
        assert trial.expected_gap_sd == pytest.approx(2.0)
