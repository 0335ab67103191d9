"""What a design can find, and how often the verdict on it is right: against campaigns that are drawn and judged."""

import dataclasses
from collections import Counter

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.data.penetrometer import SCALE_SD, Readings
from sandbot_model.discovery import error_rates as module
from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.error_rates import Rate, error_rates, redrawn_readings, simulated
from sandbot_model.discovery.power import Detectable, detectable, expected, in_words
from sandbot_model.fitting.fit import fit
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_model.physics.observables import Observable

EFFECTS = catalogue()
OVERLAP = {"stance_overlap": EFFECTS["stance_overlap"]}
DEEPER = {"depth_nonlinearity": EFFECTS["depth_nonlinearity"]}
EXPONENT, D_R = 1.3, 0.039
PRESSED_PHI = np.repeat(np.linspace(0.58, 0.633, 4), 4)
PRESSED_M = np.tile([0.015, 0.025, 0.035, 0.044], 4)


def pressed(exponent=EXPONENT, sd=0.02, seed=1):
    """Readings of the ground of ``drawn``, four depths a level."""
    k = np.interp(PRESSED_PHI, [0.58, 0.6, 0.633], [170.0, 205.0, 220.0])
    force = k * D_R * (PRESSED_M / D_R) ** exponent
    noise = np.random.default_rng(seed).normal(size=len(force))
    return Readings(PRESSED_PHI, PRESSED_M, force * (1 + sd * noise), sd * force)


@pytest.fixture
def harder_below(drawn):
    """Trials in which nothing but a penetrometer shows the law of force."""
    return drawn(("depth_nonlinearity",), levels=4, values={"depth_nonlinearity": {"n": EXPONENT}})


def weakest(trials, effects=OVERLAP):
    base = expected(trials)
    return {one.effect: one.value for one in detectable(EffectSearch(base.cells, effects, "simple"), base)}


def test_replicates_show_weaker_effects(drawn):
    few, many = (weakest(drawn(levels=4, replicates=n))["stance_overlap"] for n in (2, 8))
    assert many < 0.75 * few


def test_nothing_is_expected_of_what_is_not_measured(drawn):
    trials = drawn(levels=4)
    without = dataclasses.replace(trials, lift_m=np.where(trials.omega_rad_s > 10, np.nan, trials.lift_m))
    cells = expected(without).cells
    assert np.isnan(cells.mean[:, Observable.lift]).tolist() == (cells.omega > 10).tolist()
    assert weakest(without)["stance_overlap"] > weakest(trials)["stance_overlap"]


@pytest.mark.slow
def test_at_that_strength_it_is_claimed_in_most_campaigns_and_far_below_in_none(drawn):
    eta = weakest(drawn(levels=4))["stance_overlap"]
    claimed = Counter()
    for seed in range(8):
        for strength in (0.2, 1.5):
            drawn_anew = drawn(
                ("stance_overlap",), seed=seed, levels=4, values={"stance_overlap": {"eta": strength * eta}}
            )
            search = EffectSearch(cells_of(drawn_anew), OVERLAP, "simple")
            search.run(1)
            gain = search.fits[()].deviance - search.fits[("stance_overlap",)].deviance
            claimed[strength] += gain > search.criteria.claim
    assert claimed[0.2] == 0
    assert claimed[1.5] >= 7


def test_readings_show_weaker_exponents_the_more_precise_they_are(drawn):
    """Of 2 % and of 0.2 %; what they say nothing of they leave as it was."""
    trials, found = drawn(levels=4), {}
    for sd in (0.02, 0.002):
        base = fit(model_of("simple", (), DEEPER | OVERLAP), cells_of(trials, pressed(1.0, sd)))
        search = EffectSearch(base.cells, DEEPER | OVERLAP, "simple")
        found[sd] = {one.effect: abs(one.value - (one.effect in DEEPER)) for one in detectable(search, base)}
    assert found[0.002]["depth_nonlinearity"] < 0.5 * found[0.02]["depth_nonlinearity"]
    assert found[0.002]["stance_overlap"] == pytest.approx(found[0.02]["stance_overlap"], rel=0.3)


def test_what_does_not_show_at_any_usual_strength_is_said():
    found = [Detectable("stance_overlap", "eta", "1", 0.0542), Detectable("added_mass", "c_g", "1", None)]
    said = (
        "would show in 90% of such campaigns from this strength on: stance_overlap.eta 0.0542; "
        "at no usual strength: added_mass"
    )
    assert in_words(found, ["stance_overlap", "added_mass"]) == said
    assert in_words(found, ["stance_overlap", "belly_coast", "added_mass", "finite_depth"]) == (
        f"{said}; not covered, as no value of a parameter makes them vanish: belly_coast, finite_depth"
    )


def test_a_rate_has_its_interval():
    """Clopper & Pearson 1934; 0 of 20 leaves up to 16.8 %."""
    assert Rate(0, 20).interval == pytest.approx((0.0, 0.16843), abs=1e-5)
    assert Rate(20, 20).interval == pytest.approx((0.83157, 1.0), abs=1e-5)
    assert str(Rate(19, 20)) == "19 of 20 (75 to 100 %)"


def test_a_simulated_campaign_is_the_fit_with_the_scatter_of_its_replicates(drawn):
    trials = drawn(levels=4)
    rows = trials.rows()
    rows[0] = dataclasses.replace(rows[0], lift_m=np.nan)
    trials = dataclasses.replace(trials, lift_m=np.array([row.lift_m for row in rows]))
    truth = fit(model_of("simple", (), OVERLAP), cells_of(trials))
    first, again, other = (simulated(trials, truth, np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.speed_m_s, again.speed_m_s)
    assert np.abs(first.speed_m_s - other.speed_m_s).max() > 0
    assert np.isnan(first.lift_m).tolist() == [True] + [False] * (len(trials) - 1)
    cells = cells_of(first)
    z = (cells.mean - truth.predicted)[:, Observable.speed] / cells.sem[:, Observable.speed]
    assert 0.6 < np.sqrt(np.mean(z**2)) < 1.5
    assert cells.noise[Observable.speed] == pytest.approx(truth.cells.noise[Observable.speed], rel=0.3)


@pytest.mark.slow
def test_verdicts_on_simulated_campaigns_are_counted(drawn):
    trials = drawn(("stance_overlap",), levels=4)
    cells = cells_of(trials)
    nothing, hidden = (
        error_rates(trials, fit(model_of("simple", names, OVERLAP), cells), OVERLAP, campaigns=2, max_effects=1)
        for names in ((), ("stance_overlap",))
    )
    assert (nothing.named.count, nothing.false_claims.count) == (2, 0)
    assert nothing.statuses == {"adequate": 2}
    assert hidden.statuses == {"identified": 2}
    assert str(hidden).startswith("with stance_overlap hidden: named in 2 of 2")
    assert hidden.to_dict()["named"] == {"count": 2, "of": 2, "at_95": pytest.approx((0.15811, 1.0), abs=1e-5)}


def test_readings_are_drawn_anew_from_the_truth_as_uncertain_as_they_were(harder_below):
    truth = fit(model_of("simple", ("depth_nonlinearity",), DEEPER), cells_of(harder_below, pressed()))
    first, again, other = (redrawn_readings(truth, np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.force_n, again.force_n)
    assert np.abs(first.force_n - other.force_n).min() > 0
    np.testing.assert_array_equal(first.phi, PRESSED_PHI)
    np.testing.assert_array_equal(first.depth_m, PRESSED_M)
    np.testing.assert_array_equal(first.force_sd_n, pressed().force_sd_n)
    many = np.array([redrawn_readings(truth, np.random.default_rng(seed)).force_n for seed in range(400)])
    said, _ = truth.press(first.phi, first.depth_m)
    z = (many - said) @ truth.cells.pressed.whiten.T
    assert np.abs(z.mean(axis=0)).max() < 0.3
    assert z.std() == pytest.approx(1.0, abs=0.05)
    # Each by its own error, and all by the scale of the gauge.
    assert np.std(many / said, axis=0) == pytest.approx(np.hypot(first.force_sd_n / said, SCALE_SD), rel=0.15)


def test_a_campaign_without_readings_has_none_drawn(drawn):
    truth = fit(model_of("simple", (), OVERLAP), cells_of(drawn(levels=4)))
    assert redrawn_readings(truth, np.random.default_rng(0)) is None


def test_simulated_campaigns_are_judged_with_readings_of_their_own(harder_below, monkeypatch):
    judged = []

    def discover(cells, *_args, **_options):
        judged.append(cells)
        raise StopIteration

    monkeypatch.setattr(module, "discover", discover)
    trials = harder_below
    plain, with_readings = (
        fit(model_of("simple", (), DEEPER), cells_of(trials, readings)) for readings in (None, pressed())
    )
    for truth in (plain, with_readings):
        with pytest.raises(StopIteration):
            error_rates(trials, truth, DEEPER, campaigns=1)
    assert judged[0].pressed is None
    assert judged[1].pressed.depth.tolist() == PRESSED_M.tolist()
    assert judged[1].pressed.level.tolist() == np.repeat(range(4), 4).tolist()
    assert np.abs(judged[1].pressed.force - pressed().force_n).min() > 0


@pytest.mark.slow
def test_what_readings_alone_show_is_found_in_simulated_campaigns(harder_below):
    cells = cells_of(harder_below, pressed())
    nothing, hidden = (
        error_rates(harder_below, fit(model_of("simple", names, DEEPER), cells), DEEPER, campaigns=2, max_effects=1)
        for names in ((), ("depth_nonlinearity",))
    )
    assert nothing.statuses == {"adequate": 2}
    assert hidden.statuses == {"identified": 2}
    assert hidden.named.count == 2
