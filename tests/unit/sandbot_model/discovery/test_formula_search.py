"""A formula picked from many speaks against a claim where it fits clearly better, the picking paid for."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from sandbot_model.discovery import discover, formula_search
from sandbot_model.discovery.criteria import DEFAULT
from sandbot_model.discovery.formula_search import outdone_by_a_formula
from sandbot_model.discovery.sharing import Shared
from sandbot_model.discovery.verdict import Verdict

CLAIM = Verdict("identified", ("a", "b"), (("a", "b"),), "")


def fit(*effects, bic):
    return SimpleNamespace(effects=effects, bic=bic, deviance=bic, goodness=SimpleNamespace(chi2=50.0, dof=60))


@pytest.mark.parametrize(("bic", "refused"), [(70.0, True), (80.0, False), (150.0, False)])
def test_a_claim_of_several_effects_that_a_formula_outdoes_is_refused(monkeypatch, bic, refused):
    asked = []

    def formula(_search, fit, _hopeless):
        asked.append(fit.effects)
        return SimpleNamespace(bic=bic, sentence="so much") if fit.effects else None

    monkeypatch.setattr(formula_search, "_on_top_of", formula)
    fits = [fit(bic=300.0), fit("a", bic=200.0), fit("b", bic=150.0), fit("c", bic=140.0), fit("a", "b", bic=100.0)]
    found = outdone_by_a_formula(SimpleNamespace(criteria=DEFAULT), CLAIM, {one.effects: one for one in fits})
    assert asked == [(), ("b",)]
    assert (found is not None) == refused
    assert found is None or (found.status == "unexplained" and "ΔBIC -30" in found.because)


@pytest.mark.parametrize(("status", "asked"), [("identified", True), ("ambiguous", True), ("partial", False)])
def test_whatever_claims_several_effects_is_held_against_a_formula(monkeypatch, status, asked):
    refused = Verdict("unexplained", (), (), "")
    monkeypatch.setattr(discover, "outdone_by_a_formula", lambda *_: refused)
    search = SimpleNamespace(fits={(): fit(bic=300.0)})
    monkeypatch.setattr(discover, "as_granted", lambda search, _: search.fits)
    found = Shared(replace(CLAIM, status=status), search.fits, search.fits[()])
    imitated = discover._imitated(search, found)
    assert (imitated is not None and imitated.verdict is refused) == asked
