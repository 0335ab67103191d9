import copy
import dataclasses
import json
import pickle
import re
from types import SimpleNamespace

import numpy as np
import pytest

from sandbot_common.parallel import Processes
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery import judgement, remarks
from sandbot_model.discovery.criteria import DEFAULT
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.next_trials import NextTrial
from sandbot_model.discovery.unseen import equally_simple, largest_shift
from sandbot_model.discovery.verdict import Verdict, next_best
from sandbot_model.fitting.fit import fit, fitted_at
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_model.tools import compare as compare_tool
from sandbot_model.tools import discover as discover_tool
from sandbot_model.tools import effects as effects_tool
from sandbot_record.trials.csv_table import write_csv

FEW = {
    name: effect
    for name, effect in catalogue().items()
    if name in ("stance_overlap", "swimming_thrust", "leg_slip", "cable_drag")
}


def test_nothing_missing_is_adequate(drawn):
    found = discover(cells_of(drawn(seed=5)), FEW, max_effects=1)
    assert found.verdict.status == "adequate"
    assert found.verdict.effects == ()
    assert len(found.steps) == 1
    assert found.next_trials == ()


@pytest.mark.parametrize(
    ("offered", "said"), [(1, ""), (2, "; or stance_overlap + slow_phase_speed with the radius as given")]
)
def test_effects_that_would_explain_another_leg_radius_are_told_beside_the_doubt(drawn, offered, said):
    both = {"stance_overlap": {"eta": 0.11}, "slow_phase_speed": {"rho": 0.8}}
    cells = cells_of(drawn(tuple(both), levels=4, omega=(6, 11, 15, 19, 23, 27), values=both))
    found = discover(cells, {name: catalogue()[name] for name in both}, max_effects=offered)
    assert (found.verdict.status, found.verdict.effects, len(found.fits)) == ("unexplained", (), 1)
    assert re.search(r"robot\.yaml may be wrong.*, not on 3\.55 cm" + re.escape(said) + "$", found.verdict.because)


def test_the_sentence_has_the_p_of_the_fit_that_is_reported(drawn):
    """With nuisances, here a zero of the lift off by a grain; not that of the fit from which the verdict was drawn."""
    trials = drawn(seed=5)
    found = discover(cells_of(dataclasses.replace(trials, lift_m=trials.lift_m + 2e-4)), FEW, max_effects=1)
    assert found.verdict.status == "adequate"
    (searched,) = (fit for fit in found.fits if not fit.effects)
    told = [f"lack of fit p = {fit.lack_of_fit_p:.2g})" in found.verdict.because for fit in (found.fit, searched)]
    assert told == [True, False]


def test_limits_that_nobody_asked_for_change_nothing_else(drawn):
    cells = cells_of(drawn(seed=5))
    both = [discover(cells, FEW, max_effects=1, with_limits=asked).to_dict() for asked in (True, False)]
    limited, plain = (found.pop("limits") for found in both)
    assert limited
    assert not plain
    assert json.dumps(both[0]) == json.dumps(both[1])


@pytest.mark.parametrize(
    ("options", "sought"), [([], 0), (["--next", "next.csv"], 0), (["--verbose"], 1), (["--json", "found.json"], 1)]
)
def test_the_command_seeks_limits_only_where_an_output_lists_them(options, sought, drawn, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    asked = []
    monkeypatch.setattr("sandbot_model.discovery.discover.limits", lambda *of: asked.append(of) or [])
    write_csv(drawn(seed=5), tmp_path / "trials.csv")
    assert discover_tool.main(["trials.csv", "--max-effects", "0", "--workers", "1", *options]) == 0
    assert len(asked) == sought


def test_what_would_not_show_is_listed_so_and_has_no_limit(drawn):
    effects = {name: catalogue()[name] for name in ("stance_overlap", "depth_nonlinearity")}
    found = discover(cells_of(drawn(seed=5)), effects, max_effects=1)
    assert found.unseen == ("depth_nonlinearity",)
    assert [limit.effect for limit in found.limits] == ["stance_overlap"]
    shift = found.to_dict()["unseen_shift"]
    assert shift["parameters"] == {"depth_nonlinearity.n": 1.2}
    assert f"if depth_nonlinearity (n = 1.2) is there, Δt is {shift['delta_t_s']:.3f} s, not" in found.verdict.because


def test_an_unseen_effect_that_hardly_shifts_the_response_time_is_not_spoken_of(drawn):
    named = fit(model_of("simple", (), FEW), cells_of(drawn(seed=5)))
    value, stderr = named.parameters["delta_t_s"]
    off = {sign: replace_delta_t(named, value + sign * stderr) for sign in (-1.9, 2.1)}
    assert largest_shift(named, [off[-1.9]]) is None
    assert largest_shift(named, list(off.values())).delta_t_s == pytest.approx(value + 2.1 * stderr)
    assert largest_shift(named, []) is None
    # Each holds a parameter: not as simple as the model is.
    assert equally_simple(named, list(off.values())) == []


def replace_delta_t(named, delta_t_s):
    """The fit of an effect with another Δt."""
    model = model_of("simple", ("stance_overlap",), FEW, held={"stance_overlap.eta": 0.1})
    theta = np.append(named.point.theta, 0.1)
    theta[0] = delta_t_s
    return fitted_at(model, named.cells, dataclasses.replace(named.point, theta=theta))


def test_a_claim_falls_with_a_number_that_the_reported_errors_take_out_of_its_range(monkeypatch, drawn):
    """By a derivative Δt of 1.33 ± 0.1 s may be 1.2 s; by what the fit does beside switches it is known to 0.015 s."""
    narrow = copy.copy(FEW["stance_overlap"])
    narrow.parameters = (dataclasses.replace(narrow.parameters[0], low=0.13, high=0.5),)
    as_before = judgement.reported_fit

    def with_errors(search, named):
        lower, reported = as_before(search, named)
        model = model_of("simple", named.effects, {**FEW, "stance_overlap": narrow})
        return lower, dataclasses.replace(reported, model=model)

    cells = cells_of(drawn(("stance_overlap",), seed=6))
    assert discover(cells, FEW, max_effects=1).verdict.effects == ("stance_overlap",)
    monkeypatch.setattr(judgement, "reported_fit", with_errors)
    found = discover(cells, FEW, max_effects=1).verdict
    assert found.status == "unexplained"
    assert "only with stance_overlap.eta = 0.09905 (plausible: 0.13 to 0.5)" in found.because


def test_a_planted_effect_is_identified_and_the_file_says_so(drawn):
    found = discover(cells_of(drawn(("stance_overlap",), seed=6)), FEW, max_effects=2)
    assert found.verdict.status == "identified"
    assert found.verdict.effects == ("stance_overlap",)
    assert found.candidates[0].effect == "stance_overlap"
    assert found.candidates[0].delta_bic < -10
    content = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert content["schema"] == "sandbot.discovery/2"
    assert set(content) >= {"data", "noise_floor_m_s", "steps", "candidates", "verdict", "next_trials"}
    assert [step["effects"] for step in content["steps"]] == [[], ["stance_overlap"]]
    said = repr(found)
    assert said.startswith("identified: stance_overlap (best in ")
    assert len(said.splitlines()) < 29
    assert "<b>identified: stance_overlap</b>" in found._repr_html_()
    assert len(pickle.dumps(found)) < 300_000
    assert set(content["steps"][0]) >= {"rmse_m_s", "cv_rmse_m_s", "lack_of_fit_p", "parameters", "fails"}
    assert content["verdict"]["status"] == "identified"
    assert content["data"] | {"excluded_trials": 0} == {
        "trials": 105,
        "excluded_trials": 0,
        "cells": 35,
        "replicated_cells": 35,
        "observables": ["speed", "lift", "peak_speed", "first_step"],
    }


@pytest.mark.slow
def test_a_set_left_out_for_a_parameter_at_its_bound_is_named(drawn):
    cells = cells_of(drawn(("stance_overlap",), seed=6))
    sets = ((), ("stance_overlap",), ("leg_slip",), ("swimming_thrust",))
    fits = {names: fit(model_of("simple", names, FEW), cells) for names in sets}
    second = next_best(fits, fits[("stance_overlap",)])
    assert "the next best, leg_slip, has ΔBIC" in second
    assert "at or beyond its bound" not in second
    slip = fits[("leg_slip",)]
    theta = np.where([name == "leg_slip.sigma" for name in slip.model.names], 1.0, slip.point.theta)
    fits[("leg_slip",)] = dataclasses.replace(slip, point=dataclasses.replace(slip.point, theta=theta))
    third = next_best(fits, fits[("stance_overlap",)])
    assert "the next best, swimming_thrust, has ΔBIC" in third
    assert re.search(r"\(leg_slip \d+, but with leg_slip.sigma at or beyond its bound\)", third)


def test_what_has_the_very_formula_of_a_claim_is_told(drawn):
    few = {name: effect for name, effect in catalogue().items() if name in ("stance_overlap", "phi_dependent_response")}
    said = {}
    for hidden in few:
        found = discover(cells_of(drawn((hidden,), seed=6)), few, max_effects=1)
        assert found.headline == f"identified: {hidden}"
        said[hidden] = (
            "not its peak speed, unlike cable_drag, would look the same; a control experiment on stance_overlap "
            f"decides ({few['stance_overlap'].control})"
        ) in found.verdict.because
    assert said == {"stance_overlap": True, "phi_dependent_response": False}


def test_twins_are_ambiguous(drawn):
    found = discover(cells_of(drawn(("leg_slip",), seed=7)), FEW, max_effects=1)
    assert found.verdict.status == "ambiguous"
    assert {("leg_slip",), ("cable_drag",)} <= set(found.verdict.alternatives)
    assert set(found.controls) == {"leg_slip", "cable_drag"}
    assert "apart by these observables; control experiments do: " in found.verdict.because
    assert f"cable_drag ({FEW['cable_drag'].control})" in found.verdict.because
    assert found.to_dict()["controls"] == found.controls


@pytest.mark.parametrize(
    ("sets", "gap", "controls"),
    [
        ((("leg_slip",), ("cable_drag",)), 0.4, ["leg_slip", "cable_drag"]),
        ((("leg_slip", "stance_overlap"), ("cable_drag", "stance_overlap")), 0.4, ["leg_slip", "cable_drag"]),
        ((("swimming_thrust",), ("leg_slip",)), 0.4, ["leg_slip"]),
        ((("swimming_thrust",), ("boost",)), 0.4, []),
        ((("leg_slip",), ("cable_drag",)), 0.6, None),
    ],
    ids=["one each", "with one in common", "one has none", "neither has one", "a trial distinguishes them"],
)
def test_controls_are_asked_for_where_no_trial_distinguishes_what_is_left(sets, gap, controls):
    effects = {**FEW, "boost": SimpleNamespace(control="")}
    search, verdict = SimpleNamespace(effects=effects), Verdict("ambiguous", sets[0], sets, "")
    trials = [NextTrial(0.6, 9.0, "speed", ("a", "b"), gap, 2)]
    said = remarks.most_discriminating(trials, remarks.controls_of(search, verdict), DEFAULT)
    if controls is None:
        assert said.startswith("most telling: speed at φ 0.600")
    elif controls:
        assert said.endswith(f"experiments do: {', '.join(f'{name} ({FEW[name].control})' for name in controls)}")
    else:
        assert said.endswith("another kind is needed")


@pytest.mark.slow
def test_what_is_not_in_the_catalogue_is_unexplained(drawn):
    only = {"swimming_thrust": FEW["swimming_thrust"]}
    found = discover(cells_of(drawn(("stance_overlap",), seed=8)), only, max_effects=1)
    assert found.verdict.status == "unexplained"
    assert "rad/s" in found.verdict.because


@pytest.mark.slow
def test_without_replicates_nothing_is_claimed(drawn):
    found = discover(cells_of(drawn(("stance_overlap",), replicates=1)), FEW, max_effects=1)
    assert found.verdict.status == "untested"
    assert "replicates" in found.verdict.because


@pytest.mark.slow
def test_workers_change_nothing(drawn):
    cells = cells_of(drawn(("stance_overlap",), seed=6, levels=3))
    alone = discover(cells, FEW, max_effects=1)
    with Processes(2).map() as fit_all:
        together = discover(cells, FEW, max_effects=1, fit_all=fit_all)
    assert alone.to_dict() == together.to_dict()


@pytest.fixture
def table(tmp_path, drawn):
    path = tmp_path / "trials.csv"
    write_csv(drawn(("stance_overlap",), seed=6, levels=4), path)
    return path


def test_compare_on_the_command_line(table, tmp_path, capsys):
    out = tmp_path / "out.json"
    assert compare_tool.main([str(table), "--effects", "stance_overlap", "--json", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "cm/s" in printed
    assert "noise floor" in printed
    assert "geometry lock" in printed
    steps = json.loads(out.read_text())["steps"]
    assert steps[1]["rmse_m_s"] < steps[0]["rmse_m_s"]


OWN = """
from sandbot_model.physics.effect import Effect, Parameter


class Hardening(Effect):
    identifier = "hardening"
    stage = "strength"
    formula = "k -> k (1 + a omega)"
    source = "test"
    seen_in = "v"
    parameters = (Parameter("a", "s", 0.0, 0.05, 0.01, "gain"),)

    def apply(self, chain, p):
        chain.k = chain.k * (1 + p["a"] * chain.omega)
"""


@pytest.mark.slow
def test_discover_on_the_command_line(table, tmp_path, capsys):
    """With a formula and a file of one's own, in two processes."""
    out, own = tmp_path / "out.json", tmp_path / "own.py"
    own.write_text(OWN)
    arguments = [str(table), "--max-effects", "1", "--workers", "2", "--json", str(out)]
    arguments += ["--html", str(tmp_path / "r.html"), "--effects-from", str(own)]
    arguments += ["--effect", "loss: speed: kept*(1 - a*omega/20); a [1] in 0..0.3"]
    assert discover_tool.main(arguments) == 0
    assert "verdict:" in capsys.readouterr().out
    content = json.loads(out.read_text())
    assert {"loss", "hardening"} <= {one["effect"] for one in content["candidates"]}
    assert (tmp_path / "r.html").stat().st_size > 1000


def test_the_catalogue_on_the_command_line(tmp_path, capsys):
    out = tmp_path / "effects.json"
    assert effects_tool.main(["--json", str(out)]) == 0
    assert "disturbed_ground" in capsys.readouterr().out
    named = [one["effect"] for one in json.loads(out.read_text())["effects"]]
    assert named == list(catalogue())
