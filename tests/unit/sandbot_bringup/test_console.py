import json
import math
import threading
import urllib.request

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_bringup.console import Arrivals, Console, Series, Throttle
from sandbot_bringup.console_page import app, serve
from sandbot_common.errors import InputError

NAN = float("nan")


def console():
    return Console({"/speed": False, "/trial": True})


def test_a_series_keeps_ten_seconds_and_counts_back_from_now():
    series = Series()
    for t_s in range(1000, 1031):
        series.add(t_s, 0.01 * t_s)
    columns = series.columns(series.latest_s)
    assert columns["t_s"] == [float(t) for t in range(-10, 1)]
    assert columns["value"][-1] == pytest.approx(10.30)


def test_a_gap_is_none_and_time_that_steps_back_begins_anew():
    series = Series()
    for t_s, value in ((5.0, 0.1), (5.1, NAN), (1.0, 0.3)):
        series.add(t_s, value)
        if t_s == 5.1:
            assert series.columns(5.1)["value"] == [0.1, None]
    assert series.columns(1.0) == {"t_s": [0.0], "value": [0.3]}


@given(st.lists(st.tuples(st.floats(0, 1e4), st.floats()), max_size=50))
def test_a_series_is_ordered_finite_and_short(points):
    series = Series()
    for t_s, value in points:
        series.add(t_s, value)
    columns = series.columns(series.latest_s) if points else series.columns(0.0)
    assert columns["t_s"] == sorted(columns["t_s"])
    assert all(-10.0001 <= t_s <= 0 for t_s in columns["t_s"])
    assert all(value is None or math.isfinite(value) for value in columns["value"])


def test_health_goes_from_waiting_over_ok_to_silent():
    arrivals = Arrivals()
    assert arrivals.health(0.0, False)["state"] == "waiting"
    for index in range(401):
        arrivals.add(10 + index * 0.01)
    health = arrivals.health(14.0, False)
    assert health["state"] == "ok"
    assert health["rate_hz"] == pytest.approx(100, rel=0.02)
    late = arrivals.health(19.0, False)
    assert (late["state"], late["age_s"], late["rate_hz"]) == ("silent", 5.0, 0.0)
    assert arrivals.health(19.0, True)["state"] == "held"


@pytest.mark.parametrize(
    ("blower", "rates", "state"),
    [
        (None, None, "unknown"),
        (0.0, None, "unknown"),
        (0.0, [0.0] * 6, "free"),
        (0.0, [0.0, 3.0], "legs"),
        (0.4, [0.0], "air"),
        (0.4, None, "air"),
        (NAN, [0.0], "air"),
        (0.4, [1.0], "broken"),
        (0.4, [NAN], "broken"),
    ],
)
def test_interlock(blower, rates, state):
    made = console()
    if blower is not None:
        made.values["blower"] = blower
    if rates is not None:
        made.set_legs(rates)
    assert made.interlock["state"] == state


def test_a_snapshot_is_json_without_nan():
    made = console()
    made.heard("/speed", 1.0)
    made.measured.add(1.0, NAN)
    made.values["lift_m"] = NAN
    made.set_trial('{"trial_id": "a", "omega_rad_s": 8.0}')
    made.new_picture("dorsal")
    snapshot = json.loads(json.dumps(made.snapshot(1.5), allow_nan=False))
    assert snapshot["values"] == {"lift_m": None}
    assert snapshot["trial"]["omega_rad_s"] == 8.0
    assert snapshot["pictures"] == {"dorsal": 1}


@pytest.mark.parametrize("text", ["by hand", "[1]", ""])
def test_a_trial_that_is_not_json_is_shown_as_text(text):
    made = console()
    made.set_trial(text)
    assert made.trial == {"trial_id": text}


def test_throttle_lets_through_once_a_period():
    now = [0.0]
    due = Throttle(0.2, lambda: now[0])
    passed = []
    for step in range(100):
        now[0] = step * 0.01
        passed.append(due())
    assert sum(passed) == 5


class Fake:
    def __init__(self):
        self.called = []

    def snapshot(self):
        return {"a": 1}

    def picture(self, camera):
        return b"jpeg" if camera == "dorsal" else None

    def call(self, service):
        self.called.append(service)
        return True, "done"


@pytest.fixture
def fake():
    return Fake()


@pytest.fixture
def client(fake):
    closing = threading.Event()
    closing.set()  # a stream ends after its first snapshot
    return app(fake, closing).test_client()


def test_page_library_stream_and_pictures_come_from_this_host(client):
    page = client.get("/").get_data(as_text=True)
    assert "http://" not in page
    assert "https://" not in page
    assert b"plotly" in client.get("/plotly.js").data[:2000].lower()
    assert client.get("/stream").get_data(as_text=True) == 'data: {"a": 1}\n\n'
    assert client.get("/camera/dorsal.jpg").data == b"jpeg"
    assert client.get("/camera/lateral.jpg").status_code == 404


def test_buttons_call_their_services(client, fake):
    for action in ("prepare", "abort", "start", "stop"):
        answer = client.post(f"/call/{action}", headers={"X-Trackway": "1"})
        assert answer.json == {"success": True, "message": "done"}
    assert fake.called == ["/bed/prepare", "/bed/abort", "/clock/start", "/clock/stop"]


def test_nobody_else_presses_the_buttons(client, fake):
    assert client.post("/call/start").status_code == 403
    rebound = {"Host": "evil.example:8060", "X-Trackway": "1"}
    assert client.post("/call/start", headers=rebound).status_code == 403
    assert client.post("/call/explode", headers={"X-Trackway": "1"}).status_code == 404
    assert client.get("/call/start", headers={"X-Trackway": "1"}).status_code == 405
    assert fake.called == []


def test_it_serves_on_loopback_and_a_taken_port_is_one_line(fake):
    closing = threading.Event()
    server = serve(fake, 0, closing)
    try:
        assert server.server_address[0] == "127.0.0.1"
        with urllib.request.urlopen(f"http://127.0.0.1:{server.port}/camera/dorsal.jpg", timeout=5) as answer:
            assert answer.read() == b"jpeg"
        with pytest.raises(InputError, match=f"port {server.port} of 127.0.0.1 is taken"):
            serve(fake, server.port, closing)
    finally:
        closing.set()
        server.shutdown()
        server.server_close()
    assert server.socket.fileno() == -1
