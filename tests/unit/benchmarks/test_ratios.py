"""bench-quick fails on a loss of a fifth and on nothing less."""

import _ratios
import run
from _ratios import Ratio


def ratio(value, what="markers followed"):
    return Ratio(what, "a peer", value, 40.0)


def test_a_loss_of_a_fifth_is_told_and_less_is_not():
    assert _ratios.fallen([ratio(41.0)], [ratio(50.0)]) == []
    assert _ratios.fallen([ratio(39.0)], [ratio(50.0)]) == ["markers followed, a peer: 39.00, was 50.00"]
    assert _ratios.fallen([ratio(80.0)], [ratio(50.0)]) == []


def test_a_ratio_that_is_no_longer_measured_is_a_loss():
    assert _ratios.fallen([ratio(50.0, "something else")], [ratio(50.0)]) != []


def test_what_is_stored_comes_back(tmp_path, monkeypatch):
    monkeypatch.setattr(_ratios, "STORED", tmp_path / "ratios.json")
    assert _ratios.stored() == []
    _ratios.store([ratio(50.0)])
    assert _ratios.stored() == [ratio(50.0)]


def test_quick_ends_1_on_a_loss_and_0_without(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(_ratios, "STORED", tmp_path / "ratios.json")
    monkeypatch.setattr(_ratios, "measured", lambda: [ratio(45.0)])
    assert run.main(["--quick"]) == 2
    _ratios.store([ratio(50.0)])
    assert run.main(["--quick"]) == 0
    _ratios.store([ratio(60.0)])
    assert run.main(["--quick"]) == 1
    assert "was 60.00" in capsys.readouterr().err


def test_every_module_of_the_quick_run_has_its_ratios():
    import importlib

    assert all(callable(importlib.import_module(name).quick) for name in _ratios.MODULES)
