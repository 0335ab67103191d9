"""What a design can find, and how often the verdict on it is right: against campaigns that are drawn and judged."""

import dataclasses
from collections import Counter

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.error_rates import Rate, error_rates, simulated
from sandbot_model.discovery.power import Detectable, detectable, expected, in_words
from sandbot_model.fitting.fit import fit
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_model.physics.observables import Observable

EFFECTS = catalogue()
OVERLAP = {"stance_overlap": EFFECTS["stance_overlap"]}


def weakest(trials, effects=OVERLAP):
    base = expected(trials)
    return {one.effect: one.value for one in detectable(EffectSearch(base.cells, effects, "simple"), base)}


def test_replicates_show_weaker_effects(drawn):
    few, many = (weakest(drawn(levels=4, replicates=n))["stance_overlap"] for n in (2, 8))
    assert many < 0.75 * few


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


def test_what_does_not_show_at_any_usual_strength_is_said():
    found = [Detectable("stance_overlap", "eta", "1", 0.0542), Detectable("added_mass", "c_g", "1", None)]
    assert in_words(found) == (
        "would show in 90% of such campaigns from this strength on: stance_overlap.eta 0.0542; "
        "at no usual strength: added_mass"
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
