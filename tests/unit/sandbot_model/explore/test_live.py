"""What is served follows data that change: a campaign that grows, a table that is dropped."""

import io
import threading
from pathlib import Path

import pytest
from flask import Flask
from werkzeug.test import Client

from sandbot_common.errors import InputError
from sandbot_model.explore.live import MAX_BYTES, Live, completed_recordings
from sandbot_model.explore.loopback import own_host_only


class Desk:
    """Makes servers that say what they were made of."""

    def __init__(self):
        self.made = 0
        self.refuses = ""
        self.breaks = lambda dropped: False
        self.called = threading.Event()

    def __call__(self, dropped):
        self.called.set()
        if self.refuses:
            raise InputError(self.refuses.format(dropped))
        if self.breaks(dropped):
            raise ZeroDivisionError("a bug")
        self.made += 1
        return server(f"{self.made} {dropped.name if dropped else ''}")


def server(said):
    app = Flask("test")
    own_host_only(app)
    app.add_url_rule("/", "page", lambda: said)
    return app


def recorded(campaign, name):
    folder = campaign / "trials" / name
    folder.mkdir(parents=True)
    (folder / "metadata.yaml").write_text("complete\n")


@pytest.fixture
def desk():
    return Desk()


@pytest.fixture
def campaign(tmp_path):
    recorded(tmp_path, "first")
    return tmp_path


@pytest.fixture
def live(desk, campaign, tmp_path_factory):
    return Live(desk, server("0"), tmp_path_factory.mktemp("dropped"), [campaign])


def test_a_complete_recording_makes_a_new_server_and_nothing_else_does(live, desk, campaign):
    client = Client(live)
    assert not live.look()
    (campaign / "trials" / "second").mkdir()
    (campaign / "trials" / ".partial").mkdir()
    (campaign / "trials" / ".partial" / "metadata.yaml").write_text("not yet\n")
    assert not live.look()
    assert (client.get("/").text, client.get("/live").json) == ("0", {"version": 0, "follows": True})
    recorded(campaign, "third")
    assert live.look()
    assert (client.get("/").text, client.get("/live").json["version"]) == ("1 ", 1)
    assert not live.look()
    assert desk.made == 1


def test_data_that_can_not_be_shown_yet_are_asked_for_again(live, desk, campaign):
    recorded(campaign, "second")
    desk.refuses = "no usable trial"
    assert not live.look()
    assert Client(live).get("/").text == "0"
    desk.refuses = ""
    assert live.look()


def test_it_follows_until_it_is_told_to_end(live, desk, campaign):
    ended = threading.Event()
    thread = threading.Thread(target=live.follow, args=(ended, 0.001))
    thread.start()
    recorded(campaign, "second")
    assert desk.called.wait(60)
    ended.set()
    thread.join(60)
    assert not thread.is_alive()


def test_a_table_that_is_dropped_stands_beside_the_data_also_when_these_grow(live, campaign):
    client = Client(live)
    answer = client.post("/drop?name=theirs.csv", data=b"phi,omega_rad_s,speed_m_s\n0.6,8,0.1\n")
    assert answer.status_code == 204
    assert client.get("/").text == "1 theirs.csv"
    recorded(campaign, "second")
    assert live.look()
    assert client.get("/").text == "2 theirs.csv"


def test_a_table_with_which_no_server_can_be_made_leaves_all_as_it_was(live, desk, campaign):
    client = Client(live)
    desk.breaks = lambda dropped: dropped is not None and dropped.name == "bug.csv"
    assert client.post("/drop?name=good.csv", data=b"phi\n").status_code == 204
    assert client.post("/drop?name=bug.csv", data=b"phi\n").status_code == 500
    recorded(campaign, "second")
    assert live.look()
    assert client.get("/").text == "2 good.csv"


def test_a_check_that_fails_for_any_reason_is_made_again(live, desk, campaign, capsys):
    recorded(campaign, "second")
    desk.breaks = lambda dropped: True
    assert not live.look()
    assert "ZeroDivisionError: a bug" in capsys.readouterr().err
    desk.breaks = lambda dropped: False
    assert live.look()
    assert Client(live).get("/").text == "1 "


def test_a_recording_that_is_moved_away_once_it_is_listed_is_none(campaign, monkeypatch):
    listed = [campaign / "trials" / name / "metadata.yaml" for name in ("first", "moved")]
    monkeypatch.setattr(Path, "glob", lambda folder, pattern: listed)
    assert [path for path, _ in completed_recordings([campaign])] == [str(listed[0])]


def test_a_table_that_is_none_is_refused_in_a_line_and_changes_nothing(live, desk):
    client = Client(live)
    desk.refuses = "{}: row 2, column phi: 'x' is no number"
    answer = client.post("/drop?name=bad.csv", data=b"phi\nx\n")
    assert (answer.status_code, answer.text) == (400, "bad.csv: row 2, column phi: 'x' is no number")
    desk.refuses = ""
    for name, content in (("film.mp4", b"x"), ("large.csv", b"x" * (MAX_BYTES + 1))):
        assert client.post(f"/drop?name={name}", data=content).status_code == 400
    unknown = client.post(
        "/drop?name=long.csv", input_stream=io.BytesIO(b"x"), headers={"Transfer-Encoding": "chunked"}
    )
    assert unknown.status_code == 400
    assert client.get("/").text == "0"
    assert client.get("/drop").status_code == 405


@pytest.mark.parametrize(
    ("name", "title"),
    [
        (300 * "a", 60 * "a"),
        ("a%00", "a_"),
        ("a%0Ab", "a_b"),
        (300 * "%F0%9F%90%9C", 60 * "🐜"),
        ("their lab", "their lab"),
    ],
)
def test_whatever_a_table_is_called_it_is_taken(live, name, title):
    client = Client(live)
    assert client.post(f"/drop?name={name}.csv", data=b"phi,omega_rad_s,speed_m_s\n").status_code == 204
    assert client.get("/").text == f"1 {title}.csv"


def test_a_page_of_another_site_drops_nothing(live, desk):
    client = Client(live)
    answer = client.post("/drop?name=a.csv", data=b"phi\n", headers={"Origin": "http://elsewhere.example"})
    assert answer.status_code == 403
    assert desk.made == 0
    own = client.post("/drop?name=..%2F..%2Fa.csv", data=b"phi\n", headers={"Origin": "http://localhost"})
    assert own.status_code == 204
    assert client.get("/").text == "1 a.csv"
