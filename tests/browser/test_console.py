"""The console in a real browser, over a whole trackway: one launch and one campaign, whose course the tests are."""

import json
import math
import os
import re
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import yaml
from selenium.common.exceptions import TimeoutException
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

from sandbot_bringup.journal import read_journal
from sandbot_bringup.node_table import table_path
from sandbot_common import messages, topics
from sandbot_common.ros import endpoints

pytestmark = [pytest.mark.browser, pytest.mark.ros, pytest.mark.slow, pytest.mark.timeout(600)]

BED = {"fluidise_s": 4.0, "ramp_s": 0.3, "settle_s": 0.4, "pulse_off_s": 0.3, "average_s": 0.2}
PLAN = {"name": "watched", "cameras": "cameras.yaml", "seed": 5, "gait": "UNIFORM", "phi": [0.605],
        "omega_rad_s": [6.0], "replicates": 3, "periods": 8.0, "setpoint_rate_hz": 50.0, "images": "none",
        "bed": BED}  # fmt: skip
PATIENT = {"clock.lease_s": 1.0, "clock.robot_s": 1.0, "clock.late_s": 0.25, "lab.legs_lease_s": 1.0,
           "lab.air_lease_s": 2.0, "bed.lease_s": 2.0, "bed.bad_reading_s": 2.0}  # fmt: skip
PATIENCE_S = 120
BUSY_S = 5.0
"""What a busy machine may take; docs/console.md has the seconds of a quiet one."""
REDRAWN = """["speed", "packing", "curve"].every((name) => document.getElementById(name).layout.font.color ===
  getComputedStyle(document.documentElement).getPropertyValue("--ink").trim())"""
FIRST, SECOND, THIRD = (f"phi0.6050_w06.000_r0{number}" for number in (1, 2, 3))


class Witness:
    """What robot, blower and campaign do, heard in a thread of its own; when motion and air ceased [s since 1970]."""

    def __init__(self, beside):
        self.moving = self.air = False
        self.rest_s = self.off_s = 0.0
        self.state, self.statuses = "", 0
        self._news, self._ended = threading.Condition(), threading.Event()
        endpoints.subscription(beside.node, topics.LEG_STATES, self._on_legs)
        endpoints.subscription(beside.node, topics.BED_BLOWER, self._on_air)
        endpoints.subscription(beside.node, topics.CAMPAIGN_STATUS, self._on_status)
        self.node = beside.node
        self._thread = threading.Thread(target=lambda: beside.wait(self._ended.is_set, math.inf), daemon=True)
        self._thread.start()

    def _on_legs(self, message):
        moving = any(message.velocity)
        with self._news:
            self.rest_s = time.time() if self.moving and not moving else self.rest_s
            self.moving = moving
            self._news.notify_all()

    def _on_air(self, message):
        with self._news:
            self.off_s = time.time() if self.air and message.data == 0 else self.off_s
            self.air = message.data > 0
            self._news.notify_all()

    def _on_status(self, message):
        with self._news:
            self.state, self.statuses = json.loads(message.data)["state"], self.statuses + 1
            self._news.notify_all()

    def until(self, holds):
        with self._news:
            assert self._news.wait_for(holds, PATIENCE_S), "waited in vain"

    def close(self):
        self._ended.set()
        self._thread.join()


class Page:
    """What an operator sees and does."""

    def __init__(self, driver, address):
        self.driver = driver
        driver.set_script_timeout(PATIENCE_S)
        driver.get(address)
        self.until(lambda: self.text("connection") == "live")
        # Every face the safety line ever has, and the moment STOP is pressed: looking now and then would miss some.
        driver.execute_script("""
            const line = document.getElementById("safety");
            window.faces = [line.className]; window.pressed = 0;
            new MutationObserver(() => window.faces.push(line.className)).observe(line, {attributes: true});
            for (const kind of ["pointerdown", "keydown"])
                document.addEventListener(kind, () => { window.pressed = Date.now() / 1000; }, {capture: true});
        """)

    def until(self, holds, seconds=PATIENCE_S):
        try:
            return WebDriverWait(self.driver, seconds, 0.1).until(lambda _: holds())
        except TimeoutException:
            shown = [self.text(name) for name in ("safety", "said", "campaign-state", "nodes", "log")]
            raise AssertionError("\n".join(shown)) from None

    def text(self, name):
        return self.driver.execute_script("return document.getElementById(arguments[0]).textContent", name)

    def js(self, expression):
        return self.driver.execute_script(f"return {expression}")

    def click(self, css):
        self.driver.find_element(By.CSS_SELECTOR, css).click()

    def key(self, key):
        self.driver.find_element(By.TAG_NAME, "body").send_keys(key)

    @property
    def face(self):
        """How the safety line looks now."""
        return self.js("document.getElementById('safety').className")

    def row(self, trial):
        """The class of a trial's row in the queue."""
        return self.js(f"document.querySelector('[title^=\"{trial}:\"]')?.parentElement.className")


@pytest.fixture(scope="module")
def domain_of_all(own_domain):
    with own_domain(os.getpid() * 7 + 3) as domain, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(domain))
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        yield domain


def started(folder, name, *command):
    """A process of its own group, its words in a file."""
    log = (folder / f"{name}.log").open("w")
    with log:
        return subprocess.Popen([str(one) for one in command], stdout=log, stderr=log, start_new_session=True)


def address(folder, launch):
    said = (folder / "launch.log").read_text()
    assert launch.poll() is None, said
    found = re.search(r"http://127\.0\.0\.1:\d+/", said)
    return found and found[0]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The plan and slow cameras: 100 frames and 200 set-points a second are more than a busy machine has for a browser
    beside them, which gets what legs and air leave over."""
    folder = tmp_path_factory.mktemp("console")
    cameras = yaml.safe_load(table_path().with_name("cameras.yaml").read_text())
    for name in ("dorsal", "lateral"):
        cameras[name]["frame_rate_hz"] = 25.0
    (folder / "cameras.yaml").write_text(yaml.safe_dump(cameras))
    (folder / "plan.yaml").write_text(yaml.safe_dump(PLAN))
    return folder


@pytest.fixture(scope="module")
def page(folder, domain_of_all, chromium):
    wanted = {"console": "true", "console.port": 0, "cameras": folder / "cameras.yaml"}
    quick = {f"bed.{name}": value for name, value in BED.items()} | PATIENT | wanted
    arguments = [f"{name}:={value}" for name, value in quick.items()]
    launch = started(folder, "launch", "ros2", "launch", "sandbot_bringup", "trackway.launch.py", *arguments)
    try:
        yield Page(chromium, WebDriverWait(launch, PATIENCE_S, 0.2).until(lambda _: address(folder, launch)))
    finally:
        os.killpg(launch.pid, signal.SIGINT)
        launch.wait(60)


@pytest.fixture(scope="module")
def witness(page, domain_of_all, beside_on):
    beside = beside_on(domain_of_all)
    one = Witness(beside)
    yield one
    one.close()
    beside.close()


@pytest.fixture(scope="module")
def campaign(folder, page):
    run = "import sys; from sandbot_bringup.tools.campaign import main; sys.exit(main(sys.argv[1:]))"
    plan = (folder / "plan.yaml", "--out", folder / "out", "--silence", "10")
    process = started(folder, "campaign", sys.executable, "-c", run, *plan)
    yield process
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGINT)
        process.wait(60)


def journal(folder):
    return [(one["do"], one.get("trial_id", "")) for one in read_journal(folder / "out" / "journal.jsonl")]


def go(page):
    """If the campaign is held, press Go until it goes on: just after a stop it may have been pressed before it."""
    if "HELD" not in page.until(lambda: page.text("campaign-state")):
        return

    def gone():
        page.click("#go")
        page.until(lambda: page.text("said").startswith("Go: "))
        return "stopped just now" not in page.text("said")

    page.until(gone)


def stays_held(witness):
    """Through three words of the campaign nothing moves and nothing blows."""
    count = witness.statuses

    def wrong():
        return witness.moving or witness.air or witness.state != "held"

    witness.until(lambda: wrong() or witness.statuses >= count + 3)
    assert not wrong()


def stopped(page, witness, under_way, press, said):
    """STOP while something is under way, until the page tells how soon that ended."""
    for _ in range(4):
        witness.until(under_way)
        press()
        witness.until(lambda: not under_way())
        page.until(lambda: page.text("said").startswith("STOP: "))
        if said in page.text("said"):
            return
        assert "NOT SEEN" not in page.text("said")
        # A busy machine's browser was so late that there was nothing left to stop.
        page.until(lambda: "HELD: stopped by the operator" in page.text("campaign-state"))
        go(page)
    raise AssertionError(page.text("said"))


def test_a_trackway_at_rest_gives_no_alarm(page):
    page.until(lambda: page.face == "free")
    page.until(lambda: "bed" in page.text("nodes"))
    assert page.text("topics-say") == "Topics: none missing"
    assert page.text("campaign-state") == "no campaign is running"


def test_stop_ends_a_walk_and_holds_the_campaign(page, witness, campaign):
    page.click("#campaign-state")  # a browser's first click took 7 s on a busy machine: as long as the walk
    stopped(page, witness, lambda: witness.moving, lambda: page.click("#stop"), "legs at rest after")
    legs_s = witness.rest_s - page.js("window.pressed")
    print(f"STOP from the page: legs at rest after {legs_s:.3f} s")
    assert 0 < legs_s <= BUSY_S
    page.until(lambda: "HELD: stopped by the operator" in page.text("campaign-state"))
    page.until(lambda: page.text("safety").startswith("campaign HELD until Go: "))
    assert page.row(FIRST) == "waiting"
    stays_held(witness)


def test_the_queue_obeys_while_the_campaign_is_held(page, folder):
    page.click(f"[data-order=skip][data-trial='{THIRD}']")
    page.until(lambda: page.row(THIRD) == "skipped")
    page.click("#add-box summary")
    for name, value in (("phi", "0.61"), ("omega_rad_s", "10")):
        # A space typed into a form is a space, and no STOP.
        page.driver.find_element(By.CSS_SELECTOR, f"#add [name={name}]").send_keys(Keys.SPACE, value)
    page.click("#add button")
    page.until(lambda: page.row("phi0.6100_w10.000_r01") == "waiting")
    page.driver.find_element(By.CSS_SELECTOR, "#add [name=phi]").send_keys(Keys.CONTROL, "a")
    page.driver.find_element(By.CSS_SELECTOR, "#add [name=phi]").send_keys("0.575")
    page.click("#add button")
    page.until(lambda: "refused: bed: target_phi 0.575 can't be reached" in page.text("said"))
    assert [do for do, _ in journal(folder)][-2:] == ["skip", "add"]
    assert yaml.safe_load((folder / "out" / "campaign.yaml").read_text())["extra_trials"] == [
        {"phi": 0.61, "omega_rad_s": 10.0, "replicates": 1}
    ]


@pytest.mark.parametrize("key", [Keys.ESCAPE, pytest.param(Keys.SPACE, marks=pytest.mark.whole)])
def test_a_key_ends_air_and_holds_the_campaign(page, witness, campaign, key):
    go(page)
    stopped(page, witness, lambda: witness.air, lambda: page.key(key), "air off after")
    off_s = witness.off_s - page.js("window.pressed")
    print(f"key on the page: air off after {off_s:.3f} s")
    assert 0 < off_s <= BUSY_S
    page.until(lambda: "HELD: stopped by the operator" in page.text("campaign-state"))
    stays_held(witness)


def test_what_was_held_goes_on_and_its_point_lands_on_the_page(page, witness, campaign, folder):
    go(page)

    def done():
        # A trial that a busy machine spoils is run again.
        page.js("document.querySelectorAll('#queue tr.failed [data-order=repeat]').forEach(one => one.click())")
        return page.js("document.querySelectorAll('#queue tr.done').length") > 0

    page.until(lambda: page.js("document.getElementById('packing').data[0].x.length") > 2)
    page.until(lambda: page.text("dorsal-says").endswith("com "))
    page.until(done, 300)
    drawn = "document.getElementById('curve').data.filter(one => one.mode === {!r} && one.x.length)"
    shown = drawn + ".map(one => [one.x, one.y])"
    points = page.until(lambda: page.js(shown.format("markers")))
    curves = page.js(shown.format("lines"))
    (omega,), (speed,) = points[0]
    assert min(abs(speed - np.interp(omega, *curve)) for curve in curves) < 0.2 * speed
    assert any(do == "done" for do, _ in journal(folder))


def test_nothing_of_all_this_was_called_an_overlap(page):
    """Issue 12, row 13: a red line in three of four preparations after a walk."""
    faces = page.js("window.faces")
    assert {"legs", "air", "free"} <= set(faces)
    assert not {"broken", "overlapped"} & set(faces)
    assert [one for one in page.driver.get_log("browser") if one["level"] == "SEVERE"] == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_fits_a_telephone_in_either_light(page, scheme):
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    size = {"width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": True}
    page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    page.until(lambda: page.js("document.documentElement.scrollWidth") <= 390)
    bottom = page.js("document.getElementById('stop').getBoundingClientRect().bottom")
    assert bottom == pytest.approx(844, abs=1)
    ground = page.js("getComputedStyle(document.body).backgroundColor")
    assert (sum(map(int, re.findall(r"\d+", ground)[:3])) > 380) == (scheme == "light")
    # Figures drawn in the other colours are drawn again: their words would be ink on ink.
    page.until(lambda: page.js(REDRAWN))
    page.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_a_real_overlap_is_red_until_it_is_acknowledged(page, witness, campaign):
    """By a hand that commands the blower, and a robot that says it moves, with the campaign out of the way."""
    os.killpg(campaign.pid, signal.SIGINT)
    campaign.wait(60)
    page.until(lambda: "has ended" in page.text("campaign-state"))
    legs, blower = (endpoints.publisher(witness.node, one) for one in (topics.LEG_STATES, topics.BED_BLOWER))
    still, moving = (messages.joint_state(1, topics.LEGS, *[np.full(6, value)] * 3) for value in (0.0, 1.0))

    def red():
        legs.publish(moving)
        blower.publish(messages.float64(1.0))
        return page.face in ("broken", "overlapped")

    page.until(red)
    legs.publish(still)
    page.until(lambda: page.face == "overlapped")
    assert "AIR WAS ON WHILE LEGS MOVED" in page.text("safety")

    def free():
        # What was still on its way of the overlap is one more.
        page.js("document.querySelector('#acknowledge:not([hidden])')?.click()")
        return page.face == "free"

    page.until(free)
