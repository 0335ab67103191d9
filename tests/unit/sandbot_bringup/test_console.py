import json
import math
import socket
import threading
import urllib.request

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from hypothesis import given
from hypothesis import strategies as st
from rclpy.parameter import Parameter
from rclpy.qos import ReliabilityPolicy

from sandbot_bringup.console import HISTORY_S, Arrivals, Console, Packing, RecorderRate, Series, Throttle
from sandbot_bringup.console_page import OLD_S, app, serve
from sandbot_bringup.nodes.console_node import ConsoleNode, delivery
from sandbot_common import messages, topics
from sandbot_common.errors import InputError
from sandbot_common.ros.timer import end_timers

NAN = float("nan")


def console():
    return Console({"/speed": False, "/trial": True})


def test_a_series_keeps_its_last_seconds_and_counts_back_from_now():
    series = Series()
    for t_s in range(1000, 1031):
        series.add(t_s, 0.01 * t_s)
    columns = series.columns(series.latest_s)
    assert columns["t_s"] == [float(t) for t in range(-5, 1)]
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
    assert all(-HISTORY_S - 1e-3 <= t_s <= 0 for t_s in columns["t_s"])
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
    assert arrivals.health(19.0, False, math.inf)["state"] == "quiet"
    assert arrivals.health(19.0, True)["state"] == "held"


def test_normal_silence_is_quiet_and_only_what_ought_to_be_heard_is_silent():
    made = Console({name: False for name in ("/speed", "/bed/height", "/lift")})
    for name in made.latched:
        made.heard(name, 10.0)

    def states(now_s):
        topics = made.snapshot(now_s)["topics"]
        return [topics[name]["state"] for name in ("/speed", "/bed/height", "/lift")]

    assert states(11.0) == ["ok", "ok", "ok"]
    assert states(20.0) == ["quiet", "silent", "quiet"]
    made.set_node("clock", 0, "ok", {"running": "True"}, 20.0)
    assert states(21.0) == ["quiet", "silent", "quiet"]  # the walk has only begun
    made.set_node("clock", 0, "ok", {"running": "True"}, 23.0)
    assert states(23.0) == ["silent", "silent", "quiet"]
    made.set_node("clock", 0, "ok", {"running": "False"}, 24.0)
    assert states(30.0) == ["quiet", "silent", "quiet"]


def test_another_trial_begins_with_nothing_measured():
    made = console()
    made.set_trial('{"trial_id": "a", "start": "1"}')
    made.values["lift_m"] = 0.01
    made.measured.add(1.0, 0.1)
    made.set_bed({"stage": "settle", "phi": "0.6", "height_m": "0.1", "pulses": "3"}, 0.0)
    made.set_trial('{"trial_id": "a", "start": "1"}')  # told once more
    assert made.snapshot(2.0)["values"] == {"lift_m": 0.01}
    made.set_trial('{"trial_id": "a", "start": "2"}')  # repeated
    shown = made.snapshot(2.0)
    assert shown["values"] == {}
    assert shown["speed"]["measured"]["t_s"] == []
    assert shown["packing"]["points"] == []


def test_the_bed_packs_a_point_a_pulse_and_begins_anew_with_the_next_preparation():
    packing = Packing()
    told = [
        ("fluidise", 0, "nan", 0.099), ("settle", 0, "nan", 0.1),
        ("pulse", 1, 0.58, 0.1), ("pulse", 1, 0.58, 0.1004), ("settle", 1, 0.58, 0.0999),
        ("pulse", 2, 0.583, 0.0995),
        ("ready", 2, 0.585, 0.0992), ("ready", 2, 0.585, 0.099),
    ]  # fmt: skip
    for stage, pulses, phi, height in told:
        packing.add({"stage": stage, "pulses": str(pulses), "phi": str(phi), "height_m": str(height)})
    assert [(p["pulses"], p["phi"], p["height_m"]) for p in packing.points] == [
        (0, 0.58, 0.1),
        (1, 0.583, 0.0995),
        (2, 0.585, 0.0992),
    ]
    packing.add({"stage": "fluidise", "pulses": "0", "phi": "nan", "height_m": "0.1"})
    assert packing.points == []


def test_target_and_tolerance_are_those_of_the_bed():
    made = console()
    assert made.snapshot(0.0)["packing"] == {"points": [], "target_phi": None, "tolerance": None}
    made.set_bed({"stage": "idle", "target_phi": "0.605"}, 0.0)
    made.set_node("bed", 0, "ok", {"tolerance": "0.001"}, 0.0)
    assert made.snapshot(0.0)["packing"] == {"points": [], "target_phi": 0.605, "tolerance": 0.001}


def test_how_long_the_disk_lasts():
    rate = RecorderRate()
    assert rate.figures(1e9) == {"rate_bytes_s": None, "left_s": None}
    for step in range(11):
        rate.add(1e6 * step, 0.2 * step)
    assert rate.figures(200 * 2**20 + 50e6) == {"rate_bytes_s": 5_000_000, "left_s": 10}
    assert rate.figures(1e6)["left_s"] == 0
    rate.add(10.0, 2.2)  # another bag
    assert rate.figures(1e9)["rate_bytes_s"] is None


@pytest.mark.parametrize(
    ("name", "level", "text", "age_s", "state"),
    [
        ("bed", 0, "ok", 1.0, "ok"),
        ("tracker", 1, "late", 1.0, "warning"),
        ("clock", 2, "stopped", 1.0, "error"),
        ("clock", 0, "ok", 5.0, "silent"),
        ("clock", 2, "ended: SIGTERM", 5.0, "gone"),
        ("recorder", 0, "ok", 5.0, "gone"),
    ],
)
def test_what_nodes_say_of_themselves(name, level, text, age_s, state):
    made = console()
    made.set_node(name, level, text, {}, 10.0)
    assert made.snapshot(10.0 + age_s)["nodes"][name]["state"] == state


def test_timing_and_recorder_are_shown_only_while_they_are_told():
    made = console()
    made.set_node("tracker", 0, "ok", {"latency_ms_median": "8.10", "missed_deadlines": "2"}, 10.0)
    made.set_node("recorder", 0, "ok", {"written": "5", "lost": "0", "bytes": "9", "free_bytes": "1e9"}, 10.0)
    shown = made.snapshot(10.1)
    assert shown["timing"] == {"exposure to speed, median": "8.10 ms", "frames too late": "2"}
    assert (shown["recorder"]["written"], shown["recorder"]["lost"]) == (5.0, 0.0)
    later = made.snapshot(20.0)
    assert (later["timing"], later["recorder"]) == ({}, {})


def test_a_curve_is_kept_under_the_phi_that_was_meant():
    made = console()
    made.set_trial('{"trial_id": "a", "phi_target": 0.605}')
    made.set_curve('{"phi": 0.6048, "omega_rad_s": [1.0], "speed_m_s": [0.1]}')
    made.set_curve("no curve")
    assert list(made.snapshot(0.0)["curves"]) == ["0.6050"]
    made.set_trial('{"trial_id": "a", "phi_target": 0.605, "campaign": "another"}')
    assert made.snapshot(0.0)["curves"] == {}


@pytest.mark.parametrize(("age_s", "since"), [(1.9, ""), (7.0, ", 7 s ago")])
def test_a_stage_that_was_told_long_ago_says_so_beside_what_legs_and_air_do(age_s, since):
    """Of a bed that was killed it said fluidise for good, of a late campaign that it prepares the bed as legs moved."""
    made = console()
    made.set_bed({"stage": "fluidise", "phi": "0.6"}, 10.0)
    made.set_campaign('{"stage": "preparing the bed", "state": "running"}', 10.0)
    snapshot = made.snapshot(10.0 + age_s)
    assert snapshot["bed"] == {"stage": f"fluidise{since}", "phi": "0.6"}
    assert snapshot["campaign"] == {"stage": f"preparing the bed{since}", "state": "running", "age_s": age_s}
    made.set_campaign('{"stage": "", "state": "held"}', 10.0)  # it has none while it is held
    assert made.snapshot(10.0 + age_s)["campaign"]["stage"] == ""


def test_a_snapshot_is_json_without_nan():
    made = console()
    made.set_trial('{"trial_id": "a", "omega_rad_s": 8.0}')
    made.heard("/speed", 1.0)
    made.measured.add(1.0, NAN)
    made.values["lift_m"] = NAN
    made.new_picture("dorsal", ("com",))
    snapshot = json.loads(json.dumps(made.snapshot(1.5), allow_nan=False))
    assert snapshot["values"] == {"lift_m": None}
    assert snapshot["trial"]["omega_rad_s"] == 8.0
    assert snapshot["pictures"] == {"dorsal": {"number": 1, "seen": ["com"]}}


@pytest.mark.parametrize("text", ["by hand", "[1]", "", '{"trial_id": "x", "phi_target": NaN}', '{"a": 1e999}'])
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
    actions = ("go", "prepare", "halt")

    def __init__(self):
        self.called, self.pages, self.now_s = [], [], 1.0

    def snapshot(self, page):
        self.pages.append(page)
        return {"a": 1}

    def picture(self, camera):
        return b"jpeg" if camera == "dorsal" else None

    def stop(self):
        return self._done("stop")

    def acknowledge(self):
        return self._done("acknowledge")

    def order(self, what):
        return self._done(what)

    def call(self, what, page):
        self.pages.append(page)
        return self._done(what)

    def _done(self, what):
        self.called.append(what)
        return True, "done"


@pytest.fixture
def fake():
    return Fake()


@pytest.fixture
def client(fake):
    return app(fake, lambda: fake.now_s).test_client()


def test_page_library_state_and_pictures_come_from_this_host(client):
    page = "".join(
        client.get(f"/{name}").get_data(as_text=True) for name in ("", "console.js", "console.css", "base.css")
    )
    assert "http://" not in page
    assert "https://" not in page
    assert client.get("/console_page.py").status_code == 404
    assert b"plotly" in client.get("/plotly.js").data[:2000].lower()
    # Whole, and over: an answer that goes on would keep a browser's connection from STOP.
    assert client.get("/state").get_data() == b'{"a": 1, "at_s": 1.0}'
    assert client.get("/camera/dorsal.jpg").data == b"jpeg"
    assert client.get("/camera/lateral.jpg").status_code == 404


OWN = {"X-Trackway": "1"}


def test_what_the_operator_asks_for_is_done(client, fake):
    for path in ("stop", "acknowledge", "call/go", "call/prepare"):
        assert client.post(f"/{path}", headers=OWN).json == {"success": True, "message": "done"}
    order = {"do": "skip", "trial_id": "a"}
    assert client.post("/order", headers=OWN, json=order).json["success"]
    assert fake.called == ["stop", "acknowledge", "go", "prepare", order]


def test_a_page_is_known_by_its_own_name(client, fake):
    client.get("/state", headers={"X-Trackway-Page": "a"})
    client.post("/call/prepare", headers={"X-Trackway-Page": "b", **OWN})
    client.get("/state")
    assert fake.pages == ["a", "b", ""]


def test_what_was_asked_long_ago_starts_nothing_and_ends_all_the_same(client, fake):
    """A console that was frozen finds what was asked meanwhile, and a page that was acts on what it last saw."""
    fake.now_s += OLD_S + 0.5
    for path in ("call/go", "call/prepare", "order"):
        answer = client.post(f"/{path}", headers=OWN, json={}).json
        assert answer == {"success": False, "message": "what the page knew when it asked is 2 s old; ask again"}
    assert fake.called == []
    for path in ("stop", "acknowledge", "call/halt"):
        assert client.post(f"/{path}", headers=OWN, json={}).json["success"]


@pytest.mark.parametrize("path", ["stop", "acknowledge", "call/go", "order"])
def test_nobody_else_is_obeyed(client, fake, path):
    assert client.post(f"/{path}", json={}).status_code == 403
    rebound = {"Host": "evil.example:8060", **OWN}
    assert client.post(f"/{path}", headers=rebound, json={}).status_code == 403
    assert client.get(f"/{path}", headers=OWN).status_code in (404, 405)
    assert fake.called == []


def test_a_page_whose_name_points_here_sees_nothing(client):
    for path in ("", "state", "camera/dorsal.jpg", "console.js"):
        assert client.get(f"/{path}", headers={"Host": "evil.example:8060"}).status_code == 403
        assert client.get(f"/{path}", headers={"Host": "127.0.0.1:8060"}).status_code == 200


@pytest.mark.parametrize(
    "path", ["../console_page.py", "..%2fconsole_page.py", "%2e%2e/console_page.py", "/etc/passwd"]
)
@pytest.mark.parametrize("below", ["", "camera/", "page/", "call/"])
def test_no_path_leads_out_of_the_page(client, below, path):
    for tried in (f"/{below}{path}", f"/{below}{'..%2f' * 12}etc%2fpasswd"):
        assert client.get(tried).status_code in (403, 404, 405)


@pytest.mark.parametrize(
    ("body", "kind"), [("[1]", "application/json"), ("{", "application/json"), ("a=1", "text/plain")]
)
def test_an_order_that_is_none_is_refused(client, fake, body, kind):
    assert client.post("/order", headers=OWN, data=body, content_type=kind).status_code in (400, 415)
    assert client.post("/call/explode", headers=OWN).status_code == 404
    assert fake.called == []


def test_it_serves_on_loopback_and_a_taken_port_is_one_line(fake, listening):
    server = serve(fake, 0)
    try:
        assert listening(server.port) == {"127.0.0.1"}
        with urllib.request.urlopen(f"http://127.0.0.1:{server.port}/camera/dorsal.jpg", timeout=5) as answer:
            assert answer.read() == b"jpeg"
        with pytest.raises(InputError, match=f"port {server.port} of 127.0.0.1 is taken"):
            serve(fake, server.port)
    finally:
        server.shutdown()
        server.server_close()
    assert server.socket.fileno() == -1


def test_a_console_that_is_held_up_keeps_few_pictures_and_every_word_of_safety():
    for topic in (topics.DORSAL_IMAGE, topics.LATERAL_IMAGE):
        heard = delivery(topic)
        assert heard.depth * 640 * 480 < 4e6
        assert heard.reliability == ReliabilityPolicy.BEST_EFFORT
    for topic in (topics.LEG_STATES, topics.BED_BLOWER, topics.DIAGNOSTICS):
        heard = delivery(topic)
        assert heard.depth == topic.depth
        assert heard.reliability == ReliabilityPolicy.RELIABLE


def test_a_bed_that_says_nothing_does_not_end_the_console():
    one = object.__new__(ConsoleNode)
    one._lock, one._state = threading.Lock(), Console({})
    show = one._handler(topics.BED_STATUS)
    show(DiagnosticArray())
    show(messages.diagnostics(1, "bed", {"stage": "pulse"}))
    assert one._state.bed == {"stage": "pulse"}


@pytest.mark.ros
def test_a_parameter_that_nothing_would_come_of_is_refused(domain):
    rclpy.init(args=["console", "--ros-args", "-p", "port:=0"])
    one = ConsoleNode()
    try:
        for name, value in (("port", 9999), ("picture_rate_hz", 1.0)):
            (result,) = one.set_parameters([Parameter(name, value=value)])
            assert not result.successful
            assert "restart it" in result.reason
    finally:
        one.close()
        end_timers(one)
        rclpy.try_shutdown()


def test_a_server_that_all_the_world_can_reach_would_be_seen(listening):
    with socket.create_server(("0.0.0.0", 0)) as open_to_all:
        assert listening(open_to_all.getsockname()[1]) == {"0.0.0.0"}
    with socket.create_server(("::1", 0), family=socket.AF_INET6) as own:
        assert listening(own.getsockname()[1]) == {"::1"}
