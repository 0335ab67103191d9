"""A family is named whatever its convention; which one it is, the data say."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery import conventions
from sandbot_model.discovery.conventions import (
    admit_rivals,
    other_families,
    same_family,
    singles,
    try_single_effects,
    try_within_pairs,
)
from sandbot_model.discovery.criteria import DEFAULT
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.nuisances_about import averaged_with
from sandbot_model.discovery.partial import beyond_its_range
from sandbot_model.discovery.sharing import has_flexible_nuisances
from sandbot_model.discovery.verdict import judge, sound
from sandbot_model.fitting.fit import fitted_at
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_model.physics.variants import variants_of

FEW = {name: effect for name, effect in catalogue().items() if name in ("stance_overlap", "leg_slip", "inertial_drag")}
WITH_CABLE = {name: catalogue()[name] for name in ("stance_overlap", "leg_slip", "cable_drag")}
SPARED = "o: speed: kept *= 1 - 0.1*(1 - first)"


@pytest.mark.slow
def test_an_overlap_that_spares_the_first_step_is_an_overlap(drawn):
    found = discover(cells_of(drawn(formulas=(SPARED,), seed=5)), FEW, max_effects=1)
    assert (found.verdict.status, found.verdict.effects) == ("identified", ("stance_overlap",))
    assert found.headline == "identified: stance_overlap (the first step spared)"
    assert found.to_dict()["variants"] == {"stance_overlap": "the first step spared"}
    eta = found.fit.parameters["stance_overlap.eta"]
    assert eta.value == pytest.approx(0.1, abs=3 * eta.stderr)


def test_the_catalogues_own_convention_is_no_variant(drawn):
    found = discover(cells_of(drawn(("stance_overlap",), seed=5)), FEW, max_effects=1)
    assert found.headline == "identified: stance_overlap"
    assert found.to_dict()["variants"] == {}


@pytest.mark.slow
def test_one_effect_under_another_convention_takes_the_place_of_two(drawn):
    """Of an overlap that grows with ω a second effect took what the first one's usual form leaves.

    A slip that grows alike and spares the peak can be no other than it.
    """
    growing = "o: speed: kept *= 1 - 0.14*omega/16"
    found = discover(cells_of(drawn(formulas=(growing,), seed=5)), FEW, max_effects=2)
    assert found.verdict.status == "ambiguous"
    assert set(found.verdict.alternatives) == {("stance_overlap",), ("leg_slip",)}
    assert found.variants == {"stance_overlap": "by a power of ω", "leg_slip": "the peak spared, by a power of ω"}
    overlap = next(fit for fit in found.fits if fit.effects == ("stance_overlap",))
    power = overlap.parameters["stance_overlap.power"]
    assert power.value == pytest.approx(1.0, abs=3 * power.stderr)


@pytest.mark.whole
@pytest.mark.slow
def test_what_is_lost_to_being_slow_is_no_overlap(drawn):
    """Grains that stick were an overlap by ω to the power of -1.1."""
    few = {name: FEW[name] for name in ("stance_overlap", "leg_slip")}
    found = discover(
        cells_of(drawn(formulas=("o: speed: kept *= 1 - 0.35*exp(-omega/6)",), seed=5)), few, max_effects=1
    )
    assert found.verdict.status == "unexplained"


@pytest.mark.whole
@pytest.mark.slow
def test_effects_that_look_alike_stand_against_other_conventions(drawn):
    """A slip that falls steeply with depth: two explain it under their usual formulas, one under its own better."""
    alike = {name: catalogue()[name] for name in ("leg_slip", "cable_drag", "bed_slope")}
    cells = cells_of(drawn(formulas=("o: step: s, peak *= 1 - 0.12*(0.039/d)^4",), seed=2000, levels=7))
    search = EffectSearch(cells, alike, "simple")
    search.run(1)
    assert judge(search.fits).status == "ambiguous"
    assert discover(cells, alike, max_effects=1).headline == "identified: leg_slip (by another power of depth)"


TRIPOD = (
    "u: strength: k *= where(1.2*z > 2*R - h, 0, 1);"
    "step *= (sqrt(max(R^2 - (1.2*d + h - R)^2, 0)) + 2*sqrt(max(R^2 - (0.9*d + h - R)^2, 0)))/(1.5*max(s_0, 1e-6))"
)


@pytest.mark.whole
@pytest.mark.slow
def test_a_tripod_whose_step_is_the_mean_of_its_legs_carries_unequally(drawn):
    """Without the lift resistive_force_theory leaves nothing to explain: it was said to repair most."""
    few = {name: catalogue()[name] for name in ("unequal_leg_load", "resistive_force_theory", "exact_leg_arc")}
    found = discover(cells_of(drawn(formulas=(TRIPOD,), seed=5)), few, max_effects=1)
    assert found.headline == "identified: unequal_leg_load (a step is the mean of its legs')"
    x = found.fit.parameters["unequal_leg_load.x"]
    assert x.value == pytest.approx(0.2, abs=3 * x.stderr)


@pytest.mark.whole
@pytest.mark.slow
def test_a_floor_nearer_than_the_robots_file_says_is_named_beside_what_looks_like_it(drawn):
    few = {name: catalogue()[name] for name in ("phi_dependent_response", "finite_depth")}
    floor = "f: strength: k*(1 + exp(-(0.066 - z)/0.013))"
    found = discover(cells_of(drawn(formulas=(floor,), seed=5, levels=7)), few, max_effects=1)
    assert ("finite_depth",) in found.verdict.alternatives
    assert found.variants == {"finite_depth": "in a bed of another depth"}
    late = drawn(("phi_dependent_response",), values={"phi_dependent_response": {"b": 0.8}}, seed=5)
    response = discover(cells_of(late), few, max_effects=1)
    assert response.headline == "identified: phi_dependent_response"


@pytest.mark.whole
@pytest.mark.slow
def test_a_convention_that_leaves_nothing_may_be_claimed_on_a_bed_that_scatters(drawn):
    """It was refused as one that needs a k of each condition, which explain a little more here."""
    level = "o: speed: kept *= 1 - 0.15*(1 - first)*tanh((omega/11)^2)"
    found = discover(cells_of(drawn(formulas=(level,), seed=2000, levels=7)), FEW, max_effects=1)
    assert has_flexible_nuisances(found.fit)
    assert found.headline == "identified: stance_overlap (the first step spared, by a power of ω)"


PLUNGE = "p: balance: extra_force += 2.2*(omega*s/2)^2"
TILT = "t: balance: F*(1 - 1.2*((1 - z/R)^2 - (1 - d_r/R)^2))"


@pytest.mark.whole
@pytest.mark.slow
@pytest.mark.parametrize(
    ("formula", "said"),
    [(PLUNGE, "unexplained"), (TILT, "identified: resistive_force_theory (by the square of how far a leg tilts)")],
)
def test_a_law_of_force_bent_by_a_number_speaks_against_a_claim_and_is_none_alone(drawn, formula, said):
    """Grains that a leg throws on its way down were `partial: resistive_force_theory` by this convention."""
    few = {name: catalogue()[name] for name in ("inertial_drag", "resistive_force_theory", "exact_leg_arc")}
    assert discover(cells_of(drawn(formulas=(formula,), seed=2000, levels=7)), few, max_effects=1).headline == said


@pytest.mark.whole
@pytest.mark.slow
def test_no_convention_is_claimed_where_only_the_mean_speed_shows_it(drawn):
    """An overlap by a power of ω, seen in every observable; by speed and lift alone it might be anything."""
    growing = drawn(formulas=("o: speed: kept *= 1 - 0.14*omega/16",), seed=5)
    alone = _without(growing, "peak_speed_m_s", "first_step_m")
    assert discover(cells_of(growing), FEW, max_effects=1).verdict.status == "ambiguous"
    assert discover(cells_of(alone), FEW, max_effects=1).verdict.status == "unexplained"


@pytest.mark.whole
@pytest.mark.slow
def test_a_second_effect_is_looked_for_beside_the_convention_that_the_first_one_has(drawn):
    few = {name: catalogue()[name] for name in ("stance_overlap", "swimming_thrust", "motor_saturation")}
    more = "o: speed: kept *= 1 - 0.2*(1 - first)"
    hard = {"swimming_thrust": {"thrust_m_s2": 0.45}}
    trials = drawn(("swimming_thrust",), values=hard, formulas=(more,), seed=5)
    found = discover(cells_of(_without(trials, "lift_m", "peak_speed_m_s")), few, max_effects=2)
    assert found.headline == "identified: stance_overlap (the first step spared) + swimming_thrust"


@pytest.mark.parametrize(
    ("formula", "variants"),
    [
        ("o: speed: kept *= 1 - 0.2*(1 - first)", {"stance_overlap": "the first step spared"}),
        ("o: speed: kept *= 1 - 0.2", {}),
    ],
)
def test_either_effect_of_a_pair_may_have_a_convention_of_its_own(drawn, formula, variants):
    """With a control: under the catalogue's own no other is taken."""
    few = {name: catalogue()[name] for name in ("stance_overlap", "swimming_thrust")}
    hard = {"swimming_thrust": {"thrust_m_s2": 0.45}}
    search = EffectSearch(
        cells_of(drawn(("swimming_thrust",), values=hard, formulas=(formula,), seed=5)), few, "simple"
    )
    search.run(2)
    assert try_within_pairs(search) == bool(variants)
    assert search.fits[tuple(few)].variants == variants


def _without(trials, *names):
    return replace(trials, **dict.fromkeys(names, np.full(len(trials.phi), np.nan)))


TIME_LEFT = "maximum(pi/omega - 2*arcsin(s_0/(2*R))/(beta*omega), 0)"
VISCOUS = f"b: step: s + 0.05*beta*omega*maximum(d + h - R, 0)*(1 - exp(-{TIME_LEFT}/0.05))"


@pytest.mark.whole
@pytest.mark.slow
def test_the_best_after_a_first_look_are_looked_for_everywhere(drawn):
    """Near the usual convention, which has Δt at 0.23 s in place of 0.40, this one stayed at a deviance of 2314."""
    few = {"belly_coast": catalogue()["belly_coast"]}
    found = discover(cells_of(drawn(formulas=(VISCOUS,), seed=2000, levels=7)), few, max_effects=1)
    assert found.headline == "identified: belly_coast (friction in proportion to speed, the first step as any other)"


QUARTER = f"b: step: s + 0.25*beta*omega*maximum(d + h - R, 0)*{TIME_LEFT}"
PLOUGH = "b: step: s*(1 - 0.35*exp(-(0.046 - d)/0.004))"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("formula", "said"),
    [(QUARTER, "partial: belly_coast"), pytest.param(PLOUGH, "unexplained", marks=pytest.mark.whole)],
)
def test_a_belly_may_slide_on_with_a_share_of_the_speed(drawn, formula, said):
    """Control: a body that ploughs grains up; a slide backwards, by a share below nothing, fits that and is none."""
    few = {"belly_coast": catalogue()["belly_coast"]}
    found = discover(cells_of(drawn(formulas=(formula,), seed=2000, levels=7)), few, max_effects=1)
    assert found.headline.startswith(said)


@pytest.mark.slow
def test_a_claim_falls_where_another_family_explains_more_under_another_convention(drawn):
    """A slip that spares the peak is an overlap but for how it falls with depth, which either may do."""
    spared = "o: step: s *= 1 - clip(0.45*(1 - d/0.058), 0, 1)"
    found = discover(cells_of(drawn(formulas=(spared,), seed=5)), FEW, max_effects=1)
    assert found.verdict.status == "ambiguous"
    assert set(found.verdict.alternatives) == {("stance_overlap",), ("leg_slip",)}
    assert found.variants["stance_overlap"] == "by a power of depth"
    assert found.variants["leg_slip"].startswith("the peak spared")


@pytest.mark.slow
@pytest.mark.parametrize("seed", [5, *(pytest.param(seed, marks=pytest.mark.whole) for seed in (6, 7))])
def test_a_claim_stands_where_others_only_come_near(drawn, seed):
    found = discover(cells_of(drawn(("stance_overlap",), seed=seed)), FEW, max_effects=1)
    assert found.headline == "identified: stance_overlap"
    search = EffectSearch(found.cells, FEW, "simple")
    search.run(1)
    assert not admit_rivals(search, search.fits["stance_overlap",])
    assert min(fit.bic for fit in singles(search) if fit.effects == ("leg_slip",)) < found.fit.bic + 10


@pytest.mark.slow
@pytest.mark.parametrize("seed", [6, pytest.param(8, marks=pytest.mark.whole)])
def test_readings_off_zero_and_scale_are_no_other_convention(drawn, seed):
    """What speaks against a claim is compared beside what trials share: without it a cable that spares the peak won."""
    trials = drawn(("stance_overlap",), seed=seed)
    along = {name: 1.01 * getattr(trials, name) for name in ("speed_m_s", "peak_speed_m_s", "first_step_m")}
    found = discover(cells_of(replace(trials, lift_m=trials.lift_m + 0.6e-3, **along)), WITH_CABLE, max_effects=1)
    assert found.headline == "identified: stance_overlap"


RAMP = "d: strength: k - maximum(k - 172, 0)*0.5*(1 + cos(pi*clip((a/R - 0.7)/0.4, 0, 1)))*(1 - first)"


@pytest.mark.slow
@pytest.mark.parametrize(("formula", "named"), [(RAMP, "disturbed_ground"), (SPARED, None)])
def test_a_better_fit_with_a_number_nobody_believes_comes_before_a_formula_nobody_wrote_down(drawn, formula, named):
    """Ground loosened from longer steps on than is believed; an overlap under our convention has no such number."""
    some = {name: catalogue()[name] for name in ("disturbed_ground", "crater_refill", "stance_overlap")}
    search = EffectSearch(cells_of(drawn(formulas=(formula,), seed=5)), some, "simple")
    search.run(1)
    usual = search.fits["disturbed_ground",]
    try_single_effects(search)
    # Its own convention has only numbers that are believed, and comes before it.
    assert named is None or sound(search.fits["disturbed_ground",])
    search.fits["disturbed_ground",] = usual
    found = beyond_its_range(search)
    assert (found and found[0].effects) == (named and (named,))


def made(name, bic, variant="", p=0.5, beyond=()):
    """A fit of one effect, of which only the numbers that a choice rests on are given."""
    return SimpleNamespace(
        effects=(name,) if name else (),
        variants={name: variant} if variant else {},
        bic=bic,
        deviance=bic,
        lack_of_fit_p=p,
        goodness=SimpleNamespace(chi2=50.0, dof=60, lack_of_fit={"speed": p}),
        at_bounds=(),
        implausible=beyond,
        parameters={"delta_t_s": (0.4, 0.01)},
        cells=SimpleNamespace(pure_error_dof=np.full(4, 10_000)),
        model=SimpleNamespace(effects=(SimpleNamespace(stage="strength", variant=variant),), held={}),
        warm_start=None,
        nuisances=None,
    )


def searched(*fits, tried=()):
    return SimpleNamespace(
        fits={fit.effects: fit for fit in fits},
        criteria=DEFAULT,
        tried=list(tried),
        computed={(singles.__wrapped__,): list(tried)},
        cells=SimpleNamespace(observables=("speed", "peak_speed")),
    )


BEYOND = ("a.x",)


@pytest.mark.parametrize(
    ("usual", "other", "taken"),
    [
        (made("a", 50.0, beyond=BEYOND), made("a", 55.0, "its own"), True),
        (made("a", 50.0, beyond=BEYOND), made("a", 65.0, "its own"), False),
        (made("a", 50.0, beyond=BEYOND), made("a", 55.0, "its own", p=1e-6), False),
        (made("a", 50.0, beyond=BEYOND), made("a", 45.0, "its own", beyond=BEYOND), False),
        (made("a", 50.0), made("a", 45.0, "its own"), False),
        (made("a", 50.0), made("a", 35.0, "its own"), True),
    ],
)
def test_a_plausible_convention_comes_before_an_implausible_value_unless_it_is_clearly_worse(
    monkeypatch, usual, other, taken
):
    monkeypatch.setattr(conventions, "solve", lambda task: task)
    monkeypatch.setattr(conventions, "fitted_at", lambda *_: other)
    search = searched(made("", 500.0), usual, tried=[other])
    assert try_single_effects(search) == taken
    assert search.fits["a",] is (other if taken else usual)


def test_an_implausible_convention_must_be_clearly_better_than_a_plausible_one(monkeypatch):
    usual, own = made("a", 90.0), made("a", 45.0, "its own")
    monkeypatch.setattr(conventions, "solve", lambda task: task)
    monkeypatch.setattr(conventions, "fitted_at", lambda model, *_: next(fit for fit in tried if fit.model is model))
    for bic, named in ((40.0, "its own"), (30.0, "beyond")):
        tried = [own, made("a", bic, "beyond", beyond=BEYOND)]
        search = searched(made("", 500.0), usual, tried=tried)
        assert try_single_effects(search)
        assert search.fits["a",].variants == {"a": named}


def test_what_speaks_beside_a_claim_are_its_conventions_that_explain_as_much_and_the_best_of_other_families(
    monkeypatch,
):
    monkeypatch.setattr(conventions, "with_sampled_errors", lambda fit: fit)
    own = [made("a", 52.0, "near"), made("a", 70.0, "far"), made("a", 49.0, "unfit", p=1e-6)]
    others = [made("b", 58.0, "second"), made("b", 51.0, "first"), made("c", 40.0, "beyond", beyond=("c.x",))]
    search = searched(tried=[*own, *others])
    picked, beyond, usual = made("a", 50.0, "picked"), made("a", 50.0, beyond=BEYOND), made("a", 50.0)
    for claimed, covered in ((picked, [own[0]]), (beyond, [own[0]]), (usual, []), (made("a", 55.0), [own[0]])):
        assert same_family(search, claimed, claimed) == covered
        assert other_families(search, claimed, claimed) == [others[1]]


def test_errors_cover_another_convention_but_not_the_number_of_it(smooth):
    """What a power of depth is says nothing about a power of ω; Δt, k and eta mean the same under either."""
    by_name = {variant.variant: variant for variant in variants_of(catalogue()["stance_overlap"])}

    def under(convention, away):
        model = model_of("simple", ("stance_overlap",), {"stance_overlap": by_name[convention]})
        theta = [{"stance_overlap.eta": 0.1, "stance_overlap.power": 0.5 + away}.get(name) for name in model.names]
        kept = dict(zip(smooth.model.names, smooth.point.theta, strict=True))
        values = [kept[name] if value is None else value for name, value in zip(model.names, theta, strict=True)]
        values[model.names.index("delta_t_s")] += away
        return fitted_at(model, smooth.cells, replace(smooth.point, theta=np.array(values)))

    here, there = under("by a power of ω", 0.0), under("by a power of depth", 0.05)
    there = replace(there, covariance=here.covariance)
    averaged = averaged_with(here, [there])
    weight = 1 / (1 + np.exp(0.5 * (there.bic - here.bic)))
    expected = here.parameters["delta_t_s"].stderr ** 2 + weight * 0.05**2
    assert averaged.parameters["delta_t_s"].stderr ** 2 == pytest.approx(expected)
    for name in ("stance_overlap.power", "stance_overlap.eta"):
        assert averaged.parameters[name].stderr == pytest.approx(here.parameters[name].stderr)
