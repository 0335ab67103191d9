"""Absent effects have limits: right on drawn truth, none where the data say nothing."""

import copy
import dataclasses
from itertools import chain
from types import SimpleNamespace

import numpy as np

from sandbot_model.data.conditions import cells_of
from sandbot_model.data.penetrometer import Readings
from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.limits import ACCEPTED, ONE_SIDED, ROUNDS, TWO_SIDED, Limit, _outwards, _Side, limits
from sandbot_model.discovery.nuisances_about import nuisances_for
from sandbot_model.fitting.fit import fitted_at
from sandbot_model.fitting.global_minimum import solve_near
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.report import table_sections
from sandbot_record.trials.table import from_rows

EFFECTS = {
    name: effect
    for name, effect in catalogue().items()
    if name
    in ("stance_overlap", "inertial_drag", "phi_dependent_response", "cohesion", "crater_refill", "depth_nonlinearity")
}


def found(trials, readings=None, effects=EFFECTS, hidden=()):
    search = EffectSearch(cells_of(trials, readings), effects, "simple")
    search.run(0)
    plain = search.fits[()]
    shared = nuisances_for(plain, search.criteria)
    point = solve_near((plain.model, plain.cells, (plain.warm_start,), shared))
    named = fitted_at(plain.model, plain.cells, point, shared)
    return search, named, {limit.effect: limit for limit in limits(search, named, hidden)}


def test_a_limit_is_where_the_deviance_has_risen_as_far_as_it_says(drawn):
    """Against the profile by a full fit with the parameter held there."""
    search, named, of = found(drawn(seed=1, levels=4))
    limit = of["stance_overlap"]
    held = [search.model(("stance_overlap",), {"stance_overlap.eta": eta}) for eta in (0.0, limit.high)]
    least, there = (fit.deviance for fit in search.near(held, named))
    free = search.near([search.model(("stance_overlap",))], named)[0].deviance
    assert ONE_SIDED <= there - min(least, free) < ACCEPTED**2 * ONE_SIDED


def test_what_a_penetrometer_would_feel_counts_for_a_limit(drawn):
    """What full fits exclude its limits exclude: k is known by readings that feel the law of force themselves."""
    phi, depth_m = np.repeat(np.linspace(0.58, 0.633, 4), 4), np.tile([0.015, 0.025, 0.035, 0.044], 4)
    force_n = np.interp(phi, [0.58, 0.6, 0.633], [170.0, 205.0, 220.0]) * depth_m
    noise = 1 + 0.02 * np.random.default_rng(1).normal(size=len(phi))
    search, named, of = found(drawn(seed=1, levels=4), Readings(phi, depth_m, force_n * noise, 0.02 * force_n))
    limit = of["depth_nonlinearity"]
    ends = (0.965, 1.03)
    held = [search.model(("depth_nonlinearity",), {"depth_nonlinearity.n": n}) for n in ends]
    assert all(fit.deviance > named.deviance + TWO_SIDED for fit in search.near(held, named))
    assert ends[0] < limit.low < 1 < limit.high < ends[1]


def test_the_limits_of_what_is_there_and_of_what_is_not(drawn):
    """An overlap too small to be claimed is not excluded by its limit; on the other side zero is left in."""
    high = [
        found(drawn(("stance_overlap",), seed=seed, levels=4, values={"stance_overlap": {"eta": 0.01}}))[2]
        for seed in (1, 2, 3)
    ]
    assert sum(of["stance_overlap"].high > 0.01 for of in high) >= 2
    assert all(of["stance_overlap"].low is None for of in high)
    either = high[0]["phi_dependent_response"]
    assert either.low < 0.0 < either.high


def test_what_does_not_show_has_no_limit(drawn):
    rows = drawn(seed=1, levels=4).rows()
    speed = [dataclasses.replace(row, lift_m=np.nan, peak_speed_m_s=np.nan, first_step_m=np.nan) for row in rows]
    assert "cohesion" not in found(from_rows(speed))[2]


def test_a_limit_is_not_below_a_strength_that_full_fits_do_not_exclude(drawn):
    """k(φ) and Δt follow n and λ, and a short time of refilling hides any crater: to first order none of them can."""
    search, named, of = found(drawn(seed=1))
    usual = {"depth_nonlinearity": "n", "crater_refill": "z_0_m", "inertial_drag": "lambda_1"}
    starts = {name: search.effects[name].parameters[0].start for name in usual}
    held = [search.model((name,), {f"{name}.{key}": starts[name]}) for name, key in usual.items()]
    shows = {
        name: fit.deviance > named.deviance + TWO_SIDED
        for name, fit in zip(usual, search.near(held, named), strict=True)
    }
    assert not shows["depth_nonlinearity"]
    assert not shows["crater_refill"]
    for name, shown in shows.items():
        assert shown or name not in of or of[name].high is None or of[name].high >= starts[name]
    assert "depth_nonlinearity" not in of
    assert "crater_refill" not in of
    assert of["stance_overlap"].high < 0.03


def test_no_limit_excludes_the_neutral_value_or_what_is_hidden(drawn):
    """A dependence on φ that is there, but not claimed: its interval reaches its neutral value, and no farther."""
    effect = {"phi_dependent_response": {"b": 0.2}}
    trials = drawn(("phi_dependent_response",), seed=1, levels=4, values=effect)
    of = found(trials)[2]
    limit = of["phi_dependent_response"]
    assert limit.low <= 0.0 < 0.2 < limit.high
    assert "phi_dependent_response" not in found(trials, hidden=("phi_dependent_response",))[2]


def test_an_effect_that_does_not_contain_the_base_model_has_no_limit(drawn):
    """Where no gait is told, that of the base model is assumed and the slow phase's speed is a part of it."""
    effects = {"slow_phase_speed": catalogue()["slow_phase_speed"]}
    rows = drawn(seed=1, levels=4).rows()
    assert "slow_phase_speed" in found(from_rows(rows), effects=effects)[2]
    untold = [dataclasses.replace(row, gait="") for row in rows]
    assert found(from_rows(untold), effects=effects)[2] == {}


def test_a_limit_reads_as_a_person_writes_it():
    assert str(Limit("stance_overlap", "eta", "1", None, 0.0213)) == "stance_overlap.eta < 0.021"
    assert str(Limit("cable_drag", "f_c_n", "N", None, 0.05)) == "cable_drag.f_c_n < 0.05 N"
    assert str(Limit("a", "b", "1", -0.05, 0.1)) == "-0.050 < a.b < 0.100"
    assert str(Limit("a", "b", "m", 0.5, None)) == "0.5 < a.b m"
    assert str(Limit("a", "rho", "1", 0.9739, 1.0033, 1.0)) == "0.9739 < a.rho < 1.0033"
    assert str(Limit("a", "rho", "1", None, 1.0141, 1.0)) == "a.rho < 1.014"  # above its neutral value
    assert str(Limit("cohesion", "c_pa", "Pa", None, 254.3)) == "cohesion.c_pa < 250 Pa"


def test_the_report_gives_limits_as_the_command_does():
    two = (Limit("slow_phase_speed", "rho", "1", 0.9739, 1.0033, 1.0), Limit("leg_slip", "sigma", "1", None, 0.0085))
    ((table,),) = (section.tables for section in table_sections.limits(SimpleNamespace(limits=two)))
    assert [row[-2:] for row in table.rows] == [("0.9739", "1.0033"), ("–", "0.0085")]


def test_no_limit_is_set_on_a_step_of_the_deviance():
    """One condition that swims beyond 0.06 excludes nothing there: nothing else speaks against 0.15."""

    def limit(deviance):
        side = _Side("b", "b", 1, 0.0, 0.0, np.sqrt(TWO_SIDED), 0.1, 1.0, 0.3, None, (0.0, 0.0))
        for tried in range(2 * ROUNDS):
            if tried == ROUNDS:
                side.pass_the_step()
            if not side.settled:
                side.look(SimpleNamespace(deviance=deviance(side.tried), warm_start=None))
        return side.limit

    assert limit(lambda b: (b / 0.6) ** 2 + 7.0 * (b > 0.06)) is None
    assert 1.96 * 0.1 < limit(lambda b: (b / 0.1) ** 2 + 7.0 * (b > 0.06)) < 0.6
    # Controls: a smooth rise, and one with a step too small to exclude anything.
    for step in (0.0, 1.0):
        found = limit(lambda b, step=step: (b / 0.05) ** 2 + step * (b > 0.06))
        assert TWO_SIDED <= (found / 0.05) ** 2 + step <= ACCEPTED**2 * TWO_SIDED


def test_the_next_value_is_fitted_from_where_the_last_fit_ended_as_well(drawn, monkeypatch):
    """From the named set alone a descent stops at the first condition that would have to walk or swim."""
    begun, ended, near = [], [], EffectSearch.near

    def recorded(search, models, smaller, nuisances=None, also=()):
        fits = near(search, models, smaller, nuisances, also)
        begun.append([start.deviance for starts in also for start in starts])
        ended.append([fit.warm_start.deviance for fit in fits])
        return fits

    monkeypatch.setattr(EffectSearch, "near", recorded)
    found(drawn(seed=1, levels=4))
    assert sum(map(bool, begun)) > 1
    assert all(start in {*chain(*ended[:at])} for at, starts in enumerate(begun) for start in starts)


def test_a_limit_that_excludes_no_plausible_value_is_none(drawn):
    trials, name = drawn(seed=1, levels=4), "stance_overlap"
    high = found(trials)[2][name].high
    for share, given in ((1.2, True), (0.6, False)):
        effect = copy.copy(EFFECTS[name])
        effect.parameters = (dataclasses.replace(effect.parameters[0], high=share * high, start=0.5 * high),)
        assert (name in found(trials, effects={name: effect})[2]) == given


def test_an_effect_that_has_no_slope_where_it_vanishes_is_tried_farther_out():
    """What it does rises with its square: at neutral it has no standard error, which says nothing about its limit."""
    parameter = catalogue()["phi_nonuniformity"].parameters[0]

    def sides(value, error):
        parameters = {f"phi_nonuniformity.{parameter.name}": (value, error)}
        free = SimpleNamespace(parameters=parameters, deviance=100.0, warm_start=None)
        return list(_outwards("phi_nonuniformity", parameter, 100.0, free))

    for error in (171.0, np.inf, np.nan):
        (side,) = sides(0.0, error)
        assert 0.0 < side.tried <= side.room
        assert sides(0.001, error) == []  # control: there the data say nothing
