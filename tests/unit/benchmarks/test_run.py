"""The whole run: figures beside their aims, samples of what is long, nothing begun that would outlast the hour."""

from types import SimpleNamespace

import pytest

import run
from _figures import Figure, share


@pytest.mark.parametrize(
    ("value", "aim", "reached"),
    [(5.0, "≤ 5 ms", True), (5.1, "≤ 5 ms", False), (95.0, "≥ 95 %", True), (3.0, "< 3 s", False), (2, "≤ 2", True)],
)
def test_a_figure_is_beside_its_aim(value, aim, reached):
    figure = Figure("latency", "10 frames", value, aim)
    assert figure.reached is reached
    assert figure.row().endswith("| reached |" if reached else "| **short** |")


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
    took, figures = run.whole(["alone", "figured", "long"], {"long": 5.0})
    assert sorted(modules) == ["alone", "figured", "sample"]
    assert sorted(one.name for one in tmp_path.glob("*.md")) == ["alone.md", "figured.md"]
    page = run.readme([], figures, ["alone", "figured", "long"], took)
    assert "| shares | 2 | 99 % | ≥ 95 % | reached |" in page
    assert "| s | 1 | 4 s | < 3 s | **short** |" in page
    assert "| long | 0 s | a sample |" in page
    assert "| [alone](alone.md) | 0 s | whole |" in page


def test_what_would_outlast_the_hour_is_not_begun_and_named(modules):
    took, figures = run.whole(["alone", "long"], {"long": run.BUDGET_S + 1})
    assert (modules, figures) == (["alone"], [])
    assert "| long | – | no: `make bench ONLY=long` |" in run.readme([], figures, ["alone", "long"], took)


def test_one_that_fails_leaves_the_others_and_is_named(modules, monkeypatch, capsys):
    monkeypatch.setattr(run.importlib.import_module("alone"), "main", lambda: 1 / 0)
    took, figures = run.whole(["alone", "long"], {"alone": 1.0})
    assert list(took) == ["long"]
    assert "alone failed: ZeroDivisionError" in capsys.readouterr().err
    assert "| alone | – | no: `make bench ONLY=alone` |" in run.readme([], figures, ["alone", "long"], took)


def test_what_each_took_is_read_back_from_the_page(modules, tmp_path):
    took, _ = run.whole(["alone"], {})
    page = tmp_path / "README.md"
    page.write_text(run.readme([], [], ["alone"], {"alone": 17.4}))
    assert run.last_took_s(page) == {"alone": 17.0}
    assert run.last_took_s(tmp_path / "none.md") == {}
    assert list(took) == ["alone"]
