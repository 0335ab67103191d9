"""What the model misses where nothing of the catalogue fits: planted → described, at its stage; not planted → not."""

from dataclasses import replace

import numpy as np
import pytest

from _drawn import drawn as drawn_by
from sandbot_common.parallel import Processes
from sandbot_common.robot import Robot
from sandbot_model.data.conditions import cells_of, noise_floor
from sandbot_model.discovery.compare import compare
from sandbot_model.discovery.criteria import DEFAULT
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.residual import SuggestedFormula, _fit_guesses, _score, suggest_formula
from sandbot_model.discovery.scored_terms import guesses
from sandbot_model.discovery.term_library import terms
from sandbot_model.fitting.fit import fit
from sandbot_model.fitting.plain import plain
from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.model import model_of
from sandbot_model.physics.walking import Inputs, Walker

EFFECTS = {effect.identifier: effect for effect in CATALOGUE}


def base_fit(trials):
    return fit(model_of("simple", (), EFFECTS), cells_of(trials))


PLANTED = [
    (
        "hidden: speed: kept, peak_ratio *= 1 - a*where(omega > 14, 1, 0); a [1] in 0.1..0.3",
        ("speed", "the speed at every moment of a step", "above ω = 14 rad/s"),
    ),
    (
        "hidden: speed: kept *= 1 - a*R*omega**2/g; a [1] in 0.03..0.06",
        ("speed", "the advance, but not the peak speed,", "Rω²/g"),
    ),
    (
        "hidden: step: peak_ratio *= 1 - a*maximum(0.633 - phi, 0); a [1] in 2..4",
        ("speed", "the peak of v_x(t), not its mean,", "below φ = 0.63"),
    ),
    (
        "hidden: strength: k *= 1 + a*first; a [1] in 0.1..0.2",
        ("strength", "in the first step the stiffness of the ground", "everywhere"),
    ),
    (
        "hidden: strength: k *= 1 - a*where(omega > 10, 1, 0); a [1] in 0.05..0.1",
        ("strength", "the stiffness of the ground", "above ω = 10 rad/s"),
    ),
    (
        "hidden: clock: omega *= 1 - a*exp(-((omega - 16)/3)**2); a [1] in 0.1..0.2",
        ("clock", "the leg frequency", "in a band about ω = 16 rad/s"),
    ),
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("formula", "said"), [*PLANTED[:3], *(pytest.param(*one, marks=pytest.mark.whole) for one in PLANTED[3:])]
)
def test_what_is_planted_is_described_at_its_stage_and_repaired(drawn, formula, said):
    trials = drawn(seed=3, formulas=[formula])
    cells = cells_of(trials)
    found = suggest_formula(base_fit(trials), EFFECTS)
    stage, lever, where = said
    assert found.stage == stage
    assert found.sentence.startswith(lever)
    assert where in found.sentence
    # What is offered is what was fitted: added as a user would add it, it repairs the model as it says.
    base, better = compare(cells, {**EFFECTS, "residual": formula_effect(found.formula)}, ["residual"])
    assert found.deviance[0] == pytest.approx(base.deviance, rel=1e-3)
    assert better.deviance == pytest.approx(found.deviance[1], rel=0.03)
    assert better.lack_of_fit_p > 5e-3
    assert better.cv_rmse_m_s < 1.1 * noise_floor(cells)["speed"]


@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_described_where_nothing_is_missing(drawn, seed):
    assert suggest_formula(base_fit(drawn(seed=seed)), EFFECTS) is None


def test_what_the_fitted_stiffness_absorbs_is_not_described(drawn):
    formula = "hidden: strength: k *= 1 + a*(phi - 0.6); a [1] in 1..3"
    assert suggest_formula(base_fit(drawn(seed=1, formulas=[formula])), EFFECTS) is None


def test_a_formula_may_be_one_that_would_change_nothing_of_sandbot():
    """Legs of a robot whose belly hangs low sink deeper than SandBot's can: to 2R - h."""
    low = Robot(axle_height_m=0.008)
    softer = formula_effect("hidden: strength: k *= 1 - a*where(d > 1.4*R, 1, 0); a [1] in 0.05..0.15")
    trials = drawn_by(
        Walker((softer,), low), [{"a": 0.1}], np.linspace(0.58, 0.633, 5), (4, 8, 12, 16, 20, 24, 30), 3, 1
    )
    base = fit(model_of("simple", (), EFFECTS, low), cells_of(replace(trials, robot=low)))
    found = suggest_formula(base, EFFECTS)
    assert found is not None
    # What is offered can be given as --effect.
    assert formula_effect(found.formula).identifier == found.name


@pytest.mark.slow
def test_a_second_term_on_the_same_lever(drawn):
    formula = "hidden: speed: kept, peak_ratio *= 1 - a*where(omega > 14, 1, 0) + 10*a*(phi - 0.6); a [1] in 0.1..0.3"
    found = suggest_formula(base_fit(drawn(seed=3, formulas=[formula])), EFFECTS)
    assert len(found.terms) == 2
    assert found.terms[0][0] == "above ω = 14 rad/s"
    assert "φ" in found.terms[1][0]
    assert found.lack_of_fit_p > 5e-3


@pytest.mark.slow
def test_it_stands_on_top_of_an_effect_of_the_catalogue(drawn):
    formula = "hidden: step: peak_ratio *= 1 - a*where(omega > 14, 1, 0); a [1] in 0.1..0.2"
    trials = drawn(("stance_overlap",), seed=4, formulas=[formula], values={"stance_overlap": {"eta": 0.15}})
    found = discover(cells_of(trials), {"stance_overlap": EFFECTS["stance_overlap"]}, max_effects=1)
    assert (found.verdict.status, found.verdict.effects) == ("partial", ("stance_overlap",))
    assert found.residual.effects == ("stance_overlap",)
    assert found.residual.sentence.startswith("on top of stance_overlap, the peak of v_x(t)")
    assert found.residual.options.endswith("--effects stance_overlap,residual")
    assert found.to_dict()["residual"]["effects"] == ["stance_overlap"]


@pytest.mark.slow
@pytest.mark.whole
def test_an_effect_is_found_beside_what_hides_it(drawn):
    """By itself motor saturation looks far better than the overlap that is there."""
    formula = "hidden: speed: kept, peak_ratio *= 1 - a*where(omega > 14, 1, 0); a [1] in 0.3..0.5"
    trials = drawn(("stance_overlap",), seed=4, formulas=[formula], values={"stance_overlap": {"eta": 0.1}})
    few = {name: EFFECTS[name] for name in ("stance_overlap", "leg_slip", "motor_saturation", "inertial_drag")}
    found = discover(cells_of(trials), few, max_effects=1)
    assert found.verdict.status == "unexplained"
    assert found.residual.effects == ("stance_overlap",)
    assert "above ω = 14 rad/s" in found.residual.sentence
    assert found.residual.leaves_nothing


@pytest.mark.slow
def test_a_users_effect_of_the_same_name_is_left_alone_and_workers_change_nothing(drawn):
    formulas = [PLANTED[0][0], "more: step: peak_ratio *= 1 - a*maximum(0.633 - phi, 0); a [1] in 2..4"]
    cells = cells_of(drawn(seed=3, formulas=formulas))
    base = fit(model_of("simple", (), EFFECTS), cells)
    first = formula_effect(suggest_formula(base, EFFECTS).formula)
    known = {**EFFECTS, "residual": first}
    better = fit(model_of("simple", ("residual",), known), cells, base.warm_start)
    second = suggest_formula(better, known)
    assert (second.name, second.effects) == ("residual_2", ("residual",))
    assert second.options.endswith("--effects residual,residual_2")
    assert second.sentence.startswith("on top of residual, ")
    assert second.lack_of_fit_p > 5e-3
    with Processes(2).map() as fit_all:
        assert suggest_formula(better, known, fit_all=fit_all) == second


def test_without_replicates_nothing_is_described(drawn):
    found = discover(cells_of(drawn(seed=3, replicates=1, formulas=[PLANTED[0][0]])), EFFECTS, max_effects=0)
    assert found.verdict.status == "untested"
    assert found.residual is None


@pytest.mark.slow
def test_the_score_test_predicts_what_the_fit_gains(drawn):
    """A small effect: the first order is all there is."""
    formula = "hidden: speed: kept, peak_ratio *= 1 - a*where(omega > 14, 1, 0); a [1] in 0.01..0.03"
    base = base_fit(drawn(seed=5, formulas=[formula]))
    promising = guesses(base, "residual", terms(base), None, DEFAULT.term)
    assert promising
    tried = _fit_guesses(base, promising, EFFECTS, map, lambda _done, _total: None)
    gains = np.array([base.deviance - one.fit.deviance for one in tried])
    expected = np.array([one.guess.gain for one in tried])
    np.testing.assert_allclose(gains, expected, rtol=0.25)
    assert tried[gains.argmax()].guess.terms == tried[expected.argmax()].guess.terms
    assert [one.score for one in tried] == sorted(_score(one.fit, one.guess) for one in tried)


def test_a_formula_may_tell_the_first_step():
    boost = Walker((formula_effect("boost: strength: k *= 1 + a*first; a [1] in 0..0.4"),))
    found = boost.predict(Inputs(200.0, 8.0, 0.4), [{"a": 0.1}])
    steady, virgin = (Walker().predict(Inputs(k, 8.0, 0.4)) for k in (200.0, 220.0))
    assert float(found.speed_m_s) == pytest.approx(float(steady.speed_m_s))
    assert float(found.first_step_m) == pytest.approx(float(virgin.first_step_m))
    assert isinstance(boost.chain(Inputs(200.0, 8.0, 0.4), [{"a": 0.1}], np.array([0.02]), first_step=True), Chain)


def test_what_could_not_be_scored_out_of_sample_is_none_in_the_json():
    """Where k of a level is known too badly no condition is left out and predicted; NaN is no JSON."""
    nan = float("nan")
    one = SuggestedFormula("so", "f: step: s *= 2", (), "step", (), (9.0, 1.0), (nan, nan), 0.5, True, 1.0)
    assert plain(one)["cv_rmse_m_s"] == [None, None]
