"""A user's effect that gives no number at a cell is refused before a fit; the project's own all give one."""

import numpy as np
import pytest

from sandbot_common.errors import InputError
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.fitting import finite
from sandbot_model.fitting.finite import check_finite
from sandbot_model.fitting.fit import fit
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.model import model_of
from sandbot_model.physics.variants import variants_of
from sandbot_model.physics.walking import BASES

EFFECTS = {effect.identifier: effect for effect in CATALOGUE}


@pytest.fixture(scope="module")
def cells(drawn):
    """ω from 4 rad/s on."""
    return cells_of(drawn(levels=3))


def with_formulas(*texts, base="simple"):
    effects = catalogue(formulas=texts)
    return model_of(base, [name for name in effects if name not in EFFECTS], effects)


NONE = {
    "x: strength: k *= 1 - a*sqrt(omega - 7)/4; a in 0..0.5": "its parameters start",
    "x: step: s *= 1 - a*sqrt(omega - 7)/4; a in 0..0.5": "its parameters start",
    "x: speed: kept *= 1 - sqrt(a)/4; a in -0.1..0.5": "x.a is -0.1",
    "x: speed: kept *= 1 - log(1.1 - a)/9; a in 0..1.1": "x.a is 1.1",
    "x: speed: kept *= 1 - first*sqrt(omega - 7)/40": "its parameters start",
    "x: speed: kept *= 1 - a**9; a in 0..1e30": "its parameters start",
    "x: speed: v_swim = 0.1/(omega - 4)": "its parameters start",
}


@pytest.mark.parametrize("text", NONE)
def test_an_effect_that_gives_not_finite_is_refused_with_where(cells, text):
    with pytest.raises(InputError) as raised:
        fit(with_formulas(text), cells)
    said = str(raised.value)
    assert said.startswith(f"effect x: gives no number at φ {cells.level_phi[0]:.4g} and ω 4 rad/s where ")
    assert f"where {NONE[text]}; keep roots" in said
    assert "\n" not in said


def test_a_search_refuses_it_before_anything_is_fitted(cells):
    with pytest.raises(InputError, match="effect x: gives no number at"):
        EffectSearch(cells, catalogue(formulas=[next(iter(NONE))]), "simple")


@pytest.mark.parametrize(
    "text",
    [
        "x: strength: k *= 1 - a*sqrt(maximum(omega - 7, 0))/4; a in 0..0.5",
        "x: step: s, peak *= clip(1 - sigma*(d_r/d)^2, 0, 1); sigma [1] in 0..0.2",
        "x: strength: k*(d/d_r)^(n - 1); n in 0.5..1.5",
        "x: step: s *= 1 - c/(chord + c); c [m] in 0..0.01",
        "x: strength: k -> K(phi + c); c in -0.02..0.02",
    ],
)
def test_one_that_gives_numbers_is_not(cells, text):
    check_finite(with_formulas(text), cells)


@pytest.mark.parametrize("base", BASES)
def test_the_project_s_own_effects_give_numbers_in_all_conventions_and_are_not_tried(cells, base, monkeypatch):
    some = [name for name in EFFECTS if name not in BASES[base]]
    models = [
        model_of(base, [name], {**EFFECTS, name: effect})
        for name in some
        for effect in (EFFECTS[name], *variants_of(EFFECTS[name]))
    ]
    starts = [np.array([[one.start for one in model.parameters]]) for model in models]
    assert not any(finite._not_finite(model, cells, theta).any() for model, theta in zip(models, starts, strict=True))
    monkeypatch.setattr(finite, "_not_finite", None)
    for model in models:
        check_finite(model, cells)


def test_the_one_of_several_that_a_parameter_belongs_to_is_named(cells):
    texts = ("y: speed: kept *= 1 - b; b in 0..0.2", "x: speed: kept *= 1 - sqrt(a)/4; a in -0.1..0.5")
    with pytest.raises(InputError, match=r"effect x: gives no number at .* where x.a is -0.1"):
        check_finite(with_formulas(*texts), cells)


RAISES = """
import numpy as np
from sandbot_model import Effect

class Boom(Effect):
    identifier, stage, formula, source, seen_in = "boom", "speed", "v", "-", "v"

    def apply(self, chain, p):
        if np.any(chain.omega == {omega}):
            raise RuntimeError("no such\\nground")
        chain.kept = chain.kept * 0.9
"""


def test_an_effect_that_raises_at_the_conditions_of_the_trials_is_refused(cells, tmp_path):
    path = tmp_path / "boom.py"
    path.write_text(RAISES.format(omega=16.0))
    with pytest.raises(InputError) as raised:
        EffectSearch(cells, catalogue([path]), "simple")
    assert str(raised.value) == ("effect boom: fails at the conditions of these trials: RuntimeError: no such ground")
    # Control: trials at no such ω.
    path.write_text(RAISES.format(omega=17.0))
    assert "boom" in EffectSearch(cells, catalogue([path]), "simple").names
