"""The search over sets: it goes on while that is worth it, keeps the better of two fits, and builds the ladder."""

import copy
from dataclasses import replace
from types import SimpleNamespace

import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery import effect_search
from sandbot_model.discovery.effect_search import EffectSearch, once_per_search
from sandbot_model.discovery.verdict import judge
from sandbot_model.fitting.fit import fitted_at
from sandbot_model.fitting.global_minimum import Found
from sandbot_model.physics.catalogue import catalogue

FEW = {name: effect for name, effect in catalogue().items() if name in ("stance_overlap", "swimming_thrust")}


def search_of(trials):
    return EffectSearch(cells_of(trials), FEW, "simple")


@pytest.fixture(scope="module")
def planted(drawn):
    search = search_of(drawn(("stance_overlap",), seed=6, levels=3))
    search.run(1)
    return search


def test_without_effects_to_try_only_the_base_model_is_fitted(drawn):
    search = search_of(drawn(levels=2))
    search.run(0)
    assert list(search.fits) == [()]


def test_every_single_effect_is_tried_and_the_ladder_ends_at_the_verdict(planted):
    assert set(planted.fits) == {(), ("stance_overlap",), ("swimming_thrust",)}
    verdict = judge(planted.fits)
    assert [fit.effects for fit in planted.ladder(verdict)] == [(), verdict.effects]


def test_a_worse_fit_never_takes_the_place_of_a_better(planted):
    before = planted.fits[("stance_overlap",)]
    planted.fit("once more", [("stance_overlap",)], nearby=True)
    assert planted.fits[("stance_overlap",)].deviance <= before.deviance


def test_a_part_is_fitted_again_from_where_the_best_set_has_come_to(planted):
    """What a set gains by a valley that its part has as well is not its effect's."""
    search = copy.copy(planted)
    base = planted.fits[()]
    stuck = fitted_at(base.model, base.cells, replace(base.point, theta=1.5 * base.point.theta))
    search.fits = planted.fits | {(): stuck}
    search._refit_parts(1)
    assert stuck.deviance > 2 * base.deviance
    assert search.fits[()].deviance == pytest.approx(base.deviance, rel=0.01)
    search._refit_parts(2)  # where no set is so large nothing is fitted
    assert search.fits.keys() == planted.fits.keys()


def test_a_part_that_was_never_tried_is_tried_before_a_set_is_claimed(planted):
    """A pair whose effects alone are among the worst is met as a part of a triple only."""
    search, both = copy.copy(planted), tuple(FEW)
    search.fits = {(): planted.fits[()], both: search.near([search.model(both)], planted.fits[("stance_overlap",)])[0]}
    assert judge(search.fits).effects == both
    search._refit_parts(2)
    assert judge(search.fits).effects == ("stance_overlap",)


@pytest.mark.parametrize("enough", [True, False])
def test_parts_are_fitted_again_from_every_set_that_leaves_nothing(monkeypatch, planted, enough):
    """The best of them may have come to where no descent without its last effect leads back from."""
    search, starts = copy.copy(planted), []
    search.fits = dict(planted.fits)

    def fit_all(function, tasks):
        starts.extend(start for _, _, (start,), _ in tasks)
        return map(function, tasks)

    search.fit_all = fit_all
    monkeypatch.setattr(effect_search, "leaves_nothing", lambda *_: enough)
    search._refit_parts(1)
    overlap, thrust = (planted.fits[name,].warm_start for name in FEW)
    assert starts == ([overlap, thrust] if enough else [overlap])


def test_sets_are_extended_in_the_order_of_the_catalogue_and_by_what_they_lack(planted):
    first, second = FEW
    assert planted.extended((second,)) == [(first, second)]
    assert planted.extended((first, second)) == []


@pytest.mark.parametrize(("of_one", "closer"), [(50.0, "stuck"), (40.0, "gains")], ids=["neutral", "gains"])
def test_sets_in_which_an_effect_stays_neutral_take_no_ones_place(monkeypatch, drawn, of_one, closer):
    """A dozen of them are equal to the digit; a set that got stuck near its parent is worth a closer look first."""
    search = search_of(drawn(levels=2))
    search.fits = {(): SimpleNamespace(deviance=100.0), ("base",): SimpleNamespace(deviance=50.0)}
    near = {("base", "gains"): of_one, ("base", "stuck"): 60.0}
    asked = []

    def fit(stage, sets, *, nearby):
        asked.append((stage, sets))
        search.fits |= {names: SimpleNamespace(deviance=near[names]) for names in sets}

    monkeypatch.setattr(search, "fit", fit)
    monkeypatch.setattr(effect_search, "passes", lambda *_: False)
    monkeypatch.setattr(search, "_beside_the_best", lambda _: [])
    monkeypatch.setattr(effect_search, "REFINED", 1)
    search._fit_sets("pairs", list(near))
    assert ("pairs, closer", [("base", closer)]) in asked


@pytest.mark.parametrize("found", [False, True])
def test_what_fits_worse_than_its_part_is_searched_for_only_where_nothing_fits_yet(monkeypatch, drawn, found):
    search = search_of(drawn(levels=2))
    search.fits = {names: SimpleNamespace(deviance=100.0) for names in ((), ("a", "b"))}
    near = {("a", "b", "c"): 90.0, ("a", "b", "d"): 120.0}
    asked = {}

    def fit(stage, sets, *, nearby):
        asked[stage, nearby] = [*asked.get((stage, nearby), []), *sets]
        search.fits |= {names: SimpleNamespace(deviance=near[names]) for names in sets}

    monkeypatch.setattr(search, "fit", fit)
    monkeypatch.setattr(effect_search, "passes", lambda fit, _: found and fit.deviance == 90.0)
    monkeypatch.setattr(search, "_beside_the_best", lambda _: [])
    monkeypatch.setattr(effect_search, "REFINED", 1)
    search._fit_sets("threes", list(near))
    assert asked["threes, closer", False] == [("a", "b", "c")]
    assert asked.get(("threes, worse than a part", False), []) == ([] if found else [("a", "b", "d")])


@pytest.mark.parametrize(
    ("deviances", "refined", "jumped"), [((100.0, 240.0), 2, 2), ((100.0, 300.0), 2, 1), ((100.0, 450.0), 1, 1)]
)
def test_what_is_far_above_the_best_of_all_is_neither_refined_nor_jumped_from(
    monkeypatch, drawn, deviances, refined, jumped
):
    search, asked = search_of(drawn(levels=2)), {}
    search.fits = {(): SimpleNamespace(deviance=2000.0, warm_start=None)}

    def fit_all(function, tasks):
        asked[function.__name__] = len(tasks)
        return [Found(None, deviance) for deviance in deviances[: len(tasks)]]

    monkeypatch.setattr(search, "fit_all", fit_all)
    monkeypatch.setattr(effect_search, "worth_jumps", lambda *_: True)
    monkeypatch.setattr(effect_search, "fitted_at", lambda *_: SimpleNamespace(deviance=0.0, effects=()))
    search.fit("singles", [(name,) for name in FEW], nearby=False)
    assert asked == {"solve_first": 2, "solve_further": refined, "solve_jumping": jumped}


def test_a_response_time_that_nobody_believes_is_held_at_the_end_of_its_range(drawn):
    """k that grows with ω pulls Δt to 1.75 s; beside an exponent of depth data hardly mind 1.2 s."""
    few = {name: effect for name, effect in catalogue().items() if name == "depth_nonlinearity"}
    growing = drawn(
        seed=1, levels=7, replicates=4, formulas=["h: strength: k *= 1 + c*(omega - 4); c in 0.0065..0.0067"]
    )
    for trials, held in ((growing, {"delta_t_s": 1.2}), (drawn(seed=1), {})):
        search = EffectSearch(cells_of(trials), few, "simple")
        search.run(1)
        fit = search.fits[("depth_nonlinearity",)]
        assert dict(fit.model.held) == held
        assert "delta_t_s" not in fit.at_bounds


def test_what_a_search_has_computed_is_kept_for_it_and_these_arguments_alone():
    first, second = SimpleNamespace(computed={}), SimpleNamespace(computed={})
    calls = []

    @once_per_search
    def square(search, value):
        calls.append((search, value))
        return value**2

    @once_per_search
    def cube(search, value):
        return value**3

    assert [square(first, 2), square(first, 2), cube(first, 2)] == [4, 4, 8]
    assert calls == [(first, 2)]
    assert [square(first, 3), square(second, 2)] == [9, 4]
    assert calls == [(first, 2), (first, 3), (second, 2)]
