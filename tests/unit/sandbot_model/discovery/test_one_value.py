"""One ω can't test Δt, nor one φ what depends on it: trials at others are proposed, and they do."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

import _drawn
from sandbot_common.robot import SANDBOT
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery import one_value
from sandbot_model.discovery.compare import compare
from sandbot_model.discovery.criteria import DEFAULT
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.next_trials import Proposed
from sandbot_model.discovery.remarks import not_excluded
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.walking import Walker
from sandbot_record.trials.table import from_rows

EXACT = "exact_vertical_acceleration"
FEW = {name: effect for name, effect in catalogue().items() if name in (EXACT, "stance_overlap")}
FIVE = np.linspace(0.59, 0.633, 5)


def trials(hidden, phi, omega, seed=6):
    effects = [catalogue()[name] for name in hidden]
    values = [{one.name: one.start for one in effect.parameters} for effect in effects]
    return _drawn.drawn(Walker(tuple(effects)), values, phi, omega, 3, seed=seed)


@pytest.mark.parametrize(
    ("phi", "omega", "alone", "said"),
    [
        (FIVE, (16.0,), ["ω"], "trials at one ω can't test Δt: run others (next trials)"),
        ((0.61,), (4.0, 8.0, 12.0), ["φ"], "trials at one φ can't test what depends on φ: run others (next trials)"),
        (FIVE, (8.0, 16.0), [], ""),
    ],
)
def test_only_a_single_value_is_widened(phi, omega, alone, said):
    base = compare(cells_of(trials((), phi, omega)), catalogue()).fit
    assert one_value.single(base.cells) == alone
    assert one_value.in_words(base.cells) == said
    proposed = one_value.what_to_add(base)
    assert len(proposed) == (6 if alone else 0)
    run = set(zip(base.cells.phi.tolist(), base.cells.omega.tolist(), strict=True))
    assert not run & {(one.phi, one.omega_rad_s) for one in proposed}
    for one in proposed:
        assert 0.58 <= one.phi <= 0.633
        assert 4.0 <= one.omega_rad_s <= 28.0
        assert base.predict(one.phi, one.omega_rad_s).walking.all()


@pytest.mark.parametrize("hidden", [(), (EXACT,)])
def test_what_one_omega_can_not_test_is_tested_with_the_trials_proposed(hidden):
    narrow = trials(hidden, FIVE, (16.0,))
    before = discover(cells_of(narrow), FEW, max_effects=1)
    assert before.verdict.status == "adequate"
    assert EXACT in before.unseen
    assert "trials at one ω can't test Δt" in before.verdict.because
    rows = narrow.rows()
    for number, one in enumerate(one for one in before.next_trials if one.kind == "trial"):
        more = trials(hidden, (one.phi,), (one.omega_rad_s,), seed=20 + number).rows()
        rows += [dataclasses.replace(row, trial_id=f"{number}_{row.trial_id}") for row in more]
    after = discover(cells_of(from_rows(rows)), FEW, max_effects=1)
    assert after.verdict.effects == hidden
    assert EXACT not in after.unseen
    assert "one ω" not in after.verdict.because


@pytest.mark.parametrize(("omega", "where"), [((16.0,), "at one ω"), ((8.0, 16.0), "like these")])
def test_what_is_out_of_reach_is_so_at_the_one_omega(omega, where):
    search = SimpleNamespace(cells=cells_of(trials((), FIVE, omega)), criteria=DEFAULT)
    assert f" more trials {where}: a" in not_excluded(["a"], Proposed([], {}, ["a"]), search)


def test_another_robot_is_run_at_the_same_froude_numbers():
    assert one_value.usual_omega(SANDBOT) == pytest.approx((4.0, 28.0))
    large = dataclasses.replace(SANDBOT, leg_radius_m=4 * SANDBOT.leg_radius_m)
    assert one_value.usual_omega(large) == pytest.approx((2.0, 14.0))
