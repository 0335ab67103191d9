"""``/why`` over HTTP: it asks for a discovery where there is none yet, and argues the one that was made."""

import json

import pytest
from made_up import EFFECTS, served, suggestions_made

from sandbot_common.errors import InputError
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.selection import Selection
from sandbot_model.explore.job import Job
from sandbot_model.explore.why_page import WhyPage
from sandbot_model.report.provenance import provenance


@pytest.fixture(scope="module")
def found(session):
    return discover(session.cells, {"leg_slip": EFFECTS["leg_slip"]}, max_effects=1)


@pytest.fixture
def job(session, found, monkeypatch):
    monkeypatch.setattr(session, "suggest", lambda selection, progress: found)
    return Job(session)


@pytest.fixture
def client(job, trials):
    return served(WhyPage(job, provenance(trials, job.session.cells, []), "my <trials>"))


def test_a_discovery_is_run_first_and_its_progress_told(client, job, monkeypatch):
    started = []
    monkeypatch.setattr(job, "start", started.append)
    waiting = client.get("/why?effect=leg_slip").text
    assert started == [Selection(effects=("leg_slip",))]
    assert "my &lt;trials&gt;" in waiting
    assert 'href="/?effect=leg_slip"' in waiting
    job.stage = ("pairs", 3, 9)
    told = json.loads(client.get("/why/progress").text)
    assert told == {"running": False, "failed": "", "stage": "pairs", "done": 3, "total": 9}


def test_what_was_found_is_argued(client, job, found):
    job.start(Selection()).join(60)
    page = client.get("/why").text
    assert found.verdict.status.capitalize() in page
    assert "What would settle it?" in page
    assert "my &lt;trials&gt;" in page


def test_another_base_model_is_another_question(client, job, found):
    job.start(Selection(effects=("leg_slip",))).join(60)
    assert job.found_for(Selection(view="lock")) is found
    assert job.found_for(Selection(model="full")) is None
    assert "Trying the catalogue" in client.get("/why?model=full").text


def test_a_discovery_that_failed_says_so(client, job, monkeypatch):
    def refuse(*_):
        raise InputError("no replicates")

    monkeypatch.setattr(job.session, "suggest", refuse)
    job.start(Selection()).join(60)
    assert json.loads(client.get("/why/progress").text)["failed"] == "No suggestion: no replicates"


def test_the_progress_told_is_that_of_the_question_in_the_address(client, job, monkeypatch):
    def refuse(selection, _):
        raise InputError(f"no {selection.model}")

    monkeypatch.setattr(job.session, "suggest", refuse)
    job.start(Selection()).join(60)
    told = json.loads(client.get("/why/progress?model=full").text)
    assert (told["running"], told["failed"]) == (False, "")


def test_values_held_by_hand_are_left_out_and_the_way_back_has_them(client, job):
    held = "?view=lock&hold=delta_t_s%3D0.35&cell=0.6,4,UNIFORM"
    assert 'href="/?view=lock&amp;hold=delta_t_s%3D0.35&amp;cell=0.6,4,UNIFORM"' in client.get(f"/why{held}").text
    suggestions_made()
    page = client.get(f"/why{held}").text
    assert "Values held by hand are ignored here (delta_t_s = 0.35): this page shows the fit." in page
    assert 'href="/?view=lock&amp;hold=delta_t_s%3D0.35&amp;cell=0.6,4,UNIFORM"' in page
    assert "by hand" not in client.get("/why").text
