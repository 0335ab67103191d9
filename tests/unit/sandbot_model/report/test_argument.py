"""The argument for a verdict: rivals, differences, next trials as a plan, profiles; nothing is judged anew."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from inline import Inline
from made_up import EFFECTS, made_up_trials

from sandbot_bringup.plan import read_plan, trials_of
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.compare import compare
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.next_trials import PENETRATION, NextTrial
from sandbot_model.discovery.selection import Selection
from sandbot_model.discovery.verdict import Verdict
from sandbot_model.explore import views
from sandbot_model.explore.session import Session
from sandbot_model.physics.observables import Observable
from sandbot_model.report import argument, model_difference, profiles, rivals, stages, table_sections
from sandbot_model.report.argument import MAX_REPLICATES, argument_page, plan
from sandbot_model.report.curves import steps
from sandbot_model.report.page import render
from sandbot_model.report.provenance import provenance
from sandbot_model.report.theme import DARK, LIGHT

TRIED = ("disturbed_ground", "leg_slip", "cable_drag", "exact_leg_arc", "crater_refill")
NEXT = (
    NextTrial(0.615, 12.5, "speed", ("leg_slip", "cable_drag"), 4.2, 170, gait="UNIFORM"),
    NextTrial(0.6, 8.0, "lift", ("leg_slip", "cable_drag"), 2.1, 3, gait="HGCS"),
    NextTrial(0.6, float("nan"), PENETRATION, ("leg_slip", "cable_drag"), 9.0, 2, 0.02),
)


@pytest.fixture(scope="module")
def trials():
    return made_up_trials(replicates=3, effect=("disturbed_ground", {"k_l_n_per_m": 172.0, "s_c": 0.95}))


@pytest.fixture(scope="module")
def found(trials):
    return discover(cells_of(trials), {name: EFFECTS[name] for name in TRIED}, max_effects=1)


@pytest.fixture(scope="module")
def undecided(found):
    """The same with another verdict: two sets explain the trials alike."""
    sets = (("leg_slip",), ("cable_drag",))
    (best,) = (fit for fit in found.fits if fit.effects == sets[0])
    verdict = Verdict("ambiguous", sets[0], sets, "2 sets do")
    return replace(found, verdict=verdict, steps=(found.steps[0], best), next_trials=NEXT)


@pytest.fixture(scope="module")
def shown(found):
    return steps(rivals.rivals(found))


def test_rivals_are_the_base_model_what_is_named_and_what_comes_next(found, undecided):
    assert found.verdict.effects == ("disturbed_ground",)
    named = [fit.effects for fit in rivals.rivals(found)]
    assert named[:2] == [(), ("disturbed_ground",)]
    assert len(named) == len(set(named)) > 2
    assert [fit.effects for fit in rivals.rivals(undecided)][:3] == [(), *undecided.verdict.alternatives]


def test_rivals_are_laid_over_each_other_and_the_chosen_one_is_thickest(shown):
    for chosen in range(len(shown)):
        spec = rivals.overlay(shown, chosen, LIGHT)
        legend = [trace for trace in spec["data"] if trace.get("showlegend")]
        assert [trace["name"] for trace in legend] == [step.label for step in shown]
        widths = [trace["line"]["width"] for trace in legend]
        assert widths.index(max(widths)) == chosen
        assert len({(trace["line"]["color"], trace["line"]["dash"]) for trace in legend}) == len(shown)


@pytest.mark.parametrize(("count", "said"), [(1, "by 1 model: "), (2, "by 2 models: ")])
def test_rivals_are_counted(found, shown, count, said):
    assert said in argument._rivals(shown[:count], found).figures[0].alt[0]


def test_a_gap_is_in_standard_deviations_of_a_trial_as_in_the_glossary(undecided):
    (section,) = table_sections.next_trials(undecided)
    assert "in standard deviations of one trial." in section.tables[0].caption


def test_controls_stand_with_the_next_trials_where_no_trial_distinguishes(undecided):
    controls = {"leg_slip": "rough legs slip less"}
    for trials, count in ((undecided.next_trials, 2), ((), 1)):
        (section,) = table_sections.next_trials(replace(undecided, controls=controls, next_trials=trials))
        assert len(section.tables) == count
        assert section.tables[-1].rows == [("leg slip", "rough legs slip less")]
    assert table_sections.next_trials(replace(undecided, next_trials=())) == []


def test_rivals_are_compared_by_fits_of_one_kind(found, shown):
    """What is named is reported with nuisance parameters; its rivals were fitted without."""
    assert found.fit.nuisances is not None
    tried = {fit.effects: fit.bic for fit in found.fits}
    best = min(tried[step.fit.effects] for step in shown)
    table = rivals.comparison_table(shown, found.fits)
    told = [float(row[1].replace("−", "-")) for row in table.rows]
    assert told == pytest.approx([tried[step.fit.effects] - best for step in shown], abs=0.05)
    assert "without nuisance parameters" in table.caption


def test_a_threshold_is_stated_alike_by_commands_page_and_argument(found, trials):
    """The deviance is a staircase along it: a derivative knows no error, and a number without one is not said."""
    name, known = "disturbed_ground.s_c", {"disturbed_ground": EFFECTS["disturbed_ground"]}
    session, chosen = Session(found.cells, Inline()), Selection(effects=("disturbed_ground",))
    shown, compared = session.ladder(chosen)[-1], compare(found.cells, EFFECTS, chosen.effects)
    told = dict(compared.fit.estimates())[name]
    assert "±" in told
    assert dict(shown.fit.estimates())[name] == "not determined"
    assert told in views.fitted_values(known["disturbed_ground"], session.with_final_errors(chosen))
    assert told in [said for _, said, _ in views.parameter_rows(chosen, shown, known)]
    # A value held by hand changes nothing of what is said of the others.
    assert told in [said for _, said, _ in views.parameter_rows(chosen.held("delta_t_s", 0.3), shown, known)]
    last = 2  # after the parameter and its unit
    assert told in [row[last] for row in table_sections.parameters(steps(compared)).tables[0].rows]
    # The argument is of a fit with nuisance parameters, and says so.
    argued = argument_page(found, provenance(trials, found.cells), title="test").sections[-1].tables[0]
    assert dict(found.fit.estimates())[name] in [row[last] for row in argued.rows]
    assert ("with nuisance parameters" in argued.caption) == (found.fit.nuisances is not None)


def test_no_parameter_is_stated_where_there_are_no_more_means_than_unknowns(trials):
    few = trials.select(np.arange(2))
    unknown = np.full(2, np.nan)
    cells = cells_of(replace(few, lift_m=unknown, peak_speed_m_s=unknown, first_step_m=unknown))
    shown = Session(cells, Inline()).step(Selection())
    assert shown.fit.goodness.dof <= 0
    assert {said for _, said, _ in views.parameter_rows(Selection(), shown, EFFECTS)} == {"not determined"}


def test_the_difference_of_two_models_is_that_of_their_predictions(shown):
    base, named, *_ = shown
    heat = model_difference.difference_map(base, named, "speed", LIGHT)["data"][-1]
    meant = 100 * (base.fit.predicted - named.fit.predicted)[:, Observable.speed]
    drawn = {told[1]: z for row, zs in zip(heat["customdata"], heat["z"], strict=True)
             for told, z in zip(row, zs, strict=True) if told[1] is not None}  # fmt: skip
    axes = model_difference.difference_map(base, named, "speed", LIGHT)["layout"]
    assert (axes["xaxis"]["categoryarray"], axes["yaxis"]["categoryarray"]) == (heat["x"], heat["y"])
    assert [drawn[cell] for cell in range(len(meant))] == pytest.approx(meant, abs=1e-4)
    largest = re.search(
        r"largest difference is (−?[\d.]+) cm/s", model_difference.difference_caption(base, named, "speed")
    )[1]
    assert float(largest.replace("−", "-")) == pytest.approx(meant[np.abs(meant).argmax()], abs=0.005)


def test_a_model_does_not_differ_from_itself(shown):
    heat = model_difference.difference_map(shown[1], shown[1], "lift", DARK)["data"][-1]
    assert {z for row in heat["z"] for z in row} == {0.0}
    assert "is 0.00 cm" in model_difference.difference_caption(shown[1], shown[1], "lift")
    fit = shown[1].fit
    assert not model_difference.gaps([fit, fit]).best
    assert "no trial tells these models apart" in model_difference.separation_caption(
        model_difference.gaps([fit, fit]), ()
    )


def test_the_map_of_differences_holds_the_next_trials_as_stars(shown, undecided):
    gaps = model_difference.gaps([step.fit for step in shown[:2]])
    best = max(gaps.best.values(), key=lambda trial: trial.expected_gap_sd)
    assert set(best.separates) == {"base", "disturbed_ground"}
    heat, stars = model_difference.separation_map(gaps, undecided.next_trials, LIGHT)["data"]
    assert max(told[0] for row in heat["customdata"] for told in row) == best.expected_gap_sd
    assert (stars["x"], stars["text"]) == ([12.5, 8.0], ["1", "2"])
    assert set(stars["y"]) <= set(heat["y"])


def test_the_plan_is_one_that_a_campaign_runs(undecided, tmp_path):
    path = tmp_path / "next.yaml"
    path.write_text(plan(undecided), encoding="utf-8")
    planned = trials_of(read_plan(path))
    asked = {(trial.phi, trial.omega_rad_s, trial.gait) for trial in planned}
    assert asked == {(0.615, 12.5, ""), (0.6, 8.0, "HGCS")}
    assert len(planned) == MAX_REPLICATES + 3
    assert yaml.safe_load(path.read_text(encoding="utf-8"))["gait"] == "UNIFORM"


def test_a_profile_rises_from_the_fit_as_its_standard_error_says(found):
    base = found.steps[0]
    names = base.model.names
    at = names.index("v_swim_m_s")
    values, rise = profiles.curve(base, at)
    assert rise.min() == pytest.approx(0.0, abs=0.05)
    here, error = base.parameters["v_swim_m_s"]
    assert np.interp(here + 2 * error * np.array([-1, 1]), values, rise) == pytest.approx([4.0, 4.0], rel=0.5)


def test_errors_are_correlated_with_themselves_and_no_more_than_that(found):
    values = profiles.correlation(found.fit.covariance)
    known = np.isfinite(np.diag(values))
    assert np.diag(values)[known] == pytest.approx(1.0)
    assert np.nanmax(np.abs(values)) <= 1 + 1e-9
    (step,) = steps([found.fit])
    drawn = profiles.correlations(step, LIGHT)
    names = drawn["data"][-1]["x"]
    assert names[:4] == ["Δt", "v<sub>swim</sub>", "k<sub>L</sub>", "s<sub>c</sub>"]
    assert drawn["layout"]["xaxis"]["categoryarray"] == drawn["layout"]["yaxis"]["categoryarray"] == names
    apart = np.nan_to_num(values)[: len(names), : len(names)] * (1 - np.eye(len(names)))
    said = re.search(r"Most correlated are .*: (−?[\d.]+)\.$", profiles.correlations_caption(step))[1]
    assert float(said.replace("−", "-")) == pytest.approx(apart.flat[np.abs(apart).argmax()], abs=0.005)


def test_unknowns_of_one_symbol_are_told_apart(found):
    """Two effects may use the same letter; on a map they would fall into one row."""
    model = EFFECTS["leg_slip"], EFFECTS["cable_drag"]
    names = [f"{effect.identifier}.{parameter.name}" for effect in model for parameter in effect.parameters]
    parameters = [replace(parameter, symbol="a") for effect in model for parameter in effect.parameters]
    fit = SimpleNamespace(model=SimpleNamespace(names=names, parameters=parameters), level_phi=[0.6])
    assert profiles.labels(fit) == ["leg slip a", "cable drag a", "k at φ 0.600"]


def test_a_stage_that_holds_is_said_to_hold(found):
    alpha = found.criteria.lack_of_fit
    failing = [stage for stage in found.stages if stage.p < alpha]
    assert failing
    said = stages.stages_caption(found.stages, alpha)
    assert all((f"{stage.stage} (" in said) == (stage in failing) for stage in found.stages)
    # One condition of many is missed by chance: p says whether the stage fails.
    held = [replace(stage, missed=found.stages[0].missed[:1], p=0.051) for stage in found.stages]
    assert "Every stage" in stages.stages_caption(held, alpha)
    for tested, outcome in ((held, "holds"), (failing, "fails")):
        titles = [one["text"] for one in stages.stage_map(tested, found.cells, alpha, LIGHT)["layout"]["annotations"]]
        assert all(f"</b>: {outcome}" in title for title in titles)


@pytest.mark.parametrize("verdict", ["found", "undecided"])
def test_the_page_argues_from_geometry_to_the_plan(verdict, trials, request):
    discovery = request.getfixturevalue(verdict)
    page = argument_page(discovery, provenance(trials, discovery.cells, []), title="<lab>", back="/?model=full")
    ids = [section.id for section in page.sections]
    assert ids == ["lock", "stages", "maps", "rivals", "difference", "next", "parameters"]
    for figure in (figure for section in page.sections for figure in section.figures):
        assert len(figure.draw(LIGHT)) in (1, len(page.steps))
        assert len(figure.alt) in (1, len(page.steps))
    html = render(page)
    assert 'href="/?model=full"' in html
    assert "&lt;lab&gt;" in html
    assert ('download="next.yaml"' in html) == (verdict == "undecided")
