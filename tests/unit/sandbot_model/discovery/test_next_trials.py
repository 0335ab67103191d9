"""What to measure next: what tells the surviving sets apart, and nothing where nothing does."""

import dataclasses
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import _drawn
from sandbot_common.robot import SANDBOT, Robot
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery import next_trials as module
from sandbot_model.discovery.compare import compare
from sandbot_model.discovery.criteria import DEFAULT
from sandbot_model.discovery.next_trials import (
    PENETRATION,
    NextTrial,
    Predicted,
    between,
    depths_m,
    next_trials,
    trials_to_exclude,
)
from sandbot_model.discovery.remarks import not_excluded
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.walking import Walker

HALF = Robot(
    leg_radius_m=0.01775, axle_height_m=0.0125, leg_width_m=0.006, mass_per_leg_kg=0.3835, stiffness_depth_m=0.0195
)
"""SandBot at half its size: its legs reach 2.3 cm deep."""


def test_next_trials_split_what_is_left(drawn):
    """Overlap and slip differ little in mean speed; other observables tell them apart."""
    cells = cells_of(drawn(("stance_overlap",), seed=6))
    overlap, slip = (compare(cells, catalogue(), [name])[-1] for name in ("stance_overlap", "leg_slip"))
    trials = next_trials([overlap, slip])
    assert len(trials) >= 3
    assert trials[0].expected_gap_sd >= trials[-1].expected_gap_sd > 0
    assert trials[0].separates == ("stance_overlap", "leg_slip")
    assert np.isfinite([trial.expected_gap_sd for trial in trials]).all()
    assert all(trial.replicates >= 2 for trial in trials)


def test_a_proposal_says_in_which_gait_it_is_meant(two_gaits):
    """Control: where the trials tell no gait it is the plan's."""
    base = compare(two_gaits.cells, catalogue()).fit
    (first, *_) = next_trials([two_gaits, base])
    assert first.gait == "SGCS"
    assert first.where.endswith("rad/s, SGCS")
    untold = [
        dataclasses.replace(one, cells=dataclasses.replace(one.cells, gait=("",) * len(one.cells)))
        for one in (two_gaits, base)
    ]
    (first, *_) = next_trials(untold)
    assert first.gait == ""
    assert first.where.endswith("rad/s")


def test_a_set_is_not_told_from_itself(drawn):
    fit = compare(cells_of(drawn(seed=6, levels=3)), catalogue()).fit
    assert next_trials([fit, fit]) == []
    assert next_trials([fit]) == []


def rivals(monkeypatch, between, trials=100):
    """Fits by name of so many trials, that differ by ``between(first name, second name)``."""
    monkeypatch.setattr(module, "between", between)
    monkeypatch.setattr(module.Predicted, "by", lambda fit: fit.effects[0])
    own = lambda first, second, chosen, *_: [one for one in chosen if one.separates == (first, second)]  # noqa: E731
    monkeypatch.setattr(module, "_after_refitting", own)
    return lambda names: [SimpleNamespace(effects=(name,), cells=SimpleNamespace(trials=trials)) for name in names]


def measured(pair, gap, omega=9.0):
    return NextTrial(0.6, omega, "speed", pair, gap, module.replicates_for(gap**2))


def reading(pair, gap, depth_m):
    return NextTrial(0.6, np.nan, PENETRATION, pair, gap, module.replicates_for(gap**2), depth_m)


def test_what_is_told_apart_already_is_worth_two_trials_and_no_more(monkeypatch):
    """Of three sets one differs from the others, by much in one place and by little elsewhere; two hardly do."""
    gaps = {("a", "b"): (50.0, 0.8), ("a", "c"): (50.0, 0.5), ("b", "c"): (0.4, 0.6)}

    def between(first, second):
        pair = first, second
        return [measured(pair, gap, omega) for omega, gap in zip((9.0, 12.0), gaps[pair], strict=True)]

    named = rivals(monkeypatch, between, trials=160)
    found = {trial.omega_rad_s: (trial.separates, trial.replicates) for trial in next_trials(named("abc"))}
    # The two at 9 rad/s count for the other pair, too: (25 - 2 * 0.4²) / 0.6².
    assert found == {9.0: (("a", "b"), 2), 12.0: (("b", "c"), 69)}
    assert [trial.omega_rad_s for trial in next_trials(named("ab"))] == [9.0]


@pytest.mark.parametrize(("gap", "replicates"), [(0.5, 20), (2.5, 2)])
def test_all_that_separate_a_pair_share_the_replicates_that_it_takes(monkeypatch, gap, replicates):
    """Five conditions of the same gap; where one alone is enough with two replicates, no other is proposed."""
    places = (6.0, 9.0, 12.0, 15.0, 18.0)
    named = rivals(monkeypatch, lambda *pair: [measured(pair, gap, omega) for omega in places])
    found = next_trials(named("ab"))
    assert {trial.replicates for trial in found} == {replicates}
    assert 25 <= sum(trial.replicates for trial in found) * gap**2 < 25 + 2 * gap**2 * len(found)


@pytest.mark.parametrize(("trials", "proposed"), [(100, 2), (99, 0)])
def test_what_would_take_more_replicates_than_there_are_trials_is_not_proposed(monkeypatch, trials, proposed):
    """Two conditions 0.5 standard deviations apart take 50 trials each, one alone 100."""
    at = [(0.5, 9.0), (0.5, 12.0)]
    named = rivals(monkeypatch, lambda *pair: [measured(pair, *one) for one in at], trials)
    assert len(next_trials(named("ab"))) == proposed
    base, *unseen = named(["base", "near", "far"])
    found, shown, out_of_reach = trials_to_exclude(base, unseen)
    assert len(found) == proposed
    assert list(shown) == (["near", "far"] if proposed else [])
    assert out_of_reach == ([] if proposed else ["near", "far"])


@pytest.mark.parametrize(
    ("shift_sd", "criteria", "replicates"),
    # The refit of a set whose parameter moves the predictions as the gap does, by so many times their noise. Controls:
    # that would cost the other data as much; who is content with a smaller gap is offered the trials.
    [(1.0, DEFAULT, None), (0.01, DEFAULT, 31), (0.25, DEFAULT, 70), (1.0, replace(DEFAULT, clearly=0.5), 93)],
)
def test_no_trial_is_proposed_whose_gap_a_refit_takes_up(monkeypatch, shift_sd, criteria, replicates):
    def predicted(name, speed):
        one = np.zeros((1, 1, 4))
        return Predicted(
            name=name,
            gait="UNIFORM",
            phi=np.array([0.6]),
            omega=np.array([9.0]),
            noise=np.full(4, 0.005),
            trials=one + np.array([speed, 0.0, 0.0, 0.0]),
            moves=one[None] + 0.005 * np.array([shift_sd, 0.0, 0.0, 0.0]),
            scatter=one,
            depth_m=np.array([0.02]),
            force=np.ones((1, 1)),
            force_sd=np.ones((1, 1)),
        )

    sets = {"a": predicted("a", 0.10), "b": predicted("b", 0.10 + 0.9 * 0.005)}
    monkeypatch.setattr(module.Predicted, "by", lambda fit: sets[fit.effects[0]])
    fits = [SimpleNamespace(effects=(name,), cells=SimpleNamespace(trials=100)) for name in sets]
    found = next_trials(fits, criteria)
    assert [trial.replicates for trial in found] == ([] if replicates is None else [pytest.approx(replicates, abs=3)])


def test_trials_that_would_exclude_effects_are_chosen_as_those_that_separate_sets_are(monkeypatch):
    """They share replicates, and no more than two readings are among them; a large gap leaves room for others."""

    def between(first, second):
        pair = first, second
        if second == "force":
            return [reading(pair, 10.0, depth_m) for depth_m in (0.01, 0.02, 0.03, 0.04)]
        return [measured(pair, 0.8, omega) for omega in (9.0, 12.0)] if second == "drag" else []

    base, *unseen = rivals(monkeypatch, between)(["base", "force", "drag", "absorbed"])
    found, _, out_of_reach = trials_to_exclude(base, unseen)
    assert sum(trial.kind == "reading" for trial in found) <= module.READINGS
    assert [trial.replicates for trial in found if trial.kind == "trial"] == [20, 20]
    assert out_of_reach == ["absorbed"]


def test_it_is_said_of_each_unseen_effect_which_trial_would_show_it(monkeypatch):
    """One trial shows two of them; of the one that it hardly shows nothing is said."""
    gaps = {"best": 9.0, "also": 6.0, "hardly": 0.4}
    base, *unseen = rivals(monkeypatch, lambda *pair: [measured(pair, gaps[pair[1]])], 1000)(["base", *gaps])
    proposed = trials_to_exclude(base, unseen)
    assert {trial.separates[1] for trial in proposed.trials} == {"best"}
    search = SimpleNamespace(cells=SimpleNamespace(trials=base.cells.trials), criteria=DEFAULT)
    said = not_excluded(list(gaps), proposed, search)
    assert f"(what would show best, also: {proposed.trials[0].observable} at {proposed.trials[0].where})" in said


@pytest.mark.parametrize(
    ("robot", "depth_m", "where"),
    [(SANDBOT, 0.044, "4.4 cm deep"), (HALF, 0.022, "2.2 cm deep")],
    ids=["SandBot", "half"],
)
def test_a_reading_is_proposed_where_the_legs_reach(robot, depth_m, where):
    trials = _drawn.drawn(Walker((), robot), [], np.linspace(0.58, 0.633, 4), (4, 8, 12, 16), 3, seed=6)
    fit = compare(cells_of(dataclasses.replace(trials, robot=robot)), catalogue()).fit
    first = Predicted.by(fit)
    other = dataclasses.replace(first, name="stiffer below", force=first.force * [1.0, 1.0, 1.0, 1.5])
    found = between(first, other)
    assert {trial.observable for trial in found} == {PENETRATION}
    assert {trial.depth_m for trial in found} == {depth_m}
    assert found[0].where == f"φ {found[0].phi:.3f}, {where}"
    np.testing.assert_allclose(first.force[0], fit.press(np.full(4, fit.level_phi[0]), first.depth_m)[0])


def test_depths_are_sandbots_own_and_a_share_of_what_others_reach():
    assert depths_m(SANDBOT).tolist() == [0.01, 0.02, 0.03, 0.044]
    assert depths_m(HALF).tolist() == [0.005, 0.01, 0.015, 0.022]
    for radius in (0.005, 0.012, 0.0549, 0.5):
        robot = Robot(leg_radius_m=radius, axle_height_m=0.7 * radius, leg_width_m=radius / 3)
        assert (np.diff([0.0, *depths_m(robot), 1.3 * radius]) > 0).all()


def test_depths_below_a_millimetre_apart_are_told_apart():
    trial = NextTrial(0.6, float("nan"), PENETRATION, ("a", "b"), 3.0, 2, 0.00348)
    assert trial.where == "φ 0.600, 0.35 cm deep"


def test_frequencies_as_measured_are_no_conditions_of_their_own(drawn):
    """An encoder reads each condition's ω a little otherwise; trials at 15.93 and 15.97 are one proposal."""
    trials = drawn(("stance_overlap",), seed=6)
    read = trials.omega_rad_s * (1 + 0.002 * np.random.default_rng(1).standard_normal(len(trials)))
    exact, measured = (
        Predicted.by(compare(cells_of(replace(trials, omega_rad_s=omega)), catalogue()).fit).omega
        for omega in (trials.omega_rad_s, read)
    )
    assert len(measured) == len(exact)
    assert measured == pytest.approx(exact, rel=0.003)
