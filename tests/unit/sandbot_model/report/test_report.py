"""The report: one file, nothing from the network, every number with its unit, honest about what it can't show."""

import csv
import io
import json
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from made_up import EFFECTS, made_up_trials

from sandbot_common.robot import SANDBOT
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.compare import compare
from sandbot_model.discovery.criteria import Criteria
from sandbot_model.discovery.next_trials import NextTrial
from sandbot_model.discovery.reproduce import steps_of
from sandbot_model.discovery.result import Discovery
from sandbot_model.discovery.selection import Selection
from sandbot_model.discovery.verdict import Verdict, claim_threshold
from sandbot_model.fitting.goodness import Fail
from sandbot_model.physics.observables import COLUMNS
from sandbot_model.physics.typeset import mathml_lines, plain
from sandbot_model.report import atlas_section, text, write_comparison, write_report
from sandbot_model.report.curves import steps
from sandbot_model.report.data_section import cells_csv, data, json_download
from sandbot_model.report.in_words import in_three_sentences
from sandbot_model.report.page import Page, Section, for_script, render
from sandbot_model.report.provenance import limits, provenance
from sandbot_model.report.supplement import methods
from sandbot_model.report.table_sections import _added, _formulas, failing
from sandbot_model.report.view import Provenance, Step
from sandbot_model.tools.tables import fails, ladder


@pytest.fixture(scope="module")
def trials():
    return made_up_trials()


@pytest.fixture(scope="module")
def fits(trials):
    return compare(cells_of(trials), EFFECTS, ["leg_slip"])


@pytest.fixture(scope="module")
def discovery(fits):
    because = "made up for this test: <b>nothing</b> & no one"
    return Discovery(
        model="simple", cells=fits[0].cells, noise_floor={"speed": 0.005}, steps=fits,
        candidates=(), verdict=Verdict("ambiguous", ("leg_slip",), (("leg_slip",), ("cable_drag",)), because),
        next_trials=(NextTrial(0.633, 22.0, "first_step", ("leg_slip", "cable_drag"), 4.25, 2),),
        criteria=Criteria(claim=30.5, clearly=7.5),
    )  # fmt: skip


@pytest.fixture(scope="module")
def page(tmp_path_factory, discovery, trials):
    path = tmp_path_factory.mktemp("report") / "report.html"
    frames = [(b"\xff\xd8\xff\xe0 jpeg", "dorsal, t = 1.20 s"), (b"\x89PNG\r\n\x1a\n", "lateral")]
    write_report(path, discovery, trials, title="Trial <run> & co", frames=frames)
    return path.read_text(encoding="utf-8")


@pytest.fixture
def no_plates(monkeypatch):
    """No figures of the atlas: they take ten times as long as the rest of a page."""
    monkeypatch.setattr(atlas_section, "PLATES", ())


def without_plotly(page):
    """The page without the library, which is large and has addresses in its comments."""
    longest = max(re.findall(r"<script>(.*?)</script>", page, flags=re.DOTALL), key=len)
    assert len(longest) > 1_000_000
    return page.replace(longest, "")


def figures_of(page):
    return json.loads(re.search(r'<script type="application/json" id="figures">(.*?)</script>', page, re.DOTALL)[1])


def table(page, heading):
    section = page[page.index(f">{heading}</h2>") :]
    return re.sub(r"\s+", " ", re.sub("<[^>]+>", " ", section[: section.index("</section>")]))


@pytest.mark.usefixtures("no_plates")
def test_formulas_of_the_effects_are_typeset(page, fits, tmp_path, trials):
    """One effect in the last step: the catalogue's statements, each on its line, and where they are seen; the base
    model alone has none.
    """
    (block,) = re.findall(r"<td[^>]*>(<div.*?</div>)</td>", page)
    lines = ["".join(line.itertext()) for line in ElementTree.fromstring(f"<td>{block}</td>")]
    said = [ElementTree.fromstring(line) for line in mathml_lines(EFFECTS["leg_slip"].formula)]
    assert lines == [*("".join(line.itertext()) for line in said), f"seen in: {plain(EFFECTS['leg_slip'].seen_in)}"]
    write_comparison(tmp_path / "base.html", fits[:1], trials, title="base model")
    assert "<math" not in without_plotly((tmp_path / "base.html").read_text(encoding="utf-8"))


def test_words_of_a_users_own_effect_stay_words(fits):
    named = SimpleNamespace(identifier="mine", stage="step", formula="s <script>", seen_in="<b>steps</b>")
    found = SimpleNamespace(fit=SimpleNamespace(model=SimpleNamespace(effects=(named,))))
    (effects,) = _formulas([found])
    page = render(Page("t", "k", (), (Section("s", "S", tables=(effects,)),)))
    assert "<script>alert" not in page
    assert "s &lt;script&gt;" in page
    assert "&lt;b&gt;steps" in page


def test_the_page_asks_nothing_of_any_network(page):
    own = without_plotly(page)
    assert not re.findall(r"(?:src|href)\s*=\s*[\"'](?!data:|#)", own)
    assert "http://" not in own
    assert "https://" not in own
    assert "@import" not in own
    assert "url(" not in own


def test_verdict_stands_first_with_its_numbers(page, fits):
    head = re.sub("<[^>]+>", " ", page[page.index("<header>") : page.index("</header>")])
    assert "Ambiguous." in head
    assert f"from {100 * fits[0].rmse_m_s:.2f} cm/s to {100 * fits[1].rmse_m_s:.2f} cm/s" in head
    assert "noise floor is 0.50 cm/s" in head


def head_of(path):
    page = path.read_text(encoding="utf-8")
    return re.sub(r"\s+", " ", re.sub("<[^>]+>", " ", page[page.index("<header>") : page.index("</header>")]))


@pytest.mark.usefixtures("no_plates")
def test_each_effect_named_is_told_in_words_with_its_numbers(tmp_path, discovery, fits, trials):
    """Of a set that is identified, and of all that can't be told apart; control: nothing is named."""
    identified = replace(
        discovery.verdict, status="identified", alternatives=(("leg_slip",),), because="leg_slip it is"
    )
    other = compare(cells_of(trials), EFFECTS, ["cable_drag"])[-1]
    for name, verdict, tried in (
        ("one", identified, ()),
        ("two", discovery.verdict, (fits[-1], other)),
        ("none", Verdict("adequate", (), (), "nothing is missing"), ()),
    ):
        found = replace(discovery, verdict=verdict, fits=tried, steps=fits[: 1 if name == "none" else 2])
        write_report(tmp_path / f"{name}.html", found, replace(trials, robot=SANDBOT), title=name)
    one, two, none = (head_of(tmp_path / f"{name}.html") for name in ("one", "two", "none"))
    assert "Identified. The simple model lacks leg slip, and with it explains these data. Every other" in one
    assert "Ambiguous. The simple model lacks something: leg slip or cable drag would explain these data. These" in two
    assert "Adequate. The simple model explains these data" in none
    assert "Next: 2 trials at φ 0.633, ω 22 rad/s, watching first step" in one
    assert "Why, in numbers Leg slip it is. With leg slip the error" in one
    slip = (
        f"A shallow leg slips back through the grains. slip at depth d_r: {fits[-1].parameter_text('leg_slip.sigma')}"
    )
    drag_n = other.parameter_text("cable_drag.f_c_n")
    drag = f"The cable holds back, the leg creeps. drag of the cable on one leg: {drag_n} N"
    assert f"Leg slip: {slip}" in one
    assert "Either leg slip" not in one
    assert f"Either leg slip: {slip}" in two
    assert f"Or cable drag: {drag}" in two
    assert "With any of them the error of mean speed goes from" in two
    assert f"Error, + leg slip {100 * fits[-1].rmse_m_s:.2f} cm/s" in two
    assert f"Error, + cable drag {100 * other.rmse_m_s:.2f} cm/s" in two
    assert "grains" not in none


@pytest.mark.usefixtures("no_plates")
def test_sets_that_can_not_be_told_apart_are_shown_alike(tmp_path, discovery, fits, trials):
    other = compare(cells_of(trials), EFFECTS, ["cable_drag"])[-1]
    write_report(tmp_path / "r.html", replace(discovery, fits=(fits[-1], other)), trials, title="r")
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert re.findall(r"<li data-rung=\"\d\">(.*?)<small>", page) == ["simple model", "+ leg slip", "+ cable drag"]
    assert 'step="1" value="1"' in page
    assert "parameter unit simple model + leg slip + cable drag" in table(page, "Parameters")
    assert {"leg slip step", "cable drag step"} <= set(
        re.findall("(?:leg slip|cable drag) step", table(page, "Parameters"))
    )
    assert {trace["mode"] for trace in figures_of(page)["ladder"]["light"][0]["data"][:2]} == {"markers"}
    assert "Error of each model" in page


@pytest.mark.usefixtures("no_plates")
def test_a_verdict_depends_on_a_robot_nobody_named(tmp_path, discovery, fits, trials):
    def head(status, robot):
        found = replace(discovery, verdict=Verdict(status, (), (), "no set fits"), steps=fits[:1])
        write_report(tmp_path / "r.html", found, replace(trials, robot=robot), title="r")
        return head_of(tmp_path / "r.html")

    assert "Unexplained. If the robot was SandBot, which is assumed, the simple model is" in head("unexplained", None)
    assert "Unexplained. The simple model is" in head("unexplained", SANDBOT)
    assert "Adequate. If the robot was SandBot, which is assumed, the simple model explains" in head("adequate", None)
    assert "Untested. These data can" in head("untested", None)


STATUSES = ("adequate", "identified", "ambiguous", "partial", "unexplained", "untested")


@pytest.mark.parametrize("status", STATUSES)
def test_the_first_sentences_of_a_verdict_hold_no_statistic(discovery, status):
    said = in_three_sentences(replace(discovery, verdict=replace(discovery.verdict, status=status)), SANDBOT)
    assert re.findall(r"[.](?: |$)", said) == [". ", ". ", "."]
    assert not re.search(r"Δ|deviance|BIC| p |dof|degrees|%|lack of fit", said)
    assert "Next: 2 trials" in said


def test_what_fits_as_well_in_another_form_is_named_in_the_first_sentences(discovery):
    found = replace(discovery, verdict=replace(discovery.verdict, status="identified"))
    assert "every other explanation that was tried fits clearly worse" in in_three_sentences(found, SANDBOT).lower()
    slope, slip = (SimpleNamespace(effects=(name,)) for name in ("bed_slope", "leg_slip"))
    said = in_three_sentences(replace(found, alike=(slope, slip, slope)), SANDBOT)
    assert "in another form bed slope and leg slip would fit as well." in said
    assert "every other explanation" not in said.lower()


def test_what_the_user_wrote_can_not_become_markup(page):
    assert "<title>Trial &lt;run&gt; &amp; co</title>" in page
    assert "&lt;b&gt;nothing&lt;/b&gt; &amp; no one" in page
    assert "<b>nothing" not in page
    assert json.loads(for_script("</script><!--\u2028")) == "</script><!--\u2028"
    assert "<" not in for_script("</script>")


def test_every_figure_is_there_for_every_step_in_both_themes(page):
    figures = figures_of(page)
    names = {
        "speed",
        "ladder",
        "lock",
        "collapse",
        "step",
        "balance",
        *(f"residuals-{n}" for n in ("speed", "lift", "peak_speed", "first_step")),
    }
    assert set(figures) == names
    for name, themes in figures.items():
        assert set(themes) == {"light", "dark"}
        assert {len(specs) for specs in themes.values()} == ({1} if name == "lock" else {2})
        assert f'role="group" aria-labelledby="says-{name}"' in page
        assert f'id="plot-{name}"' in page
        assert f'id="says-{name}"' in page


def test_a_slider_goes_over_the_steps_and_each_figure_says_what_it_shows_in_each(page, fits):
    own = without_plotly(page)
    assert re.search(r'<input type="range" id="rung" min="0" max="1" step="1" value="1"', own)
    for i, fit in enumerate(fits):
        assert re.search(rf'data-rung="{i}">[^<]+<small>error {100 * fit.rmse_m_s:.2f} cm/s</small>', own)
    says = own[own.index('id="says-residuals-speed"') :]
    assert re.findall(r'data-step="(\d)"', says[: says.index("</p>")]) == ["0", "1"]
    for kind in ("svg", "png", "csv"):
        assert f'data-figure="balance" data-format="{kind}"' in own


def test_no_two_things_on_the_page_have_one_name(page):
    names = re.findall(r'\sid="([^"]+)"', without_plotly(page))
    assert len(names) == len(set(names))


@pytest.mark.usefixtures("no_plates")
def test_one_step_needs_no_slider(tmp_path, fits, trials):
    write_comparison(tmp_path / "one.html", fits[:1], trials, title="one")
    assert 'id="rung"' not in without_plotly((tmp_path / "one.html").read_text(encoding="utf-8"))


def test_parameters_have_units_and_errors(page, fits):
    words = table(page, "Parameters")
    last, base = (text.with_error(*fit.parameters["delta_t_s"]) for fit in (fits[1], fits[0]))
    assert f"time in which the body is brought to leg speed s {last} {base}" in words
    assert "parameter unit + leg slip simple model" in words
    assert "k at φ = 0.600, stiffness of the ground under a leg N/m" in words


def test_a_step_is_headed_by_what_it_adds_and_by_its_name_where_it_adds_to_none():
    def heads(*sets):
        fits = [SimpleNamespace(effects=names, model=SimpleNamespace(base="simple")) for names in sets]
        return _added(tuple(Step(fit, np.array([]), np.array([])) for fit in fits))

    assert heads((), ("a",), ("a", "b_c", "d")) == ["simple model", "+ a", "+ b c + d"]
    assert heads((), ("a",), ("b",)) == ["simple model", "+ a", "+ b"]
    assert heads((), ("a",), ("b", "c"), ("b", "c")) == ["simple model", "+ a", "+ b + c", "+ b + c"]
    assert heads(("a", "b"), ("b", "c")) == ["+ a + b", "+ b + c"]


def test_tables_call_a_cell_by_the_phi_of_its_level_as_figures_do(discovery):
    """The cells of a level have means of their own, which may round to another number."""
    step = steps(discovery.steps)[0]
    cells = replace(step.fit.cells, phi=step.fit.cells.phi + 0.002)
    missed = Fail("speed", float(cells.phi[1]), float(cells.omega[1]), -0.01, -5.0, 1)
    kept = {name: getattr(step.fit, name) for name in ("predicted", "residual_z", "effects", "model", "undetermined")}
    fit = SimpleNamespace(cells=cells, fails=(missed,), lack_of_fit_p=0.5, **kept)
    shown = (Step(fit, step.omega_rad_s, step.speed_m_s),)
    levels = [f"{phi:.3f}" for phi in cells.level_phi[cells.level]]
    assert failing(shown)[0].tables[0].rows[0][1] == levels[1] == "0.600"
    (_, _, line) = fails(fit, 1).splitlines()
    assert line.split()[1] == "0.600"
    (all_cells,) = data(shown, Provenance(used=1), []).tables
    assert [row[0] for row in all_cells.rows] == levels


def test_numbers_have_a_true_minus_sign_and_zero_has_none():
    assert text.number(-0.004, 2) == text.centi(-4e-5) == "0.00"
    assert text.number(-0.006, 2) == text.centi(-6e-5) == "−0.01"


def test_a_small_error_has_the_digits_that_tell_it_from_the_floor_as_in_the_terminal(page, fits):
    """Two digits of a lift in cm would not."""
    (_, *terminal) = ladder(fits).splitlines()[-2:]
    floor = terminal[0].split()[3]
    assert re.fullmatch(r"0\.0\d\d+", floor)
    assert f" {floor} " in table(page, "Error as effects are added")


def test_a_residual_has_the_digits_of_its_standard_error(discovery):
    step = steps(discovery.steps)[0]
    missed = Fail("lift", 0.6, 10.0, -0.000521, -5.0, 1)
    kept = {name: getattr(step.fit, name) for name in ("cells", "effects", "model")}
    fit = SimpleNamespace(fails=(missed,), lack_of_fit_p=0.5, **kept)
    (row,) = failing((Step(fit, step.omega_rad_s, step.speed_m_s),))[0].tables[0].rows
    assert row[3] == "−0.052 cm"
    assert "-0.052 cm" in fails(fit, 1)


@pytest.mark.usefixtures("no_plates")
def test_what_a_claim_takes_is_not_said_where_nothing_is_claimed(tmp_path, fits, trials):
    write_comparison(tmp_path / "c.html", fits, trials, title="c")
    page = (tmp_path / "c.html").read_text(encoding="utf-8")
    assert "How they were analysed" in page
    assert "An effect is claimed" not in page


def test_what_a_claim_took_is_said_as_it_was(page, fits):
    """The threshold that the verdict goes by: of few replicates more than the criterion."""
    said = table(page, "How they were analysed")
    needed = claim_threshold(fits[-1], Criteria(claim=30.5))
    assert needed > 31
    assert f"lowers the deviance by at least {needed:.0f}" in said
    assert "30.5 would suffice if the pure error were known exactly" in said
    assert "of its size is higher by at least 7.5" in said


def test_of_an_overdispersed_fit_a_claim_takes_more_and_its_factors_are_said(fits):
    scattered = replace(fits[-1], goodness=replace(fits[-1].goodness, chi2=3.0 * fits[-1].goodness.dof))
    calm = replace(fits[-1], goodness=replace(fits[-1].goodness, chi2=0.5 * fits[-1].goodness.dof))
    said, plain_said = (" ".join(methods(steps([one]), Criteria()).text) for one in (scattered, calm))
    assert f"by at least {claim_threshold(scattered):.0f} = {claim_threshold(calm):.3g} × 3, the χ² per degree" in said
    assert f"by at least {claim_threshold(calm):.0f} (22 would suffice" in plain_said


def test_next_trials_and_frames_are_shown(page):
    assert "φ 0.633, ω 22 rad/s first step leg slip from cable drag 4.2 2" in table(page, "Next trials")
    assert 'src="data:image/jpeg;base64,/9j/' in page
    assert 'src="data:image/png;base64,iVBOR' in page
    assert "dorsal, t = 1.20 s" in table(page, "Tracked video")


def test_the_csv_inside_is_si_and_whole(fits):
    rows = list(csv.DictReader(io.StringIO(cells_csv(steps(fits)))))
    cells = fits[0].cells
    assert len(rows) == len(cells)
    assert float(rows[0]["speed_m_s"]) == pytest.approx(cells.mean[0, 0], rel=1e-5)
    assert float(rows[0]["lift_m"]) == pytest.approx(cells.mean[0, 1], rel=1e-5)
    assert float(rows[0]["speed_m_s[leg_slip]"]) == pytest.approx(fits[1].predicted[0, 0], rel=1e-5)
    assert {"speed_z[base]", "omega_rad_s", "phi", "gait"} <= set(rows[0])


def test_the_csv_inside_holds_the_fit_and_what_is_held_by_hand(fits):
    chosen = Selection(effects=("leg_slip",)).held("delta_t_s", 0.35)
    shown = steps_of(chosen, fits[0].cells, EFFECTS)
    (row, *_) = csv.DictReader(io.StringIO(cells_csv(steps(shown))))
    fitted, held = (float(row[f"speed_m_s[leg_slip{tag}]"]) for tag in ("", "; held by hand: delta_t_s=0.35"))
    assert [fitted, held] == pytest.approx([step.predicted[0, 0] for step in shown[1:]], rel=1e-5)
    assert fitted != pytest.approx(held, rel=1e-3)


def test_json_inside_is_json_or_none():
    with pytest.raises(ValueError, match="JSON compliant"):
        json_download(SimpleNamespace(to_dict=lambda: {"stability": float("nan")}))


def test_excluded_trials_are_named_with_the_reason(trials, fits):
    speed_m_s = np.where(np.arange(len(trials.phi)) == 3, np.nan, trials.speed_m_s)
    torn = replace(trials, speed_m_s=speed_m_s, status=np.array(["ok", "aborted", *trials.status[2:]]))
    found = provenance(torn, fits[0].cells)
    assert found.excluded == (("t01", "status: aborted"), ("t03", "speed_m_s not measured"))
    assert provenance(trials, fits[0].cells).excluded == ()


@pytest.mark.usefixtures("no_plates")
def test_what_is_odd_about_the_trials_stands_at_the_top(trials, fits, tmp_path):
    odd = replace(trials, first_step_m=np.zeros_like(trials.first_step_m))
    for name, given in (("clean", trials), ("odd", odd)):
        write_comparison(tmp_path / f"{name}.html", fits, given, title="odd")
    head = (tmp_path / "odd.html").read_text(encoding="utf-8").split("</header>")[0]
    assert re.search(r"<strong>Check the data.</strong> .* first_step_m are exactly 0", head)
    assert "Check the data." not in (tmp_path / "clean.html").read_text(encoding="utf-8")


def test_a_full_campaign_has_no_limits_to_report(fits):
    assert limits(fits[0].cells) == ()


@pytest.mark.parametrize(
    ("arguments", "said", "absent"),
    [
        ({"phis": (0.633,)}, "every trial is at φ = 0.633", None),
        ({"replicates": 1}, "no condition was repeated", None),
        ({"columns": ("speed_m_s",)}, "Body lift, peak speed, first step: not measured", "lock"),
        ({"omegas": (10,)}, "every trial is at ω = 10 rad/s", None),
    ],
    ids=["one phi", "one replicate", "speed only", "one omega"],
)
def test_thin_data_give_a_page_that_says_what_it_can_not_show(tmp_path, arguments, said, absent):
    trials = made_up_trials(**arguments)
    fits = compare(cells_of(trials), EFFECTS, [])
    path = tmp_path / "thin.html"
    write_comparison(path, fits, trials, title="thin")
    page = path.read_text(encoding="utf-8")
    assert said in page[page.index("<header>") : page.index("</header>")]
    figures = figures_of(page)
    assert "speed" in figures
    assert absent is None or absent not in figures


@pytest.mark.parametrize("replicates", [1, 2])
def test_a_page_of_means_with_error_bars_speaks_of_no_replicates(tmp_path, replicates):
    """Control: without error bars the page speaks of replicates."""
    trials = made_up_trials(replicates=replicates, columns=("speed_m_s",))
    if replicates == 1:
        none = np.full(len(trials), np.nan)
        trials = replace(trials, replicate=none, speed_sd_m_s=np.full(len(trials), 0.005))
    path = tmp_path / "bars.html"
    write_comparison(path, compare(cells_of(trials), EFFECTS, []), trials, title="bars")
    page = without_plotly(path.read_text(encoding="utf-8"))
    of_replicates = replicates > 1
    assert (
        ("replicates" in page)
        == ("s.d. of a trial" in page)
        == ("deviation of a single trial" in page)
        == of_replicates
    )
    assert ("error bars" in page) == ("r.m.s. of the error bars" in page) != of_replicates


MODELLED = {"residuals-speed", "ladder", "collapse", "step", "balance", "run-order"}


@pytest.mark.parametrize("omegas", [(10,), (4, 10, 16, 22)], ids=["one omega", "control"])
def test_what_the_data_do_not_determine_is_not_shown(tmp_path, omegas):
    """Three or twelve cell means for five parameters; measured speeds are shown in any case."""
    trials = made_up_trials(omegas=omegas, columns=("speed_m_s",))
    fits = compare(cells_of(trials), EFFECTS, [])
    path = tmp_path / "few.html"
    write_comparison(path, fits, trials, title="few")
    page, few = path.read_text(encoding="utf-8"), len(omegas) == 1
    assert ("3 cell means can't determine 5 parameters: " in page.replace("&#39;", "'")) == few
    assert "speed" in figures_of(page)
    assert (not MODELLED & set(figures_of(page))) == few
    head = head_of(path)
    assert ("The simple model can&#39;t be tested: 3 cell means can&#39;t determine 5 parameters." in head) == few
    assert ("Error, simple model not known" in head) == few
    assert np.isnan(fits[0].rmse_m_s) == few
    for said in ("modelled", "misses the mean speed most", "Correlations of the errors", "Missed most", "failing cell"):
        assert (said not in without_plotly(page)) == few, said


def test_nan_rows_leave_a_page_without_nan(tmp_path, trials):
    gone = np.arange(len(trials.phi)) < 3
    torn = replace(trials, **{name: np.where(gone, np.nan, getattr(trials, name)) for name in COLUMNS})
    torn.lift_m[8] = np.nan
    fits = compare(cells_of(torn), EFFECTS, [])
    path = tmp_path / "torn.html"
    write_comparison(path, fits, torn, title="torn")
    own = without_plotly(path.read_text(encoding="utf-8"))
    assert not re.search(r"\bnan\b", own, flags=re.IGNORECASE)
    assert "3 excluded" in own


def test_a_page_is_written_whole_or_not_at_all(tmp_path, discovery, trials):
    path = tmp_path / "report.html"
    path.write_text("the old one")
    broken = replace(discovery, steps=())
    with pytest.raises(IndexError):
        write_report(path, broken, trials, title="broken")
    assert path.read_text() == "the old one"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("value", "stderr", "said"),
    [
        (0.40123, 0.01234, "0.401 ± 0.012"),
        (182.31, 1.2, "182.3 ± 1.2"),
        (1234.0, 56.0, "1234 ± 56"),
        (0.5, np.nan, "not determined"),
        (np.nan, 1.0, "not known"),
    ],
)
def test_numbers_carry_as_many_digits_as_their_error_allows(value, stderr, said):
    assert text.with_error(value, stderr) == said


def test_parameters_of_effects_are_described_from_the_catalogue():
    assert text.described("disturbed_ground.k_l_n_per_m") == ("disturbed ground: stiffness of disturbed ground", "N/m")
    assert text.described("delta_t_s")[1] == "s"
    assert text.described("my_own.a") == ("my_own.a", "")
