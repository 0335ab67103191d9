"""What compare and discover print: the answer first, plain words, lines of a terminal, no number that can't be told."""

import io
import json
import re
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from sandbot_common import terminal
from sandbot_common.robot import SANDBOT
from sandbot_lab.direct import direct_trials
from sandbot_lab.world import null_world
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery import verdict
from sandbot_model.discovery.compare import compare as compare_fits
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.ladder import ladder_rows
from sandbot_model.discovery.next_trials import PENETRATION, NextTrial
from sandbot_model.discovery.selection import Selection
from sandbot_model.discovery.verdict import Verdict
from sandbot_model.explore import views
from sandbot_model.explore.actions import can_adopt, with_verdict
from sandbot_model.fitting.fit import fit
from sandbot_model.fitting.goodness import FAIL_Z
from sandbot_model.fitting.text import NO_ERROR, counted, table, to_error, wrapped
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_model.physics.observables import Observable
from sandbot_model.physics.variants import with_variants
from sandbot_model.report import captions, figure_sections, in_words, rivals, table_sections
from sandbot_model.report.curves import steps
from sandbot_model.report.in_words import no_trial
from sandbot_model.tools import answer, compare, tables
from sandbot_model.tools import discover as discover_tool
from sandbot_record.trials.table import Row, from_rows

EXAMPLE = Path(__file__).parents[4] / "examples" / "demo_trials.csv"
FEW = ("--workers", "1", "--max-effects", "1")
HEAD = "phi,omega_rad_s,speed_m_s\n"
ONE_CELL = f"{HEAD}0.633,16,0.203\n0.633,16,0.198\n"
NO_REPLICATES = f"{HEAD}0.633,16,0.203\n0.6,12,0.11\n0.633,12,0.15\n"


@pytest.fixture
def printed(capsys):
    def run(tool, *arguments):
        assert tool.main([str(one) for one in arguments]) == 0
        return capsys.readouterr().out

    return run


@pytest.fixture(scope="module")
def two(drawn):
    """A discovery in which cable drag and leg slip can't be told apart (a verdict put in by hand)."""
    few = {name: catalogue()[name] for name in ("leg_slip", "cable_drag")}
    found = discover(cells_of(drawn(("leg_slip",), levels=2, omega=(8, 14))), few, max_effects=1)
    verdict = Verdict("ambiguous", ("leg_slip",), (("leg_slip",), ("cable_drag",)), "2 sets explain the data equally")
    return replace(found, verdict=verdict, stability=1.0)


@pytest.fixture(scope="module")
def of_example():
    """Runs discover on the example and returns what it prints; the search is the same, and done once."""
    known = []

    def once(*arguments, **named):
        known[:] = known or [discover(*arguments, **named)]
        return known[0]

    def run(*options):
        with pytest.MonkeyPatch.context() as patch, redirect_stdout(io.StringIO()) as told:
            patch.setattr("sandbot_model.discovery.discover.discover", once)
            assert discover_tool.main([str(EXAMPLE), *FEW, *map(str, options)]) == 0
        return told.getvalue()

    return run


@pytest.fixture(scope="module")
def brief(tmp_path_factory, of_example):
    """What discover prints of the example, and its JSON."""
    path = tmp_path_factory.mktemp("brief") / "d.json"
    return of_example("--json", path), json.loads(path.read_text())


@pytest.mark.slow
def test_the_answer_comes_first_then_why_then_tables(brief):
    out, found = brief
    lines = out.splitlines()
    assert lines[0] == "verdict: identified: stance_overlap, if the robot was SandBot, which is assumed"
    assert lines[1] == "  stance_overlap: Both tripods standing at once hold each other back"
    assert re.match(r"  eta = 0\.12\d* ± 0\.0\d+, fraction of the speed lost", lines[2])
    assert lines[3:5] == [
        "  speed error out of sample: 1.09 → 0.50 cm/s (30 and 32 of 35 cells scored);",
        "    replicates scatter by 0.50 cm/s",
    ]
    order = [
        out.index(part)
        for part in (
            "verdict:",
            "- best in",
            "- a lift-scale error",
            "why: ",
            "105 trials in 35 cells",
            "noise floor",
            "Δχ²",
        )
    ]
    assert order == sorted(order)
    assert max(map(len, lines)) <= terminal.WIDTH
    assert "absent, at 95 %" not in out
    told = " ".join(out.split())
    assert all(clause in told for clause in found["verdict"]["because"].split("; "))
    assert "best in" not in told.split("why: ")[1]
    assert [note for note in found["data"]["notes"] if note not in told] == []
    assert [note.split(":")[0] for note in found["data"]["notes"]] == ["robot", "cameras", "bed", "order of trials"]


def test_a_model_that_needs_a_number_nobody_believes_explains_but_does_not_hold(two, monkeypatch):
    fit = two.fit
    assert answer.of_comparison([fit]).startswith(f"{fit.name} holds: ")
    name, value = next((one, value) for one, (value, _) in fit.parameters.items() if "." in one)
    monkeypatch.setattr(verdict, "doubtful_parameters", lambda _: [name])
    told = " ".join(answer.of_comparison([fit]).split())
    assert "fails" not in told
    assert f"{fit.name} explains the data (lack of fit p = {fit.lack_of_fit_p:.2g})" in told
    assert f"but only with {name} = {value:.4g} (plausible: " in told


def test_no_standard_error_is_given_where_a_model_fails_and_that_is_said(two, monkeypatch):
    monkeypatch.setattr(answer, "calibrated", lambda *_: None)
    fit = two.fit
    failing = replace(fit, goodness=replace(fit.goodness, lack_of_fit_p=1e-9))
    assert [one.to_dict()["errors_hold"] for one in (fit, failing)] == [True, False]
    for told in (answer.of_comparison([failing]), tables.parameters(failing)):
        assert "±" not in told
        assert NO_ERROR in " ".join(told.split())
    # Control.
    for told in (answer.of_comparison([fit]), tables.parameters(fit)):
        assert "±" in told
        assert NO_ERROR not in " ".join(told.split())


def test_nor_does_a_base_model_with_a_response_time_at_its_bound(drawn):
    base = fit(model_of("simple", (), catalogue()), cells_of(drawn()))
    vars(base)["implausible"] = ()
    assert answer.of_comparison([base]).startswith("simple model holds: ")
    vars(base)["implausible"] = ("delta_t_s",)
    told = " ".join(answer.of_comparison([base]).split())
    assert told.startswith("simple model explains the data (")
    assert "but only with delta_t_s = 0.4" in told


@pytest.mark.parametrize("left_out", [0, 1])
def test_an_error_out_of_sample_says_how_many_cells_are_scored_unless_all_are(two, left_out):
    count = len(two.cells) - left_out
    fit, whole = replace(two.fit), replace(two.fit)
    vars(fit)["cross_validation"] = replace(two.fit.cross_validation, cells=count)
    vars(whole)["cross_validation"] = replace(two.fit.cross_validation, cells=len(two.cells))
    said = f" ({count} of {len(two.cells)} cells scored)" if left_out else ""
    assert f"out of sample{said}" in repr(fit)
    assert f"out of sample{said}<" in fit._repr_html_()
    assert answer.errors([fit]).split(" cm/s", 1)[1].startswith(f"{said};")
    both = f" ({count + 1} and {count} of {len(two.cells)} cells scored)" if left_out else ""
    assert answer.errors([whole, fit]).split(" cm/s", 1)[1].startswith(f"{both};")
    shown = steps([fit])
    assert f"out of sample{said};" in captions.ladder(shown, 0.005)
    assert f"out of sample{said};" in views.status(Selection(), shown[0], 0.005)
    assert f"{count} of {len(two.cells)}" in figure_sections._errors(shown).rows[0]


def test_cells_of_two_gaits_at_one_phi_and_omega_count_apart_wherever_they_are_counted(drawn):
    trials = drawn(levels=2, omega=(8, 14, 20))
    twice = trials.select(np.tile(np.arange(len(trials)), 2))
    # No geometry lets the body go by twice what its lift allows.
    twice = replace(twice, gait=np.repeat(["UNIFORM", "SGCS"], len(trials)), speed_m_s=2 * twice.speed_m_s)
    cells = cells_of(twice)
    (fitted,) = compare_fits(cells, {}, [])
    missed = int((np.abs(np.nan_to_num(fitted.residual_z)) > FAIL_Z).any(axis=1).sum())
    assert missed > len({(fail.phi, fail.omega_rad_s) for fail in fitted.fails})
    shown = steps([fitted])
    assert f", {missed} of {len(cells)} cells missed" in answer.of_comparison([fitted])
    assert ladder_rows([fitted])[1][-1] == str(missed)
    assert rivals.comparison_table(shown, [fitted]).rows[0][-1] == str(missed)
    assert figure_sections._errors(shown).rows[0][-1] == f"{missed} of {len(cells)}"
    assert f"; {missed} of {len(cells)} conditions fail." in views.status(Selection(), shown[0], 0.005)


def test_what_is_held_by_hand_has_no_error(printed, tmp_path):
    out = tmp_path / "c.json"
    held = ("--effects", "stance_overlap", "--hold", "stance_overlap.eta=0.1", "--json", out)
    told = printed(compare, EXAMPLE, *held)
    (line,) = (line for line in told.splitlines() if line.startswith("stance_overlap.eta"))
    assert line.split() == ["stance_overlap.eta", "0.1,", "held"]
    assert "last step held by hand: stance_overlap.eta = 0.1; nothing is refitted" in told
    assert "plausible" not in told
    assert " → – cm/s (" in told  # no error out of sample
    head = " ".join(told.split()).partition(" stance_overlap: ")[0]
    assert "+ stance_overlap at stance_overlap.eta = 0.1 (held) holds: " in head
    assert told.count("eta = ") == 2
    assert " \n" not in told
    fitted_step, held_step = json.loads(out.read_text())["steps"][1:]
    fitted, by_hand = fitted_step["parameters"], held_step["parameters"]
    assert by_hand["stance_overlap.eta"] == {"value": 0.1, "stderr": None}
    assert fitted["stance_overlap.eta"]["stderr"] > 0
    assert by_hand["delta_t_s"] == fitted["delta_t_s"]
    assert held_step["k_n_per_m"] == fitted_step["k_n_per_m"]
    assert held_step["cv_rmse_m_s"] is None


def test_a_value_held_beyond_its_plausible_range_is_noted_and_has_its_unit(printed):
    told = printed(compare, EXAMPLE, "--hold", "delta_t_s=1.5")
    assert "note: delta_t_s = 1.5 s is held outside its plausible range, 0.1 to 1.2 s" in told
    (line,) = (line for line in told.splitlines() if line.startswith("delta_t_s"))
    assert line.split() == ["delta_t_s", "1.5", "s,", "held"]


def test_a_speed_of_swimming_that_nothing_depends_on_is_at_no_bound(drawn):
    mixed = drawn((), levels=3, omega=(4, 8, 12, 30))
    walking = mixed.select(mixed.lift_m > 4e-3)
    told = [tables.parameters(fit(model_of("simple", (), {}), cells_of(trials))) for trials in (walking, mixed)]
    assert ["no cell swims" in one for one in told] == [True, False]
    assert "at its bound" not in told[0]


@pytest.mark.parametrize("draws", ["0", "1", "-3"])
def test_draws_that_tell_no_spread_are_refused_before_anything_is_read(draws, capsys):
    assert compare.main(["nowhere.csv", "--bootstrap", draws]) == 2
    assert f"--bootstrap {draws}: 2 or more draws are needed" in capsys.readouterr().err


def test_what_a_file_defines_and_nobody_asked_to_fit_is_named(printed, tmp_path):
    table, own = tmp_path / "t.csv", tmp_path / "boost.py"
    table.write_text(ONE_CELL)
    own.write_text(
        "from sandbot_model import Effect\n\n\nclass Boost(Effect):\n"
        '    identifier, stage, formula, source, seen_in = "boost", "strength", "k -> 2*k", "me", "v"\n\n'
        "    def apply(self, chain, p):\n        chain.k = 2 * chain.k\n"
    )
    told = "not fitted: boost of --effects-from; --effects boost adds it"
    assert told in printed(compare, table, "--effects-from", own)
    assert "not fitted" not in printed(compare, table, "--effects-from", own, "--effects", "boost")


@pytest.mark.parametrize("declared", ["", "; a [1] in 0..0.5"])
def test_of_an_effect_without_parameters_it_is_said_that_none_is_fitted(two, declared):
    """An undeclared a is the advance; a parameter is usually called so."""
    brake = catalogue(formulas=[f"brake: speed: kept *= 1 - a{declared}"])
    told = " ".join(answer.of_comparison([fit(model_of("simple", ("brake",), brake), two.cells)]).split())
    assert ("no parameter is fitted: every name in kept -> kept * (1 - a) is a quantity" in told) == (not declared)
    assert ("a = " in told) == bool(declared)


@pytest.mark.slow
def test_verbose_prints_all(of_example, brief):
    less, all_of_it = brief[0], of_example("--verbose")
    for part in ("absent, at 95 %", "mean speed and step from lift", "delta_t_s", "motor_saturation", "crater_refill"):
        assert part in all_of_it
    assert "more (--verbose)" in less
    assert "more (--verbose)" not in all_of_it
    assert set(less.split("\n\n")[0].split()) <= set(all_of_it.split())


@pytest.mark.parametrize("content", [ONE_CELL, NO_REPLICATES], ids=["one cell", "no replicates"])
@pytest.mark.parametrize("tool", [compare, discover_tool])
def test_what_cannot_be_told_is_not_printed(content, tool, printed, tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(content)
    out = printed(tool, path)
    assert not re.search(r"\bnan\b|\b1 (cells|volume fractions|trials|conditions|degrees)\b", out)
    # As many parameters as means: no value has an error, so none is given.
    assert "delta_t_s" not in out
    assert "missed by more" not in out
    assert ("noise floor" in out) == (content == ONE_CELL)
    assert ("replicates scatter by" in out) == (content == ONE_CELL)


def test_what_a_test_lacks_is_named(printed, tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(ONE_CELL)
    assert "can't be tested: 1 cell mean can't determine 3 parameters\n" in printed(compare, path)
    rows = [Row(**row) for row in direct_trials(null_world(), [0.6, 0.633], [4.0, 8.0, 12.0, 16.0], replicates=1)]
    told = answer.of_comparison([fit(model_of("simple", (), {}), cells_of(from_rows(rows)))])
    assert told.startswith("simple model can't be tested: replicates, or error bars, are needed\n")


@pytest.mark.parametrize("bars", [True, False], ids=["error bars", "replicates"])
def test_what_gives_the_noise_is_named(bars):
    count = 1 if bars else 3
    rows = [
        Row(**row) for row in direct_trials(null_world(), [0.6, 0.62, 0.633], [4.0, 8.0, 12.0, 16.0], replicates=count)
    ]
    if bars:
        none = {name: float("nan") for name in ("replicate", "lift_m", "peak_speed_m_s", "first_step_m")}
        rows = [replace(row, speed_sd_m_s=0.05, **none) for row in rows]
    told = answer.of_comparison([fit(model_of("simple", (), {}), cells_of(from_rows(rows)))])
    assert ("; error bars of 5.0 cm/s" in told) == ("holds: its misfit is within the error bars" in told) == bars
    assert (
        ("replicates scatter by" in told) == ("holds: its misfit is within the scatter of replicates" in told) != bars
    )


def test_of_a_class_the_class_is_said_and_not_its_first(two):
    told = answer.of_discovery(two)
    assert told.startswith("verdict: ambiguous: one of 2 sets of effects, these data can't tell which\n")
    assert "  leg_slip: A shallow leg slips back through the grains\n" in told
    assert "  cable_drag: The cable holds back, the leg creeps\n" in told
    assert "one of these is the best in 100 % of bootstrap draws" in " ".join(told.split())
    assert two.headline == "ambiguous: one of 2 sets: leg_slip; cable_drag"
    assert not can_adopt(two)


def test_what_is_unexplained_may_be_another_robot_where_none_is_named(two):
    found = replace(two, verdict=Verdict("unexplained", (), (), "no set fits"), stability=np.nan)
    assert answer.of_discovery(found, None).startswith(
        "verdict: unexplained, if the robot was SandBot, which is assumed\n"
    )
    assert answer.of_discovery(found, SANDBOT).startswith("verdict: unexplained\n")


def test_the_verdict_names_a_robot_and_a_gait_that_are_assumed(two):
    nameless = replace(two, steps=tuple(replace(step, cells=nameless_gait(step.cells)) for step in two.steps))
    nameless = replace(nameless, cells=nameless_gait(two.cells))
    heads = {}
    for status in ("adequate", "identified", "ambiguous", "partial", "unexplained", "untested"):
        verdict = replace(two.verdict, status=status)
        for given, found, robot in ((True, two, SANDBOT), (False, nameless, None)):
            head = " ".join(answer.of_discovery(replace(found, verdict=verdict), robot).split("\n  ")[0].split())
            heads[status, given] = "if the robot was SandBot and the gait was SGCS, which is assumed" in head
    assert {status for (status, given), named in heads.items() if named} == {
        "adequate", "identified", "ambiguous", "partial", "unexplained"
    }  # fmt: skip
    assert not any(named for (_, given), named in heads.items() if given)


def nameless_gait(cells):
    return replace(cells, gait=("",) * len(cells))


def test_a_base_model_that_holds_only_off_calibration_says_so_in_its_first_line(two, drawn):
    """As compare does, by the same test; controls: nothing off, and more off than calibration can explain."""
    first, trials = {}, drawn(())
    for off_m in (0.0, 1e-3, 5e-3):
        base = fit(model_of("simple", (), {}), cells_of(replace(trials, lift_m=trials.lift_m + off_m)))
        told = " ".join(answer.of_comparison([base]).split("\n  ")[0].split())
        first[off_m] = "model holds: " in told, "model fails: " in told, "allowing for a lift-zero error of" in told
    assert first == {0.0: (True, False, False), 1e-3: (False, True, True), 5e-3: (False, True, False)}
    verdict = Verdict("adequate", (), (), "")
    assert replace(two, verdict=verdict, allowing="a drift").headline == "adequate, allowing for a drift"
    assert replace(two, verdict=verdict).headline == "adequate"


@pytest.mark.parametrize("because", ["a formula fits better: k differs", "no set fits"])
def test_a_formula_is_told_once(two, because):
    formula = SimpleNamespace(sentence="k differs", options="--effect 'f'")
    verdict = Verdict("unexplained", (), (), because)
    told = answer.of_discovery(replace(two, verdict=verdict, stability=np.nan, residual=formula))
    assert told.count("k differs") == 1
    assert ("what is left: " in told) == (because == "no set fits")
    assert "try: compare DATA --effect 'f'" in told


def test_why_no_trial_is_proposed_and_what_to_do_instead(two):
    def why(status, *proposed, found=two):
        return no_trial(replace(found, verdict=Verdict(status, (), (), ""), next_trials=proposed))

    reading = NextTrial(0.6, np.nan, PENETRATION, ("leg_slip", "cable_drag"), 3.0, 4, 0.01)
    assert why("adequate", reading) == "no trial is proposed: only a penetrometer would show the difference"
    needless = "no trial is proposed: none is needed, or none within reach would help"
    assert why("identified") == needless
    worst = two.fits[-1].fails[0]
    missed = replace(two, fits=two.fits[-1:])
    again = f"none holds; repeat on another day what is missed most (φ {worst.phi:.3f}, ω {worst.omega_rad_s:.3g} rad/s"
    for status in ("partial", "unexplained"):
        assert again in why(status, found=missed)
    # Controls: the lift is asked for only where it is lacking.
    assert "lift" not in why("unexplained", found=missed)
    mean = two.cells.mean.copy()
    mean[:, Observable.lift] = np.nan
    lacking = replace(missed, cells=replace(two.cells, mean=mean))
    assert why("unexplained", found=lacking).endswith("; measure the lift, which names most effects")
    assert why("identified", found=lacking) == needless


def test_where_the_robot_is_in_doubt_its_legs_are_to_be_measured(two, monkeypatch):
    """Trials would not help, nor does it matter what is missed."""
    found = replace(two, verdict=Verdict("unexplained", (), (), ""), next_trials=())
    for doubted, first in (
        (("lift with speed and peak speed agree on a leg radius of 3 cm",), "measure the robot's legs first"),
        ((), "give the trials of each robot or set-up as a table of its own first"),
    ):
        monkeypatch.setattr(in_words, "in_doubt", lambda cells: "in doubt")
        monkeypatch.setattr(in_words, "doubts", lambda cells, doubted=doubted: doubted)
        assert no_trial(found).startswith(f"no trial is proposed: {first}")
    monkeypatch.undo()
    assert "legs" not in no_trial(found)


def test_a_plan_is_offered_for_trials_but_not_for_readings(two):
    trial = NextTrial(0.6, 9.0, "lift", ("leg_slip", "cable_drag"), 3.0, 3)
    reading = NextTrial(0.6, np.nan, PENETRATION, ("leg_slip", "cable_drag"), 3.0, 4, 0.01)
    asked = [
        " ".join(answer.of_discovery(replace(two, next_trials=one)).split()) for one in ((reading,), (reading, trial))
    ]
    assert all("ask: 4 readings at φ 0.600, 1.0 cm deep, and look at penetration_force" in told for told in asked)
    assert "--plan" not in asked[0]
    assert "runs all 3 proposed trials" in asked[1]


def test_of_one_that_is_identified_it_is_said_and_offered(two):
    found = replace(two, verdict=replace(two.verdict, status="identified", alternatives=(("leg_slip",),)))
    assert answer.of_discovery(found).startswith("verdict: identified: leg_slip\n")
    assert " - best in 100 % of bootstrap draws why: " in " ".join(answer.of_discovery(found).split())
    assert can_adopt(found)


@pytest.mark.parametrize("variant", ["the first step spared", ""])
def test_how_to_repeat_another_convention_is_said_and_switched_on(two, variant):
    """What is said, and what the explorer switches on, gives the same fit; control: the catalogue's convention."""
    effects = with_variants({"leg_slip": variant} if variant else {}, catalogue())
    fit = compare_fits(two.cells, effects, ["leg_slip"]).fit
    found = replace(
        two, steps=(two.steps[0], fit), verdict=replace(two.verdict, status="identified", alternatives=(("leg_slip",),))
    )
    told, adopted = answer.of_discovery(found), with_verdict(Selection(), found)
    assert ("has the catalogue's convention" in " ".join(told.split())) == bool(variant)
    assert (adopted.effects, len(adopted.formulas)) == (("leg_slip_variant",), 1) if variant else (("leg_slip",), 0)
    if variant:
        assert f"compare DATA --model simple --effect '{adopted.formulas[0]}'" in told
        again = compare_fits(two.cells, catalogue(formulas=adopted.formulas), adopted.effects).fit
        assert again.deviance == pytest.approx(fit.deviance, abs=0.01)


def test_why_one_model_has_two_numbers_is_said_below_the_ladder(two):
    assert two.fit.nuisances is not None
    told = " ".join(tables.ladder_of(two).split())
    assert told.endswith("Without them: compare, p in 'why' and the single effects below.")
    scatters = replace(two.fit.nuisances, names=("ln_k", *two.fit.nuisances.names[1:]))
    rough = replace(two, steps=(*two.steps[:-1], replace(two.fit, nuisances=scatters)))
    of_batches = ", differences between batches or conditions)"
    assert [of_batches in " ".join(tables.ladder_of(each).split()) for each in (two, rough)] == [False, True]
    beside = replace(two, fits=tuple(replace(one, nuisances=two.fit.nuisances) for one in two.fits))
    assert " ".join(tables.ladder_of(beside).split()).endswith("Without them: compare.")
    plain = replace(two, steps=(*two.steps[:-1], replace(two.fit, nuisances=None)))
    assert tables.ladder_of(plain) == tables.ladder(plain.steps)


def test_a_candidate_that_is_not_named_for_its_values_is_marked(two, monkeypatch):
    """One stood between the two alternatives without a word why it was none."""
    found = replace(two, verdict=replace(two.verdict, alternatives=(("leg_slip",),)))
    assert all(one.delta_bic < 0 for one in found.candidates)
    assert "*" not in tables.candidates(found, 5)
    monkeypatch.setattr(verdict, "doubtful_parameters", lambda _: ["delta_t_s"])
    told = tables.candidates(found, 5)
    assert "\ncable_drag *" in told
    assert "leg_slip *" not in told
    assert "* only with implausible values, so not named: cable_drag with delta_t_s = 0." in " ".join(told.split())
    (section,) = table_sections.candidates(found)
    assert [row[0] for row in section.tables[0].rows if "*" in row[0]] == ["cable drag *"]
    assert "so not named: cable drag with delta_t_s = 0." in section.tables[0].caption
    # Control: one that fails is not named for that.
    failing = [replace(one, goodness=replace(one.goodness, lack_of_fit_p=1e-9)) for one in found.fits]
    assert "*" not in tables.candidates(replace(found, fits=tuple(failing)), 5)


@pytest.mark.parametrize(
    ("value", "error", "told"),
    [
        (1.0912, 0.075, "1.09"),
        (0.508, 0.043, "0.51"),
        (12.3, 4.0, "12"),
        (0.474, 0.12, "0.47"),
        (0.02034, 0.0017, "0.0203"),
        (0.5, float("nan"), "0.5"),
        (float("nan"), 0.1, "–"),
    ],
)
def test_a_number_ends_where_its_error_begins(value, error, told):
    assert to_error(value, error) == told


def test_one_is_singular():
    assert [counted(n, "cell") for n in (0, 1, 2)] == ["0 cells", "1 cell", "2 cells"]


def test_a_cell_of_a_table_may_have_several_lines():
    told = table([["at", "a\nb"], ["x\ny", "1"], ["z", "22"]]).splitlines()
    assert told == ["     a", "at   b", "--  --", "x    1", "y", "z   22"]
    assert table(wrapped([["at", "said"], ["x", "word " * 40]])).count("\n") > 3


@pytest.mark.parametrize(
    ("terminal_there", "environment", "coloured"),
    [(True, {}, True), (False, {}, False), (True, {"NO_COLOR": "1"}, False), (True, {"TERM": "dumb"}, False)],
)
def test_colour_is_for_terminals_that_want_it(terminal_there, environment, coloured, monkeypatch):
    for name in ("NO_COLOR", "TERM"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr("sys.stdout.isatty", lambda: terminal_there, raising=False)
    assert terminal.styled("verdict", "good") == ("\x1b[1;32mverdict\x1b[0m" if coloured else "verdict")
