"""The rules of the verdict on hand-made fits: deviance, χ² and p are given, nothing is fitted."""

from types import SimpleNamespace

import numpy as np
import pytest

from sandbot_model.data.conditions import Cells
from sandbot_model.discovery import verdict
from sandbot_model.discovery.candidates import what_it_lacks
from sandbot_model.discovery.criteria import Criteria
from sandbot_model.discovery.verdict import (
    Verdict,
    claim_threshold,
    earns_place,
    judge,
    look_alikes,
    next_best,
    overdispersion,
    p_of_test,
    passes,
    with_p_of,
)
from sandbot_model.fitting.goodness import Estimate

CELLS = 20


def made(
    *effects,
    deviance,
    p=0.5,
    one_cell=0.0,
    at_bounds=(),
    each=None,
    replicates=10_000,
    delta_t=(0.4, 0.01),
    held=False,
    variants=(),
    implausible=(),
):
    """A fit whose cells miss alike, but for the first, which misses by ``one_cell`` more."""
    parts = np.full(CELLS, (deviance - one_cell) / CELLS)
    parts[0] += one_cell
    return SimpleNamespace(
        model=SimpleNamespace(
            base="simple",
            held={"delta_t_s": delta_t[0]} if held else {},
            names=("delta_t_s", "v_swim_m_s"),
            parameters=(SimpleNamespace(low=0.1, high=1.2), SimpleNamespace(low=0.0, high=0.05)),
        ),
        effects=effects,
        variants=dict.fromkeys(variants, "another"),
        deviance=deviance,
        bic=deviance + 5.0 * len(effects),
        lack_of_fit_p=p,
        goodness=SimpleNamespace(chi2=50.0, dof=60, lack_of_fit=each or {"speed": p}, lack_of_fit_f=1.28),
        at_bounds=at_bounds,
        parameters={"delta_t_s": Estimate(*delta_t), "v_swim_m_s": Estimate(0.075, 0.001)},
        implausible=implausible,
        fails=(),
        level_phi=np.array([0.6]),
        cells=SimpleNamespace(
            pressed=None,
            pure_error_dof=np.full(4, replicates),
            scatter="the scatter of replicates",
            phi=np.full(CELLS, 0.604),
            level_phi=np.array([0.6]),
            level=np.zeros(CELLS, dtype=int),
            omega=np.full(CELLS, 8.0),
        ),
        state=SimpleNamespace(cell_deviance=parts[None], pressed=np.zeros((1, 0)), shared=np.zeros((1, 0))),
    )


def judged(*fits, criteria=None):
    return judge({fit.effects: fit for fit in fits}, criteria or Criteria())


BASE = made(deviance=300.0, p=1e-9)


def test_the_p_that_is_given_is_the_one_that_failed():
    each = {"speed": 9.9e-5, "lift": 0.2}
    assert p_of_test(made(deviance=60.0, p=0.38, each=each)) == "lack of fit of speed p = 9.9e-05, of all together 0.38"
    assert p_of_test(made(deviance=60.0, p=1e-9, each=each)) == "lack of fit p = 1e-09"
    assert p_of_test(made(deviance=60.0, p=0.38)) == "lack of fit p = 0.38"


def test_nothing_missing_is_adequate_unless_an_effect_earns_its_claim():
    fits = made(deviance=60.0), made("a", deviance=50.0)
    assert judged(*fits).status == "adequate"
    assert judged(fits[0], made("a", deviance=30.0)).status == "identified"
    assert judged(*fits, criteria=Criteria(claim=5.0)).effects == ("a",)


def test_the_one_set_that_repairs_the_model_is_identified():
    found = judged(BASE, made("a", deviance=60.0), made("b", deviance=290.0, p=1e-8))
    assert (found.status, found.effects, found.alternatives) == ("identified", ("a",), (("a",),))
    assert "what remains is within the scatter of replicates" in found.because


def test_the_next_best_is_the_best_of_all_that_was_fitted_and_said_to_look_the_same_if_it_does():
    best, b = made("a", deviance=60.0), made("b", deviance=290.0, p=1e-8)
    fits = {fit.effects: fit for fit in (BASE, best, b)}
    assert next_best(fits, best) == "the next best, b, has ΔBIC 230"
    tried = [made("c", deviance=62.0, variants=("c",)), made("a", deviance=55.0, variants=("a",))]
    form = f"its form selected from {verdict.CONVENTION_COUNT}"
    said = f"the next best, c (another), has ΔBIC 2 ({form}); it fits about as well"
    assert next_best(fits, best, tried) == said
    # Neither is what is clearly worse, shows a lack of fit, or has implausible values.
    assert next_best(fits, best, [made("c", deviance=80.0)]) == "the next best, c, has ΔBIC 20"
    assert next_best(fits, best, [made("c", deviance=62.0, p=1e-4)]) == "the next best, c, has ΔBIC 2"
    assert next_best(fits, best, [made("c", deviance=62.0, at_bounds=("c.x",))]) == next_best(fits, best)


def test_a_better_fit_that_nobody_believes_is_said_beside_the_next_best():
    best, b = made("a", deviance=60.0), made("b", deviance=290.0, p=1e-8)
    fits = {fit.effects: fit for fit in (BASE, best, b, made("c", deviance=55.0, at_bounds=("c.x",)))}
    assert next_best(fits, best) == "the next best, b, has ΔBIC 230 (c -5, but with c.x at or beyond its bound)"


def test_where_cells_scatter_about_a_claim_more_must_be_clearly_worse():
    scattered = made("a", deviance=60.0)
    scattered.goodness.chi2 = 2.0 * scattered.goodness.dof
    others = [made("b", deviance=75.0), made("c", deviance=85.0)]
    for best, alike in ((made("a", deviance=60.0), []), (scattered, ["b"])):
        fits = {fit.effects: fit for fit in (BASE, best, *others)}
        assert [fit.effects[0] for fit in look_alikes(fits, best, (), Criteria())] == alike
    assert claim_threshold(scattered) == pytest.approx(2.0 * claim_threshold(made("a", deviance=60.0)))
    scattered.goodness.dof = 0
    assert overdispersion(scattered) == 1.0


def test_two_effects_that_come_together_must_gain_as_two():
    fits = {(): made(deviance=100.0), ("a", "b"): made("a", "b", deviance=65.0)}
    assert not earns_place(fits, ("a", "b"), ())
    assert earns_place({**fits, (): made(deviance=115.0)}, ("a", "b"), ())


def test_two_that_repair_it_alike_are_ambiguous_and_one_clearly_worse_is_not_among_them():
    fits = BASE, made("a", deviance=60.0), made("b", deviance=65.0), made("c", deviance=80.0)
    found = judged(*fits)
    assert (found.status, found.alternatives) == ("ambiguous", (("a",), ("b",)))
    assert judged(*fits, criteria=Criteria(clearly=3.0)).status == "identified"


@pytest.mark.parametrize(("deviance", "sets"), [(60.4, (("a",), ("b",))), (69.0, (("a",), ("b",))), (71.0, (("a",),))])
def test_what_is_not_clearly_worse_is_in_the_set_on_whichever_side_of_a_price_it_falls(deviance, sets):
    fits = made(deviance=300.0, one_cell=228.2, p=1e-9), made("a", deviance=60.0), made("b", deviance=deviance)
    by_name = {fit.effects: fit for fit in fits}
    assert [earns_place(by_name, name, ()) for name in (("a",), ("b",))] == [True, False]
    assert judged(*fits).alternatives == sets


@pytest.mark.parametrize(
    ("picked", "lead", "sets"), [(("a",), 15.0, 2), ((), 15.0, 1), (("a",), 25.0, 1), (("a", "b"), 15.0, 1)]
)
def test_a_formula_picked_from_all_conventions_pays_for_that(picked, lead, sets):
    """With controls: the catalogue's own pays nothing, a lead beyond the price counts, two picked pay alike."""
    base = made(deviance=900.0, p=0.0)
    one, other = (
        made(name, deviance=at, variants={name} & set(picked)) for name, at in (("a", 50.0), ("b", 50.0 + lead))
    )
    found = judged(base, one, other)
    assert found.effects == ("a",)
    assert len(found.alternatives) == sets
    assert ("selected from" in found.because) == (sets == 2)


def test_what_no_set_repairs_is_unexplained(monkeypatch):
    monkeypatch.setattr(verdict, "stage_tests", lambda _fit: ())
    found = judged(BASE, made("a", deviance=200.0, p=1e-6))
    assert (found.status, found.effects) == ("unexplained", ())
    assert "the best set, a, still fails" in found.because


def test_where_an_unexplained_model_fails_is_named_by_its_worst_mean_and_stage(monkeypatch):
    stages = [SimpleNamespace(missed=True, p=1e-3, stage="step", connects="a to b"),
              SimpleNamespace(missed=True, p=1e-6, stage="speed", connects="step to speed"),
              SimpleNamespace(missed=False, p=1e-9, stage="depth", connects="k to lift")]  # fmt: skip
    monkeypatch.setattr(verdict, "stage_tests", lambda _fit: stages)
    base = made(deviance=300.0, p=1e-9)
    base.fails = [SimpleNamespace(observable="speed", cell=0, omega_rad_s=8.0, z=-9.0)] * 2
    assert judged(base).because.endswith(
        "; 2 cell means are still missed, the worst speed at φ 0.600, ω 8 rad/s by 9.0 standard errors"
        "; in the chain, speed (step to speed) fails most, p = 1e-06"
    )


def test_an_adequate_model_is_measured_against_what_was_given_as_error():
    base = made(deviance=60.0)
    assert "misses the cell means by no more than the scatter of replicates" in judged(base).because
    base.cells.scatter = Cells.scatter.fget(SimpleNamespace(error_bars=True))
    assert "misses the cell means by no more than the error bars" in judged(base).because


@pytest.mark.parametrize(
    ("base", "why"),
    [
        (made(deviance=70.0, p=1e-9), "but gains 10, less than the 22 that an effect must: the base model still fails"),
        (made(deviance=300.0, one_cell=240.0, p=1e-9), "but 100% of what it gains is at φ 0.600, ω 8 rad/s: run that"),
    ],
)
def test_why_what_would_leave_nothing_is_not_named(monkeypatch, base, why):
    monkeypatch.setattr(verdict, "stage_tests", lambda _fit: ())
    found = judged(base, made("a", deviance=60.0))
    assert (found.status, found.effects) == ("unexplained", ())
    assert found.because.startswith("a would fit within the scatter of replicates (lack of fit p = 0.5), " + why)


@pytest.mark.parametrize(
    ("gain", "said"),
    [
        (21.6, "gains 21.6, less than the 22.0 that"),
        (21.2, "gains 21, less than the 22 that"),
        (21.96, "gains 21.96, less than the 22.01 that"),
    ],
)
def test_a_gain_just_below_what_is_needed_is_given_with_the_digits_that_show_it(monkeypatch, gain, said):
    monkeypatch.setattr(verdict, "stage_tests", lambda _fit: ())
    monkeypatch.setattr(verdict, "overdispersion", lambda _fit: 1.0)
    base = made(deviance=60.0 + gain, p=1e-9)
    assert said in judged(base, made("a", deviance=60.0)).because


@pytest.mark.parametrize(
    ("gain", "more", "said"),
    [
        (19.0, {}, "a gains 19, less than the 22 that an effect must"),
        # Controls: it does not outweigh the base model; it gains enough; nobody would believe it.
        (4.0, {}, ""),
        (40.0, {}, ""),
        (19.0, {"at_bounds": ("a.x",)}, ""),
    ],
)
def test_what_outweighs_an_adequate_model_says_what_it_lacks(gain, more, said):
    fits = (made(deviance=60.0), made("a", deviance=60.0 - gain, **more), made("b", deviance=59.0))
    assert what_it_lacks({fit.effects: fit for fit in fits}, Criteria()) == said


def test_where_nothing_can_be_tested_nothing_is_claimed():
    found = judged(made(deviance=60.0, p=np.nan))
    assert (found.status, found.effects) == ("untested", ())


def test_one_odd_cell_buys_no_effect():
    base = made(deviance=300.0, one_cell=240.0)
    fits = {(): base, ("a",): made("a", deviance=60.0)}
    assert not earns_place(fits, ("a",), ())
    assert earns_place({**fits, (): BASE}, ("a",), ())


def test_a_parameter_at_its_bound_passes_nothing():
    assert passes(made("a", deviance=60.0))
    assert not passes(made("a", deviance=60.0, at_bounds=("a.x",)))
    assert passes(made("a", deviance=60.0, at_bounds=("v_swim_m_s",)))


def test_a_model_that_passes_is_not_adequate_where_a_number_nobody_believes_repairs_much(monkeypatch):
    monkeypatch.setattr(verdict, "stage_tests", lambda _fit: ())
    monkeypatch.setattr(verdict, "only_with", lambda _fit: "only with a.x")
    base, little = made(deviance=200.0), made("a", deviance=185.0, at_bounds=("a.x",))
    assert judged(base, little).status == "adequate"
    assert judged(base, made("a", deviance=60.0, at_bounds=("a.x",))).status == "unexplained"


def test_an_effect_that_needs_an_impossible_response_time_is_none():
    """Unless the data do not say what it is."""
    assert not passes(made("a", deviance=60.0, at_bounds=("delta_t_s",), delta_t=(1.75, 0.4)))
    assert passes(made("a", deviance=60.0, at_bounds=("delta_t_s",), delta_t=(1.75, 1.5)))
    assert passes(made(deviance=60.0, at_bounds=("delta_t_s",), delta_t=(1.75, 0.4)))


MANY = ("delta_t_s", "v_swim_m_s")
BOTH = "but only with delta_t_s = 1.75 (plausible: 0.1 to 1.2) and v_swim_m_s = 0.075 (plausible: 0 to 0.05)"


def test_a_base_model_that_needs_numbers_nobody_believes_says_so_once():
    plain, strange = (made(deviance=60.0, delta_t=(1.75, 0.02), implausible=names) for names in ((), MANY))
    assert judged(plain).because.endswith("the scatter of replicates (lack of fit p = 0.5)")
    assert judged(strange).because.endswith(f"the scatter of replicates (lack of fit p = 0.5), {BOTH}")
    assert judged(strange).status == "adequate"


@pytest.mark.parametrize(("p", "by"), [(0.5, "no more than the scatter"), (0.01, "more than the scatter")])
def test_a_misfit_that_a_reader_takes_for_real_is_not_called_none(p, by):
    because = judged(made(deviance=60.0, p=p)).because
    assert f"misses the cell means by {by} of replicates" in because
    assert ("too little to reject it" in because) == (p == 0.01)


def test_remarks_come_after_the_statistics_in_one_sentence():
    found = Verdict("adequate", (), (), "p = 0.5").with_remarks("", "check the zero").with_remarks("run 3 more")
    assert found.because == "p = 0.5; check the zero; run 3 more"
    assert (found.statistics, found.remarks) == ("p = 0.5", ("check the zero", "run 3 more"))
    assert Verdict("adequate", (), (), "p = 0.5").with_remarks("").statistics == "p = 0.5"


@pytest.mark.parametrize("rivals", [(), (made("b", deviance=61.0),)])
def test_a_claim_says_why_a_base_model_that_passes_is_not_enough(rivals):
    strange = made(deviance=200.0, delta_t=(1.75, 0.02), implausible=MANY)
    because = judged(strange, made("a", deviance=60.0), *rivals).because
    assert because.startswith("the simple model misses the cell means by no more than the scatter of replicates")
    assert f"{BOTH}; with a the deviance falls from 200 to 60" in because
    assert because.count("deviance falls") == 1
    # One that fails needs no other reason.
    assert "the simple model" not in judged(BASE, made("a", deviance=60.0), *rivals).because


@pytest.mark.parametrize(
    ("deviance", "said"),
    [
        (120.0, "(lack of fit p = 0.5), by the misfit alone: F = 1.28 on 60 and 10000 degrees of freedom"),
        # Control: by the deviance a reader finds no misfit either.
        (60.0, "the scatter of replicates (lack of fit p = 0.5)"),
    ],
)
def test_a_p_that_the_deviance_seems_to_contradict_comes_with_its_statistic(deviance, said):
    base, claimed, deeper = BASE, made("a", deviance=deviance), made("a", deviance=deviance, p=0.6)
    found = judged(base, claimed)
    assert (found.status, found.because.endswith(said)) == ("identified", True)
    deeper.goodness.lack_of_fit_f = 1.2
    told = with_p_of(deeper, found, claimed).because
    assert told.endswith(said.replace("0.5", "0.6").replace("1.28", "1.20"))


def test_a_single_observable_can_refuse_a_model():
    assert not passes(made(deviance=60.0, each={"speed": 0.5, "lift": 1e-4}))
    assert passes(made(deviance=60.0, each={"speed": 0.5, "lift": np.nan}))


def test_with_few_replicates_a_claim_takes_more():
    many, few = (claim_threshold(made(deviance=60.0, replicates=n)) for n in (10_000, 2))
    assert many == pytest.approx(22.0, rel=1e-2)
    assert few > 2 * many


def test_where_delta_t_had_to_be_held_what_fits_as_well_speaks_against_a_claim():
    """Whatever it is: something else pulls at Δt."""
    rival = made("b", deviance=61.0, at_bounds=("b.x",))
    found = judged(BASE, made("a", deviance=60.0, held=True), rival)
    assert found.status == "unexplained"
    assert "b fits as well (ΔBIC 1), though with b.x at or beyond" in found.because
    assert judged(BASE, made("a", deviance=60.0), rival).status == "identified"
    assert judged(BASE, made("a", deviance=60.0, held=True), made("b", deviance=290.0, p=1e-8)).status == "identified"
