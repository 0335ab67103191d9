"""The whole run: figures beside their aims, samples of what is long, nothing begun that would outlast the hour."""

import re
from types import SimpleNamespace

import pytest

import _figures
import _ratios
import _short
import run
from _figures import Figure, Run, share


@pytest.mark.parametrize(
    ("value", "aim", "reached"),
    [(5.0, "≤ 5 ms", True), (5.1, "≤ 5 ms", False), (95.0, "≥ 95 %", True), (3.0, "< 3 s", False), (2, "≤ 2", True)],
)
def test_a_figure_is_beside_its_aim(value, aim, reached):
    figure = Figure("latency", "10 frames", value, aim)
    assert figure.reached is reached
    assert figure.row().endswith("| reached |" if reached else "| **short** |")


def test_no_figure_is_a_power_of_ten():
    assert "| 5,742 ms |" in Figure("latency", "28 frames", 5742.1, "≤ 15 ms").row()


def test_a_share_of_nothing_is_no_figure():
    assert share("named", "worlds", [], "≥ 95 %") == []
    (found,) = share("named", "worlds", [True, False, True, True], "≥ 95 %")
    assert (found.value, found.reached, found.of) == (75.0, False, "3 of 4 worlds")


@pytest.fixture
def modules(monkeypatch, tmp_path):
    """Three benchmarks: one with a sample, one with figures, one alone; what they did."""
    did = []
    made = {
        "long": SimpleNamespace(
            sample=lambda: did.append("sample") or [Figure("shares", "2", 99.0, "≥ 95 %")],
            main=lambda: pytest.fail("the whole of a long one was begun"),
        ),
        "figured": SimpleNamespace(
            main=lambda: did.append("figured") or "text", figures=lambda: [Figure("s", "1", 4, "< 3 s")]
        ),
        "alone": SimpleNamespace(main=lambda: did.append("alone") or "text"),
    }
    monkeypatch.setattr(run.importlib, "import_module", made.__getitem__)
    monkeypatch.setattr(run, "HERE", tmp_path)
    return did


def test_of_the_long_ones_a_sample_is_run_and_of_the_others_the_report(modules, tmp_path):
    kept = {"long": Run("whole", 5.0, 0.0, "abc", [])}
    run.whole(["alone", "figured", "long"], kept)
    assert sorted(modules) == ["alone", "figured", "sample"]
    assert sorted(one.name for one in tmp_path.glob("*.md")) == ["alone.md", "figured.md"]
    page = run.readme([], kept, ["alone", "figured", "long"])
    assert "| shares | 2 | 99 % | ≥ 95 % | reached |" in page
    assert "| s | 1 | 4 s | < 3 s | **short** |" in page
    assert "| long | a sample | 0 s |" in page
    assert "| [alone](alone.md) | whole | 0 s |" in page


def test_what_would_outlast_the_hour_is_not_begun_and_stays_as_it_was(modules):
    before = Run("whole", run.BUDGET_S + 1, 0.0, "abc", [Figure("old", "1", 1.0, "≤ 2 s")])
    kept = {"long": before}
    run.whole(["alone", "long"], kept)
    assert modules == ["alone"]
    assert kept["long"] is before
    assert "| never | no: `make bench ONLY=never` |" in run.readme([], kept, ["alone", "long", "never"])


def test_one_that_fails_leaves_the_others_and_is_named(modules, monkeypatch, capsys):
    monkeypatch.setattr(run.importlib.import_module("alone"), "main", lambda: 1 / 0)
    kept = {}
    run.whole(["alone", "long"], kept)
    assert list(kept) == ["long"]
    assert "alone failed: ZeroDivisionError" in capsys.readouterr().err


def test_one_by_itself_changes_its_own_figures_and_no_others(modules, monkeypatch, tmp_path):
    monkeypatch.setattr(_figures, "STORED", tmp_path / "figures.json")
    monkeypatch.setattr(run, "README", tmp_path / "README.md")
    monkeypatch.setattr(run.pkgutil, "iter_modules", lambda _: [SimpleNamespace(name=n) for n in ("figured", "long")])
    other = Run("a sample", 7.0, 2.0, "abc", [Figure("old", "1", 1.0, "≤ 2 s")])
    _figures.store({"long": other, "figured": other})
    assert run.main(["figured"]) == 0
    kept = _figures.stored()
    assert kept["long"] == other
    assert [one.what for one in kept["figured"].figures] == ["s"]
    assert run.main(["none"]) == 2


def test_a_row_that_is_short_has_its_reason_below_and_one_that_is_reached_has_none():
    what = "page: first page"
    assert _short.WHY[what] in "\n".join(_short.lines([], [Figure(what, "147 trials", 2.4, "< 1.5 s")]))
    assert _short.lines([], [Figure(what, "147 trials", 1.2, "< 1.5 s")]) == []
    assert "no reason given yet" in "\n".join(_short.lines([], [Figure("another", "1", 2.4, "< 1.5 s")]))


def test_every_aim_that_the_stored_run_misses_is_explained_and_no_reason_is_of_another_row():
    rows = [*_ratios.stored(), *(figure for one in _figures.stored().values() for figure in one.figures)]
    assert {one.what for one in rows if not one.reached} <= set(_short.WHY) <= {one.what for one in rows}


def test_the_page_is_that_of_the_stored_run():
    kept = _figures.stored()
    figures = [figure for one in kept.values() for figure in one.figures]
    page = (run.HERE / "README.md").read_text(encoding="utf-8")
    for table in (_figures.table(figures), "\n".join(_short.lines(_ratios.stored(), figures))):
        assert table in page


COUNTS = [
    ("hidden", r"^(\d+) worlds of the virtual lab", "measured on {} worlds"),
    ("hidden", r"named first \|.*\((\d+) of (\d+)\)", "In {} of {} worlds with a strong enough effect"),
    ("hidden", r"pairs found \|.*\((\d+) of \1\)", "all of {} pairs"),
    ("hidden", r"null worlds \|.*\(0 of (\d+)\)", "In {} worlds with nothing hidden, nothing was claimed"),
    ("hidden", r"not identified \|.*\((\d+) of \1\)", "in none of {} worlds with an effect from outside"),
    ("README", r"under a week's nuisances \| 0 of (\d+) campaigns", "no claim in {} campaigns was false"),
    (
        "trials_to_verdict",
        r"until verdict \| (\d+) \| \d+ \((\d+)%\) \| 0 .* \| (\d+) \(",
        "In {} campaigns of 21 worlds it was right in {} %, made no false claim and took {} trials",
    ),
    ("trials_to_verdict", r"grid 7 x 7 x 3 .*\(97%\).* (\d+) \(", "which is right as often, takes {} "),
]
"""A report, its numbers, and the sentence of /README.md that gives them."""


@pytest.mark.parametrize(("report", "numbers", "sentence"), COUNTS)
def test_readme_gives_the_counts_of_the_reports(report, numbers, sentence):
    found = re.search(numbers, (run.HERE / f"{report}.md").read_text(encoding="utf-8"), flags=re.M)
    readme = " ".join((run.HERE.parent / "README.md").read_text(encoding="utf-8").split())
    assert sentence.format(*found.groups()) in readme
    assert sentence.format(*(int(one) + 1 for one in found.groups())) not in readme
