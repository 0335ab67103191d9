"""The console of a campaign: what is known, what is still possible, why the next trial is run; how to go on with it."""

import json
import time

import pytest
from audit import accessible
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

from sandbot_bringup.console import Console
from sandbot_bringup.console_page import serve
from sandbot_bringup.plan import plan_of
from sandbot_bringup.queue import Queue
from sandbot_bringup.until import with_start

pytestmark = [pytest.mark.browser, pytest.mark.slow]

PATIENCE_S = 60
WHY = "stance_overlap and leg_slip differ there by 2.3 sd in the mean speed"
LOOK = {
    "look": 2, "planned": 34, "trials": 34, "status": "identified", "effects": ["stance_overlap"],
    "text": f"34 trials: identified: stance_overlap, perhaps with leg_slip; next: φ 0.622, ω 20 rad/s, because {WHY}",
    "possible": [
        {"effect": "leg_slip", "share_of_usual": 0.5, "e_value_against": 3.2, "excluded": False, "within_reach": True},
        {"effect": "cohesion", "share_of_usual": 1.0, "e_value_against": 1.0, "excluded": False, "within_reach": False},
        {"effect": "belly_coast", "share_of_usual": 0.5, "e_value_against": 1e300, "excluded": True,
         "within_reach": False},
    ],
    "stop": "",
    "rivals": [
        {"explanation": name, "phi": phi, "omega_rad_s": [8.0, 14.0, 20.0], "speed_m_s": speed}
        for phi in (0.6, 0.622)
        for name, speed in (("stance_overlap", [0.09, 0.15, 0.18]), ("stance_overlap + leg_slip", [0.09, 0.14, 0.16]))
    ],
}  # fmt: skip
TRIAL = {"campaign": "thinking", "phi_target": 0.622, "omega_rad_s": 20.0}
INKED = """
const ink = document.createElement("i");
ink.style.color = getComputedStyle(document.documentElement).getPropertyValue("--ink");
const titles = [...document.querySelectorAll(".figure .xtitle")];
return titles.length === 3 && titles.every((one) => one.style.fill === ink.style.color);
"""
LANDED = """
const drawn = document.getElementById("curve").data ?? [];
return drawn.filter((one) => one.x.length).map((one) => [one.name, one.y.map((v) => +v.toFixed(1))])
"""
PLAN = {"name": "thinking", "phi": [0.58, 0.6, 0.622], "omega_rad_s": [8, 14, 20], "until": "verdict"}


class Watched:
    """A console whose campaign stands still; ``look`` is its last, ``status`` what else it says."""

    actions = ()
    look, status = None, {"state": "running", "stage": "walking"}
    speed_m_s = ()
    stopped = True, "legs at rest after 0.02 s; air off; the campaign is held until Go"

    def snapshot(self, _page):
        plan = with_start(plan_of(PLAN, "plan"))
        queue = Queue(plan, ())
        queue.grow(plan_of({**PLAN, "extra_trials": [{"phi": 0.622, "omega_rad_s": 20, "because": WHY}]}, "plan"))
        rows = queue.rows()
        before = next(row for row in rows[:-1] if row["phi"] == TRIAL["phi_target"])
        before |= {"state": "done", "measured": {"phi": 0.6221, "speed_m_s": 0.178}}
        rows[-1]["state"] = "running"
        status = {"campaign": "thinking", "folder": "runs/one", "queue": rows, "look": self.look, **self.status}
        made = Console({})
        made.set_trial(json.dumps({"trial_id": rows[-1]["trial_id"], **TRIAL}))
        made.set_campaign(json.dumps(status), time.monotonic())
        shown = made.snapshot(time.monotonic())
        measured = {"t_s": [-0.1 * n for n in range(len(self.speed_m_s))], "value": list(self.speed_m_s)}
        return shown | {"speed": shown["speed"] | {"measured": measured}}

    def picture(self, _camera):
        return None

    def stop(self):
        return self.stopped

    acknowledge = order = call = None


@pytest.fixture
def watched(chromium):
    source = Watched()
    server = serve(source, 0)
    source.open = lambda: chromium.get(f"http://127.0.0.1:{server.port}/")
    yield source, chromium
    chromium.get("about:blank")
    server.shutdown()
    server.server_close()


def shown(browser, name):
    return browser.find_element(By.ID, name).text


def test_it_shows_what_is_known_and_what_is_still_possible(watched):
    source, browser = watched
    source.look = LOOK
    source.open()
    WebDriverWait(browser, PATIENCE_S).until(lambda _: "identified: stance_overlap" in shown(browser, "verdict"))
    rows = [row.text for row in browser.find_elements(By.CSS_SELECTOR, "#possible tbody tr")]
    assert rows == [
        "○ leg_slip half its usual 3.2 : 1",
        "○ cohesion usual 1.0 : 1",
        "● belly_coast half its usual > 1000 : 1",
    ]
    assert WHY in shown(browser, "queue")
    for width in (390, 1400):
        browser.set_window_size(width, 900)
        assert browser.execute_script("return document.documentElement.scrollWidth - window.innerWidth") <= 0
    accessible(browser)


def test_a_point_lands_on_the_curves_of_the_rivals_at_its_own_packing(watched):
    source, browser = watched
    source.look = LOOK
    source.open()
    WebDriverWait(browser, PATIENCE_S).until(lambda _: len(browser.execute_script(LANDED)) == 3)
    assert browser.execute_script(LANDED) == [
        ["stance overlap", [9.0, 15.0, 18.0]],
        ["stance overlap + leg slip", [9.0, 14.0, 16.0]],
        ["measured, φ 0.622", [17.8]],
    ]


@pytest.mark.parametrize(
    ("speed_m_s", "low", "high"),
    [((2e-4, -1e-4), (-2, -1), (1, 2)), ((0.5, -0.2), (-30, -20), (50, 60)), ((), (0, 0), (40, 40))],
)
def test_the_noise_of_a_robot_at_rest_looks_small(watched, speed_m_s, low, high):
    """Controls: a walk fills the figure; without data the axis is as before."""
    source, browser = watched
    source.speed_m_s = speed_m_s
    source.open()
    drawn = "return document.getElementById('speed').layout?.yaxis.range"
    span = WebDriverWait(browser, PATIENCE_S).until(lambda _: browser.execute_script(drawn))
    assert low[0] <= span[0] <= low[1]
    assert high[0] <= span[1] <= high[1]


def test_of_a_campaign_that_runs_a_grid_there_is_no_verdict(watched):
    source, browser = watched
    source.open()
    WebDriverWait(browser, PATIENCE_S).until(lambda _: "thinking" in shown(browser, "campaign-name"))
    assert not browser.find_element(By.ID, "verdict-box").is_displayed()


def test_a_campaign_that_was_stopped_and_has_ended_offers_nothing_that_nobody_would_obey(watched):
    """It said "held until go" beside a grey Go and eight live buttons, and not how to go on."""
    source, browser = watched

    def live():
        return {one.text for one in browser.find_elements(By.CSS_SELECTOR, "#queue button:not(:disabled)")}

    source.open()
    wait = WebDriverWait(browser, PATIENCE_S)
    wait.until(lambda _: "walking" in shown(browser, "campaign-state"))
    assert (live(), shown(browser, "resume")) == ({"skip", "repeat"}, "")
    browser.find_element(By.TAG_NAME, "body").send_keys(Keys.ESCAPE)
    wait.until(lambda _: shown(browser, "said").endswith("; the campaign is held until Go"))
    source.status = {"state": "ended", "why": "interrupted"}
    wait.until(lambda _: "has ended: interrupted" in shown(browser, "campaign-state"))
    wait.until(lambda _: not live())
    assert shown(browser, "said") == "STOP: legs at rest after 0.02 s; air off"
    assert shown(browser, "resume") == "to go on: trackway campaign runs/one"
    accessible(browser)


def test_a_stop_that_failed_stays_on_the_page_of_a_campaign_that_has_ended(watched):
    source, browser = watched
    source.stopped = False, "legs move; air off; the campaign DOES NOT ANSWER"
    source.open()
    wait = WebDriverWait(browser, PATIENCE_S)
    wait.until(lambda _: "walking" in shown(browser, "campaign-state"))
    browser.find_element(By.TAG_NAME, "body").send_keys(Keys.ESCAPE)
    wait.until(lambda _: "NOT SEEN TO BE AT REST" in shown(browser, "said"))
    source.status = {"state": "ended", "why": "interrupted"}
    wait.until(lambda _: "to go on" in shown(browser, "resume"))
    assert shown(browser, "said").endswith("legs move; air off; the campaign DOES NOT ANSWER")


@pytest.mark.parametrize("state", ["running", "ended"])
def test_figures_follow_the_reader_s_colours(watched, state):
    source, browser = watched
    source.status = {"state": state, "why": ""}
    source.open()
    for scheme in ("dark", "light"):
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
        WebDriverWait(browser, PATIENCE_S).until(lambda _: browser.execute_script(INKED))
