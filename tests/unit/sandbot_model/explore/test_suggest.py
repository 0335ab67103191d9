"""Suggestions: each page has its own question, one is tried after the other, and none answers for another."""

import threading
from types import SimpleNamespace

import pytest
from made_up import BOOST, EFFECTS, suggestions_made

from sandbot_common.errors import InputError
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.selection import Selection, to_query
from sandbot_model.explore import app
from sandbot_model.explore.app import Explorer
from sandbot_model.explore.job import Job

SIMPLE, FULL = Selection(), Selection("full")


@pytest.fixture(scope="module")
def found(session):
    return {base: discover(session.cells, {"leg_slip": EFFECTS["leg_slip"]}, base=base, max_effects=1)
            for base in ("simple", "full")}  # fmt: skip


@pytest.fixture
def gate():
    """Discoveries end once it is set."""
    return threading.Event()


@pytest.fixture
def explorer(session, trials, tmp_path, found, gate, monkeypatch):
    def suggest(selection, progress):
        progress("pairs", 3, 9)
        assert gate.wait(60)
        return found[selection.model]

    monkeypatch.setattr(session, "suggest", suggest)
    return Explorer(session, trials, [tmp_path / "trials.csv"], "test")


@pytest.fixture
def asked(explorer, monkeypatch):
    """What the page is answered after one of its parts has fired."""

    def ask(fired, selection, before=None):
        monkeypatch.setattr(app, "ctx", SimpleNamespace(triggered_id=fired))
        return explorer.on_suggest(1, 1, to_query(selection), before)

    return ask


def test_a_second_page_waits_for_its_own_model_and_is_told_which_one_comes_first(explorer, asked, gate, found):
    first = asked("suggest", SIMPLE)
    assert "first" not in str(first["suggestion.children"])
    second = asked("suggest", FULL)
    assert "Trying the simple model first." in str(second["suggestion.children"])
    assert not second["suggest-clock.disabled"]
    gate.set()
    suggestions_made()
    assert explorer.job.running is None
    for selection in (SIMPLE, FULL):
        assert explorer.job.found_for(selection) is found[selection.model]
    told = asked("suggest-clock", FULL, second["asked.data"])
    assert "Suggestion for the full model" in str(told["suggestion.children"])
    assert told["suggest-clock.disabled"]


def test_only_what_was_found_for_the_model_on_the_page_is_switched_on(explorer, gate, found):
    gate.set()
    explorer.job.start(SIMPLE).join(60)
    pressed = explorer._pressed(FULL, "adopt", 1, "")
    assert pressed == FULL
    assert explorer._pressed(SIMPLE, "adopt", 1, "").model == "simple"


@pytest.mark.parametrize("other", [FULL, Selection(formulas=(BOOST,))])
def test_a_suggestion_goes_with_its_model_and_formulas_and_stays_with_its_view(explorer, asked, gate, other):
    gate.set()
    asked("suggest", SIMPLE)
    suggestions_made()
    shown = asked("suggest-clock", SIMPLE, asked("suggest", SIMPLE)["asked.data"])
    stays = asked("address", Selection(view="lock"), shown["asked.data"])
    assert "Suggestion for the simple model" in str(stays["suggestion.children"])
    gone = asked("address", other, shown["asked.data"])
    assert gone["suggestion.children"] == []
    assert gone["adopt.hidden"]
    assert gone["suggest-clock.disabled"]


def test_what_another_page_asked_is_not_shown(explorer, asked, gate):
    gate.set()
    explorer.job.start(SIMPLE).join(60)
    assert asked("address", SIMPLE)["suggestion.children"] == []


def test_one_that_failed_does_not_stop_the_next(session, found, gate, monkeypatch):
    def suggest(selection, _):
        assert gate.wait(60)
        if selection.model == "simple":
            raise InputError("no replicates")
        return found["full"]

    monkeypatch.setattr(session, "suggest", suggest)
    job = Job(session)
    thread = job.start(SIMPLE)
    assert job.start(FULL) is None
    assert job.pending(FULL)
    gate.set()
    thread.join(60)
    assert job.failed_for(SIMPLE) == "No suggestion: no replicates"
    assert job.failed_for(FULL) == ""
    assert job.found_for(FULL) is found["full"]
    assert job.start(FULL) is None
