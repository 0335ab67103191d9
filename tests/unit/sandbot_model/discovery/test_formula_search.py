"""A formula picked from many speaks against a claim where it fits clearly better, the picking paid for."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from sandbot_model.discovery import discover, formula_search, judgement
from sandbot_model.discovery.criteria import DEFAULT
from sandbot_model.discovery.formula_search import outdone_by_a_formula, repairs_something
from sandbot_model.discovery.sharing import Judged
from sandbot_model.discovery.verdict import Verdict

CLAIM = Verdict("identified", ("a", "b"), (("a", "b"),), "")


def fit(*effects, bic, stage="strength", variants=()):
    model = SimpleNamespace(effects=[SimpleNamespace(stage=stage) for _ in effects])
    goodness = SimpleNamespace(chi2=50.0, dof=60)
    return SimpleNamespace(
        effects=effects, bic=bic, deviance=bic, goodness=goodness, model=model, variants=dict(variants)
    )


def hold_against(monkeypatch, bic, stage="speed"):
    """Let the best formula on top of anything have this BIC."""
    formula = SimpleNamespace(bic=bic, sentence="so much", leaves_nothing=True, stage=stage)
    monkeypatch.setattr(formula_search, "_on_top_of", lambda *_: formula)


@pytest.mark.parametrize(
    ("bic", "passes", "refused"), [(70.0, True, True), (70.0, False, False), (80.0, True, False), (150.0, True, False)]
)
def test_a_claim_of_several_effects_that_a_formula_outdoes_is_refused(monkeypatch, bic, passes, refused):
    """By one that leaves replicates nothing to explain, and fits clearly better."""
    asked = []

    def formula(_search, fit, _hopeless):
        asked.append(fit.effects)
        of = {"sentence": "so much", "stage": "speed", "leaves_nothing": passes}
        return SimpleNamespace(bic=bic, **of) if fit.effects else None

    monkeypatch.setattr(formula_search, "_on_top_of", formula)
    fits = [fit(bic=300.0), fit("a", bic=200.0), fit("b", bic=150.0), fit("c", bic=140.0), fit("a", "b", bic=100.0)]
    found = outdone_by_a_formula(SimpleNamespace(criteria=DEFAULT), CLAIM, {one.effects: one for one in fits})
    assert asked == [(), ("b",)]
    assert (found is not None) == refused
    assert found is None or (found[0].status == "unexplained" and "ΔBIC -30" in found[0].because)
    assert found is None or found[1].bic == bic


@pytest.mark.parametrize(
    ("elsewhere", "of_effect", "stage", "refused"),
    [
        (True, "strength", "speed", True),
        (True, "strength", "strength", False),
        (True, "step", "speed", False),
        (False, "strength", "strength", True),
    ],
)
def test_a_formula_on_the_stage_of_an_effect_is_another_form_of_it(monkeypatch, elsewhere, of_effect, stage, refused):
    """A motor that saturates beyond a knee is motor_saturation, although a formula on its clock fits far better."""
    hold_against(monkeypatch, 40.0, stage)
    fits = {(): fit(bic=300.0), ("a",): fit("a", bic=100.0, stage=of_effect)}
    claim = Verdict("identified", ("a",), (("a",),), "")
    found = outdone_by_a_formula(SimpleNamespace(criteria=DEFAULT), claim, fits, elsewhere=elsewhere)
    assert (found is not None) == refused


@pytest.mark.parametrize(("deviance", "asked"), [(90.0, True), (75.0, False)])
def test_one_effect_of_the_catalogue_is_held_against_a_formula_if_it_leaves_enough(held, deviance, asked):
    """Of 60 degrees of freedom; a formula, selected from many, must lead by 22."""
    one = Verdict("identified", ("a",), (("a",),), "")
    assert held(one, {("a",): fit("a", bic=deviance)}) == asked


@pytest.mark.parametrize(
    ("status", "variants", "asked"),
    [
        ("identified", {}, False),
        ("identified", {"a": "by a power of ω"}, True),
        ("ambiguous", {"a": "by a power of ω"}, True),
    ],
)
def test_an_effect_in_another_shape_is_held_against_a_formula(held, status, variants, asked):
    one = Verdict(status, ("a",), (("a",),), "")
    assert held(one, {("a",): fit("a", bic=50.0, variants=variants)}) == asked


@pytest.mark.parametrize(
    ("status", "asked"), [("identified", True), ("ambiguous", True), ("partial", False), ("unexplained", False)]
)
def test_whatever_claims_several_effects_is_held_against_a_formula(held, status, asked):
    assert held(replace(CLAIM, status=status), {("a", "b"): fit("a", "b", bic=50.0)}) == asked


@pytest.fixture
def held(monkeypatch):
    """Whether a verdict is refused, where a formula outdoes all that is asked about."""
    refused = Verdict("unexplained", (), (), "")
    monkeypatch.setattr(judgement, "outdone_by_a_formula", lambda *_, **__: (refused, "formula"))
    monkeypatch.setattr(judgement, "refitted_as_claimed", lambda search, _: search.fits)
    monkeypatch.setattr(judgement, "judge", lambda *_: CLAIM)

    def held(claim, fits):
        search = SimpleNamespace(fits={(): fit(bic=300.0)} | fits, criteria=DEFAULT)
        imitated = judgement._refused_for_a_formula(search, Judged(claim, search.fits, search.fits[()]))
        return imitated is not None and imitated.verdict is refused and imitated.formula == "formula"

    return held


@pytest.mark.parametrize(
    ("outdone", "said"), [(None, "partial"), ((Verdict("unexplained", (), (), ""), "formula"), None)]
)
def test_an_effect_that_repairs_most_is_not_named_where_a_formula_does_all(monkeypatch, outdone, said):
    monkeypatch.setattr(judgement, "outdone_by_a_formula", lambda *_: outdone)
    search = SimpleNamespace(fits={("a",): fit("a", bic=100.0)})
    found = judgement._unless_a_formula(search, (Verdict("partial", ("a",), (("a",),), ""), "what it repairs"))
    assert (found and found[0].verdict.status) == said


@pytest.mark.parametrize(("refused_for", "tried"), [("that of the refusal", "that of the refusal"), (None, "another")])
def test_the_formula_to_try_is_the_one_that_a_claim_was_refused_for(monkeypatch, refused_for, tried):
    """Else two formulas on two sets are told of one table."""
    monkeypatch.setattr(discover, "formula_to_try", lambda _search: "another")
    monkeypatch.setattr(discover, "repairs_something", lambda *_: True)
    assert discover._residual_formula(None, Verdict("unexplained", (), (), ""), refused_for) == tried


@pytest.mark.parametrize(
    ("deviance", "leaves_nothing", "proposed"),
    [((1415.0, 1209.0), False, False), ((1415.0, 700.0), False, True), ((190.0, 150.0), True, True)],
)
def test_a_formula_that_gains_what_the_best_of_many_gains_by_chance_is_not_proposed(deviance, leaves_nothing, proposed):
    """A misfit of 1209 on 124 degrees of freedom adds ten times as much by chance as replicates alone do."""
    base = SimpleNamespace(goodness=SimpleNamespace(dof=124))
    search = SimpleNamespace(fits={("a",): base}, criteria=DEFAULT)
    formula = SimpleNamespace(effects=("a",), deviance=deviance, leaves_nothing=leaves_nothing)
    assert repairs_something(search, formula) == proposed


@pytest.mark.parametrize("status", ["adequate", "identified", "ambiguous", "partial", "unexplained", "untested"])
def test_best_in_so_many_draws_is_said_only_of_what_is_named_as_the_best(monkeypatch, status):
    """What is partial is the best single effect; larger sets that nobody believes may be best in every draw."""
    monkeypatch.setattr(discover, "win_shares", lambda fits, *_, **__: [1.0] + [0.0] * (len(fits) - 1))
    monkeypatch.setattr(discover, "sound", lambda _fit: True)
    named = () if status in ("adequate", "unexplained", "untested") else ("a",)
    verdict = Verdict(status, named, (named,) if named else (), "")
    share = discover._stability({(): fit(bic=2.0), ("a",): fit("a", bic=1.0)}, [], verdict, DEFAULT)
    assert (share >= 0.0) == (status in ("adequate", "identified", "ambiguous"))
