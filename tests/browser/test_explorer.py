"""The explorer in a real browser: see the failing region, switch the effect on, watch the error fall; the report."""

import base64
import csv
import json
import os
import re
import signal
import subprocess
import sys
import urllib.request
from contextlib import contextmanager
from dataclasses import replace

import cv2
import numpy as np
import psutil
import pytest
import yaml
from audit import accessible
from selenium import webdriver
from selenium.common.exceptions import TimeoutException
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

from sandbot_bringup.tools.campaign import main as run_campaign
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.choice import from_mapping, to_query
from sandbot_model.discovery.compare import compare
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.model import model_of
from sandbot_model.physics.walking import Inputs
from sandbot_model.report import write_comparison
from sandbot_model.tools.compare import main as compare_main
from sandbot_record.trials.csv_table import write_csv
from sandbot_record.trials.table import Row, from_rows

pytestmark = [pytest.mark.browser, pytest.mark.slow, pytest.mark.timeout(600)]

EFFECTS = {effect.identifier: effect for effect in CATALOGUE}
HIDDEN = "disturbed_ground"
FAILING = """
from sandbot_model.physics.effect import Effect, Parameter

class Brittle(Effect):
    identifier, stage, source, seen_in = "brittle", "strength", "me", "v"
    formula = "k -> k (1 + a)"
    parameters = (Parameter("a", "1", 0.0, 0.5, 0.1, "gain"),)

    def apply(self, chain, p):
        if (chain.k > 300).any():
            raise RuntimeError("no ground so hard")
        chain.k = chain.k * (1 + p["a"])
"""
TORN = "phi0.6000_w08.000_r01"
BOOST = "boost: strength: k*(1 + a*(phi - 0.6)); a [1] in -5..5"
DRAWN = """
return [...document.querySelectorAll("#effects .formula")].map(
    (place) => place.querySelector("math")?.getBoundingClientRect().width ?? 0)
"""
"""Widths of the effects' formulas."""
DROP = """
const [name, content] = arguments, dataTransfer = new DataTransfer();
dataTransfer.items.add(new File([content], name));
document.body.dispatchEvent(new DragEvent("drop", { bubbles: true, cancelable: true, dataTransfer }));
"""
PLAYED = """
const [address, done] = arguments, video = document.createElement("video");
video.onloadeddata = () => done([video.videoWidth, video.duration]);
video.onerror = () => done(null);
video.src = address;
"""
"""Width and seconds of a video of which the browser has decoded the first picture."""
PATIENCE_S = 150


@pytest.fixture(scope="module")
def trials():
    """5 φ × 6 ω × 3 replicates, made up, in which ground disturbed by the step before is weak."""
    rng = np.random.default_rng(7)
    grid = np.meshgrid([0.59, 0.60, 0.611, 0.622, 0.633], [4, 8, 12, 16, 20, 24], range(3), indexing="ij")
    phi, omega, replicate = (a.ravel() for a in grid)
    k = np.interp(phi, [0.58, 0.60, 0.633], [170, 185, 220])
    walker = model_of("simple", (HIDDEN,), EFFECTS).walker
    values = walker.predict(Inputs(k, omega, 0.4, phi), [{"k_l_n_per_m": 172.0, "s_c": 0.95}]).observables
    values = values + rng.normal(0, 1, values.shape) * [0.005, 0.0002, 0.008, 0.002]
    return from_rows(
        [
            Row(f"t{i:03d}", float(phi[i] + rng.normal(0, 2e-4)), 2e-4, float(omega[i]), "UNIFORM", float(replicate[i]),
                float(values[i, 0]), 0.005, float(values[i, 1]), float(values[i, 2]), float(values[i, 3]))
            for i in range(len(phi))
        ]
    )  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory, trials):
    folder = tmp_path_factory.mktemp("explorer")
    write_csv(trials, folder / "trials.csv")
    return folder


@contextmanager
def explorer(*arguments, fits=True):
    """The address of a running explorer that knows no ROS; ended by Ctrl-C it leaves no process behind."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("ROS_", "RMW_"))}
    command = [sys.executable, "-m", "sandbot_model.tools.explore", *map(str, arguments), "--port", "0"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    line = server.stdout.readline()
    try:
        yield re.search(r"http://127\.0\.0\.1:\d+/", line)[0]
    except BaseException:
        server.terminate()
        raise
    workers = psutil.Process(server.pid).children()
    server.send_signal(signal.SIGINT)
    assert server.wait(60) == 130
    assert bool(workers) == fits
    assert psutil.wait_procs(workers, timeout=60)[1] == []
    server.stdout.close()


@pytest.fixture(scope="module")
def address(folder):
    with explorer(folder / "trials.csv") as where:
        yield where


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Eight trials of the virtual lab in bags, one of them torn; the frames of one are kept."""
    folder = tmp_path_factory.mktemp("campaign") / "campaign"
    plan = folder.parent / "plan.yaml"
    plan.write_text("name: small\nseed: 3\ngait: UNIFORM\nphi: [0.600, 0.633]\nomega_rad_s: [8, 16]\nreplicates: 2\n")
    assert run_campaign([str(plan), "--out", str(folder), "--batch"]) == 0
    (folder / "trials.csv").unlink()
    torn = folder / "trials" / TORN / f"{TORN}_0.mcap"
    torn.write_bytes(torn.read_bytes()[:-1000])
    return folder


@pytest.fixture(scope="module")
def downloads(folder):
    return folder


class Page:
    """What a user sees and does."""

    def __init__(self, driver):
        self.driver = driver

    def open(self, address):
        self.driver.get(address)
        self.until(lambda: "error" in self.text("status"))
        return self

    def until(self, condition):
        """Wait for something to come; where it does not, say what the page says."""
        try:
            return WebDriverWait(self.driver, PATIENCE_S, poll_frequency=0.05).until(lambda _: condition())
        except TimeoutException:
            at = self.driver.switch_to.active_element.get_attribute("outerHTML")[:200]
            said = {name: self.text(name) for name in ("status", "message")}
            raise AssertionError(f"{self.driver.current_url} {said} focus at {at} {self.complaints()}") from None

    def text(self, name):
        return self.driver.execute_script("return document.getElementById(arguments[0])?.innerText ?? ''", name)

    def press(self, name):
        self.driver.find_element(By.ID, name).click()

    def choose(self, group, value):
        """By the element, not by its place: effects are sorted and folded as their fits come in."""
        one = self.driver.find_element(By.CSS_SELECTOR, f"#{group} input[value='{value}']")
        self.driver.execute_script("arguments[0].click()", one)

    def fitted(self):
        """Wait for the errors of all effects: their order is then final."""
        self.until(lambda: "…" not in self.driver.find_element(By.ID, "effects").get_attribute("textContent"))

    def error_cm_s(self):
        return float(re.search(r"error (\d+\.\d+) cm/s", self.text("status"))[1])

    def unfold(self):
        self.driver.execute_script("for (const one of document.querySelectorAll('details')) one.open = true")

    def keys(self, *keys):
        """Type at whatever has the focus."""
        webdriver.ActionChains(self.driver).send_keys(*keys).perform()

    def tab_to(self, script, limit=120, key=Keys.TAB):
        """Go on by Tab, or another key, until ``script`` is true of the element that has the focus."""
        for _ in range(limit):
            if self.driver.execute_script(f"const at = document.activeElement; return {script}"):
                return
            before = self.driver.switch_to.active_element
            self.keys(key)
            # A list moves its focus with the next frame drawn, not at once.
            self.until(lambda left=before: self.driver.switch_to.active_element != left)
        raise AssertionError(f"no element that {script} is reached by Tab")

    def background(self, figure):
        return self.driver.execute_script(
            "return document.querySelector(`#${arguments[0]} .js-plotly-plot`)?.layout.paper_bgcolor", figure
        )

    def complaints(self):
        """What the browser was told of as an error; what Dash's own library throws on its own is not the page's."""
        severe = [line["message"] for line in self.driver.get_log("browser") if line["level"] == "SEVERE"]
        print(*severe, sep="\n")
        return [message for message in severe if "/dash/deps/react-dom" not in message.split()[0]]


@pytest.fixture
def page(chromium):
    # The page of the test before asks a server that may be gone.
    chromium.get("about:blank")
    chromium.get_log("browser")
    return Page(chromium)


def test_switching_the_hidden_effect_on_brings_the_error_to_what_compare_says(page, address, trials):
    page.open(address)
    base, best = (100 * fit.rmse_m_s for fit in compare(cells_of(trials), EFFECTS, [HIDDEN]))
    assert page.error_cm_s() == pytest.approx(base, rel=0.01, abs=0.006)
    page.choose("view", "residuals")
    page.until(lambda: "cells fail" in page.text("figure-box"))
    page.choose("effects", HIDDEN)
    page.until(lambda: "disturbed ground" in page.text("status"))
    assert page.error_cm_s() == pytest.approx(best, rel=0.01, abs=0.006)
    assert page.error_cm_s() < 0.7 * base
    assert "effect=disturbed_ground" in page.driver.current_url
    page.press("undo")
    page.until(lambda: "disturbed ground" not in page.text("status"))
    assert page.complaints() == []


def test_controls_used_before_the_page_has_answered_all_count(page, folder):
    """An effect and at once another view, then three controls in one moment: a fit takes longer than a second click."""
    with explorer(folder / "trials.csv") as fresh:
        page.open(fresh)
        page.choose("effects", HIDDEN)
        page.choose("view", "residuals")
        page.until(lambda: "cells fail" in page.text("figure-box") and "disturbed ground" in page.text("status"))
        three = ("#effects input[value='leg_slip']", "#observable input[value='lift']", "#pin")
        page.driver.execute_script("for (const one of arguments) document.querySelector(one).click()", *three)
        page.until(lambda: "disturbed ground + leg slip" in page.text("status"))
        chosen = page.driver.current_url.split("?")[1]
        assert "view=residuals" in chosen
        assert "observable=lift" in chosen
        assert "against=" in chosen
        assert page.complaints() == []


def test_every_view_draws(page, address):
    for view in ("speed", "residuals", "critical", "step", "balance", "lock"):
        page.open(f"{address}?view={view}&effect={HIDDEN}&cell=3")
        page.until(lambda: page.driver.find_elements(By.CSS_SELECTOR, "#figure .main-svg"))
        accessible(page.driver, [("dark", 390)])
    # What does not help is folded away until it is asked for.
    shown = "return [...document.querySelectorAll('#effects label')].filter((one) => one.offsetParent).length"
    page.fitted()
    helpful = page.driver.execute_script(shown)
    page.press("unfold")
    assert page.driver.execute_script(shown) > helpful > 0
    # A formula is drawn as one: MathML that the browser knows has a size.
    page.until(lambda: min(page.driver.execute_script(DRAWN), default=0) > 0)
    # Texts of the figure are none of them: Plotly has attributes for formulas, too.
    page.until(lambda: page.driver.find_element(By.CSS_SELECTOR, "#figure .xtick text").text.isdecimal())
    page.open(f"{address}?view=parameters&effect={HIDDEN}")
    page.until(lambda: "stiffness of disturbed ground" in page.text("parameters"))
    page.unfold()
    accessible(page.driver)
    page.driver.get(f"{address}effects?effect={HIDDEN}")
    page.until(lambda: "still being fitted" not in page.driver.page_source)
    page.unfold()
    accessible(page.driver)
    assert page.complaints() == []


def test_a_wrong_formula_gives_a_message_and_loses_nothing_a_right_one_is_fitted(page, address):
    page.open(f"{address}?effect={HIDDEN}").unfold()
    before, address_before = page.text("status"), page.driver.current_url
    box = page.driver.find_element(By.ID, "formula")
    box.send_keys("boost: strength k*2")
    page.press("add")
    page.until(lambda: "expected" in page.text("message"))
    assert (page.text("status"), page.driver.current_url) == (before, address_before)
    box.send_keys(Keys.CONTROL, "a")
    box.send_keys(BOOST)
    page.until(lambda: "a from -5 to 5" in page.text("formula-read"))
    assert page.driver.find_elements(By.CSS_SELECTOR, "#formula-read math")
    page.press("add")
    page.until(lambda: "disturbed ground + boost" in page.text("status") and page.text("message") == "")
    # Another one, with a symbol by a press on it.
    box.send_keys(Keys.CONTROL, "a")
    box.send_keys("more: strength: k*(1 + b*")
    page.unfold()
    page.driver.find_element(By.CSS_SELECTOR, "[data-symbol='φ']").click()
    page.until(lambda: "is not an expression" in page.text("formula-read"))
    page.keys("); b in 0..1")
    page.until(lambda: "b from 0 to 1" in page.text("formula-read"))
    assert box.get_attribute("value") == "more: strength: k*(1 + b*φ); b in 0..1"


def test_an_effect_that_fails_half_way_is_named_and_the_page_goes_on(page, folder, tmp_path):
    own = tmp_path / "own.py"
    own.write_text(FAILING)
    with explorer(folder / "trials.csv", "--effects-from", own) as where:
        page.open(where)
        before = page.text("status")
        page.choose("effects", "brittle")
        page.until(lambda: "RuntimeError: no ground so hard" in page.text("message"))
        assert page.text("status") == before
        page.choose("effects", "brittle")
        page.choose("effects", HIDDEN)
        page.until(lambda: "disturbed ground" in page.text("status") and page.text("message") == "")


def test_an_unknown_effect_in_the_address_is_named(page, address):
    page.driver.get(f"{address}?effect=levitation")
    page.until(lambda: "levitation" in page.text("message"))


def test_suggest_names_the_hidden_effect_and_switches_it_on(page, address):
    page.open(address)
    page.press("suggest")
    page.until(lambda: "disturbed ground" in page.text("suggestion") and "ΔBIC" in page.text("suggestion"))
    page.press("adopt")
    page.until(lambda: "disturbed ground" in page.text("status"))


def test_why_argues_the_verdict_and_the_slider_sets_its_rivals_beside(page, address):
    """Asked for at once, without a suggestion: the discovery is run, and the page comes when it has ended."""
    page.driver.get(f"{address}why?model=simple")
    drawn = "return document.documentElement.dataset.drawn ?? ''"
    page.until(lambda: page.driver.execute_script(drawn) == "light 1")
    said = page.driver.find_element(By.CLASS_NAME, "verdict").text
    assert said.startswith("Identified. With disturbed_ground")
    thick = """const plot = document.getElementById("plot-rivals");
      return plot.data.filter((trace) => trace.showlegend && trace.line.width > 3).map((trace) => trace.name)"""
    assert page.driver.execute_script(thick) == ["+ disturbed ground"]
    page.driver.find_element(By.ID, "rung").send_keys(Keys.ARROW_LEFT)
    page.until(lambda: page.driver.execute_script(drawn) == "light 0")
    assert page.driver.execute_script(thick) == ["simple model"]
    accessible(page.driver)
    # The colours have changed and come back: the figures are drawn again.
    page.until(lambda: page.driver.execute_script(drawn) == "light 0")
    page.driver.find_element(By.LINK_TEXT, "Back to the explorer").click()
    page.until(lambda: "error" in page.text("status"))
    assert page.complaints() == []


def test_the_saved_file_reproduces_the_numbers_from_the_command_line(page, address, folder):
    page.open(f"{address}?effect={HIDDEN}&hold=delta_t_s%3D0.35")
    page.press("save")
    saved = folder / "explorer.yaml"
    page.until(saved.exists)
    content = yaml.safe_load(saved.read_text(encoding="utf-8"))
    arguments = [str(folder / "trials.csv"), "--selection", str(saved), "--json", str(folder / "again.json")]
    assert compare_main(arguments) == 0
    again = json.loads((folder / "again.json").read_text(encoding="utf-8"))["steps"][-1]
    assert content["result"]["rmse_m_s"] == pytest.approx(again["rmse_m_s"], rel=1e-9)
    assert page.error_cm_s() == pytest.approx(100 * again["rmse_m_s"], abs=0.006)
    assert to_query(from_mapping(content, "saved")) == f"?effect={HIDDEN}&hold=delta_t_s%3D0.35"


def test_a_figure_is_saved_as_drawing_picture_and_numbers(page, address, folder, trials):
    page.open(f"{address}?effect={HIDDEN}")
    for kind in ("svg", "png", "csv"):
        page.driver.find_element(By.CSS_SELECTOR, f"[data-figure=figure][data-format={kind}]").click()
        page.until((folder / f"figure.{kind}").exists)
    assert "<svg" in (folder / "figure.svg").read_text(encoding="utf-8")
    assert (folder / "figure.png").read_bytes().startswith(b"\x89PNG")
    rows = list(csv.reader((folder / "figure.csv").read_text(encoding="utf-8").splitlines()))
    assert rows[0] == ["series", "ω (rad/s)", "speed (cm/s)", "error"]
    cells = cells_of(trials)
    seen = [(float(row[1]), float(row[2])) for row in rows if row[0].endswith("measured")]
    meant = sorted(zip(cells.omega, 100 * cells.mean[:, 0], strict=True))
    assert np.array(sorted(seen)) == pytest.approx(np.array(meant), rel=1e-4)


def test_two_models_and_two_data_sets_stand_side_by_side(page, address, folder):
    page.open(address)
    page.press("pin")
    page.until(lambda: "set beside" in page.text("beside"))
    page.choose("effects", HIDDEN)
    page.until(lambda: page.text("pane-title").endswith("+ disturbed ground"))
    assert "simple model: error" in page.text("beside")
    page.until(lambda: "Difference of the two" in page.text("beside"))
    page.until(lambda: len(page.driver.find_elements(By.CSS_SELECTOR, "#beside .main-svg")) >= 2)
    page.press("unpin")
    page.until(lambda: page.text("beside") == "")
    assert page.complaints() == []
    with explorer(folder / "trials.csv", "--beside", folder / "trials.csv", "--title", "ours") as both:
        page.open(both)
        page.until(lambda: page.driver.find_elements(By.CSS_SELECTOR, "#beside .main-svg"))
        assert page.text("pane-title") == "ours: simple model"
        assert page.text("beside").startswith("trials")
        rows = (folder / "trials.csv").read_text(encoding="utf-8")
        page.driver.execute_script(DROP, "bad.csv", "phi,omega_rad_s\n0.6,8\n")
        page.until(lambda: "bad.csv: " in page.text("message"))
        page.driver.execute_script(DROP, "theirs.csv", rows)
        page.until(lambda: page.text("beside").startswith("theirs"))


def test_a_cell_of_the_map_leads_to_its_trials_waveforms_video_and_bags(page, campaign):
    late = campaign / "trials" / "phi0.6000_w08.000_r02"
    late.rename(campaign / late.name)
    with explorer(campaign) as where:
        page.open(f"{where}?view=residuals")
        assert "1 trials excluded, and why" in page.driver.page_source
        page.unfold()
        assert f"{TORN} " in page.text("excluded")
        assert "recover" in page.text("excluded")
        middle = page.until(lambda: page.driver.find_elements(By.CSS_SELECTOR, "#figure .nsewdrag"))[0]
        size = middle.size
        # Two rows, two columns: the upper right one is the strongest ground at the higher frequency.
        mouse = webdriver.ActionChains(page.driver)
        mouse.move_to_element_with_offset(middle, size["width"] // 4, -size["height"] // 4)
        mouse.pause(0.3).click().perform()
        page.until(lambda: "phi0.6330_w16.000_r01" in page.text("trials"))
        seen = "const box = document.getElementById('trials').getBoundingClientRect(); return [box.top, innerHeight]"
        page.until(lambda: -1 <= page.driver.execute_script(seen)[0] < page.driver.execute_script(seen)[1] / 2)
        framed = (
            "return (document.querySelector('#figure .js-plotly-plot').layout.shapes || []).map((s) => [s.x0, s.y0])"
        )
        page.until(lambda: page.driver.execute_script(framed) == [[0.5, 0.5]])
        plots = "[...document.querySelectorAll('#waveforms .js-plotly-plot')]"
        names = f"return {plots}.flatMap((plot) => plot.data.map((trace) => trace.name))"
        page.until(lambda: len(page.driver.execute_script(names)) == 3)
        assert page.driver.execute_script(names)[0] == "model"
        frames = page.driver.find_elements(By.CSS_SELECTOR, "#trials .film img")
        assert len(frames) == 4
        assert all("lateral camera" in frame.get_attribute("alt") for frame in frames)
        link = page.driver.find_element(By.PARTIAL_LINK_TEXT, "phi0.6330_w16.000_r01").get_attribute("href")
        with urllib.request.urlopen(link) as answer:
            assert answer.read(5) == b"\x89MCAP"
        watched_on_one_clock(page)
        page.open(f"{where}?view=lock")
        assert page.driver.find_element(By.TAG_NAME, "header").text.startswith("campaign\n6 trials used")
        (campaign / late.name).rename(late)
        page.until(lambda: "\n7 trials used" in page.driver.find_element(By.TAG_NAME, "body").text)
        assert "view=lock" in page.driver.current_url
        assert page.complaints() == []


def watched_on_one_clock(page):
    """A trial of the list: scrubbed by keyboard, then played to its end."""
    page.driver.find_element(By.CSS_SELECTOR, "[aria-label='watch phi0.6330_w16.000_r01']").click()
    page.until(lambda: page.driver.execute_script("return document.documentElement.dataset.drawn") == "light")
    at = "const film = document.getElementById('film'), cursor = document.getElementById('cursor');"
    state = f"{at} return [film.src, cursor.style.left, document.getElementById('leg-0').getAttribute('transform')]"
    before = page.driver.execute_script(state)
    clock = page.driver.find_element(By.ID, "clock")
    clock.send_keys(*[Keys.PAGE_UP] * 3)
    after = page.driver.execute_script(state)
    assert all(one != other for one, other in zip(before, after, strict=True))
    assert "measured" in page.text("reading")
    page.until(lambda: page.driver.execute_script(f"{at} return film.complete && film.naturalWidth > 0"))
    clock.send_keys(Keys.END, Keys.PAGE_DOWN)
    page.press("play")
    page.until(lambda: page.text("play") == "Play")
    reached = float(re.search(r"t = ([\d.]+) s", page.text("reading"))[1])
    assert reached == pytest.approx(float(clock.get_attribute("max")), abs=0.01)
    accessible(page.driver)
    clip = page.driver.find_element(By.CSS_SELECTOR, "a.download").get_attribute("href")
    width, duration_s = page.driver.execute_async_script(PLAYED, clip)
    assert width == 960
    assert duration_s == pytest.approx(4 * (reached - float(clock.get_attribute("min"))), abs=0.1)


def test_a_video_that_no_browser_decodes_would_be_seen(page, tmp_path):
    writer = cv2.VideoWriter(str(tmp_path / "old.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 25, (64, 64))
    writer.write(np.zeros((64, 64, 3), np.uint8))
    writer.release()
    old = base64.b64encode((tmp_path / "old.mp4").read_bytes()).decode()
    assert page.driver.execute_async_script(PLAYED, f"data:video/mp4;base64,{old}") is None


def test_an_empty_table_opens_a_page_that_says_why(page, folder):
    (folder / "empty.csv").write_text("phi,omega_rad_s,speed_m_s\n")
    with explorer(folder / "empty.csv", fits=False) as where:
        page.driver.get(where)
        said = page.driver.find_element(By.CSS_SELECTOR, "[role=alert]").text
    assert said.startswith("Nothing can be shown.")
    assert "no trials: nothing below the header" in said


def test_thin_data_open_a_page_that_says_what_it_can_not_show(page, folder, trials):
    one = trials.select((np.abs(trials.phi - 0.633) < 0.003) & (trials.replicate == 0))
    write_csv(replace(one, lift_m=np.full(len(one), np.nan)), folder / "thin.csv")
    with explorer(folder / "thin.csv") as where:
        for view in ("speed", "residuals", "critical", "step", "balance", "lock", "parameters"):
            page.open(f"{where}?view={view}&cell=0")
            page.until(lambda: page.driver.find_elements(By.CSS_SELECTOR, "#figure .main-svg"))
        said = page.driver.find_element(By.TAG_NAME, "header").text
        assert "every trial is at φ = 0.633" in said
        assert "no condition was repeated" in said
        assert "Body lift: not measured" in said
        assert page.complaints() == []


def test_the_page_is_used_by_keyboard_alone(page, address):
    """Tab, Space, Enter and arrows: an effect on, another view, a formula, a condition, undo."""
    page.open(address)
    page.keys(Keys.TAB)
    assert page.driver.switch_to.active_element.text == "Skip to the figures"
    page.fitted()
    page.tab_to(f"at.value === '{HIDDEN}'")
    page.keys(Keys.SPACE)
    page.until(lambda: "disturbed ground" in page.text("status"))
    page.tab_to("at.innerText === 'Your own effect'")
    page.keys(Keys.ENTER, Keys.TAB, BOOST, Keys.ENTER)
    page.until(lambda: "boost" in page.text("status"))
    page.tab_to("at.name !== undefined && at.closest('#view') !== null")
    page.keys(Keys.ARROW_RIGHT)
    page.until(lambda: "view=residuals" in page.driver.current_url)
    page.tab_to("at.closest('#cell') !== null || at.id === 'cell'")
    page.keys(Keys.ENTER)
    page.until(lambda: page.driver.switch_to.active_element.get_attribute("type") == "search")
    page.tab_to("at.type === 'radio' && at.value === '1'", key=Keys.ARROW_DOWN)
    page.keys(Keys.ENTER)
    page.until(lambda: "cell=1" in page.driver.current_url)
    page.until(lambda: "Trials of this condition" in page.text("trials"))
    assert page.complaints() == []


def test_every_control_has_a_name_and_every_figure_a_description(page, address):
    page.open(f"{address}?view=parameters&cell=1").unfold()
    nameless = """
      const named = (one) => one.labels?.length || one.ariaLabel || one.innerText?.trim() || one.title
        || one.getAttribute('aria-labelledby');
      const controls = "button, input, select, textarea, a[href], [role=slider], [role=combobox]";
      const shown = (one) => one.offsetParent && !one.ariaHidden;
      return [...document.querySelectorAll(controls)].filter((one) => shown(one) && !named(one))
        .map((one) => one.outerHTML.slice(0, 200));"""
    assert page.driver.execute_script(nameless) == []
    says = """return [...document.querySelectorAll('.plot[role=group]')]
      .map((one) => document.getElementById(one.getAttribute('aria-labelledby')).innerText)"""
    texts = page.driver.execute_script(says)
    assert len(texts) >= 2
    assert all(re.search(r"\d+\.\d+ cm/s", text) for text in texts)


@pytest.mark.parametrize(("scheme", "paper"), [("dark", "#171a1f"), ("light", "#ffffff")])
def test_dark_and_light_follow_the_reader(page, address, scheme, paper):
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    try:
        page.open(address)
        page.until(lambda: page.background("figure") == paper)
    finally:
        page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_trials_behind_a_cell_are_listed(page, address):
    page.open(f"{address}?cell=4")
    page.until(lambda: "Trials of this condition" in page.text("trials"))
    assert page.text("trials").count(" ok") + page.text("trials").count("\tok") == 3


def test_the_report_draws_without_a_network_and_its_steps_switch(page, folder, trials):
    path = folder / "report.html"
    fits = compare(cells_of(trials), EFFECTS, [HIDDEN])
    write_comparison(path, fits, trials, title="report")
    page.driver.get(path.as_uri())
    drawn = "return document.documentElement.dataset.drawn ?? ''"
    page.until(lambda: page.driver.execute_script(drawn) == "light 1")
    assert len(page.driver.find_elements(By.CSS_SELECTOR, ".plot .main-svg")) >= 7
    accessible(page.driver)
    assert page.driver.execute_script("return performance.getEntriesByType('resource').length") == 0
    slider = page.driver.find_element(By.ID, "rung")
    slider.send_keys(Keys.ARROW_LEFT)
    page.until(lambda: page.driver.execute_script(drawn) == "light 0")
    assert slider.get_attribute("aria-valuetext").startswith("simple model error")
    page.driver.find_element(By.CSS_SELECTOR, "[data-rung='1']").click()
    page.until(lambda: page.driver.execute_script(drawn) == "light 1")
    page.driver.find_element(By.CSS_SELECTOR, "[data-figure=balance][data-format=csv]").click()
    page.until((folder / "balance.csv").exists)
    assert (folder / "balance.csv").read_text(encoding="utf-8").startswith("series,depth (cm),force on a leg (N),error")
    assert page.complaints() == []


def test_the_atlas_shows_its_plates(page, address):
    page.driver.get(f"{address}atlas?effect={HIDDEN}")
    missing = "return [...document.images].filter((one) => !one.complete || !one.naturalWidth).length"
    page.until(lambda: page.driver.execute_script(missing) == 0)
    assert len(page.driver.find_elements(By.CSS_SELECTOR, "#atlas img")) >= 6
    accessible(page.driver)
    assert page.complaints() == []


def test_an_image_without_words_and_a_page_too_wide_would_be_seen(page):
    page.driver.get("data:text/html,<html lang=en><title>t</title><main><h1>t</h1><img src=x><p style='width:900px'>t")
    with pytest.raises(AssertionError, match="image-alt"):
        accessible(page.driver)
    page.driver.execute_script("document.images[0].alt = 'a wide one'")
    with pytest.raises(AssertionError, match=r"390.*900px"):
        accessible(page.driver)


def test_a_slider_holds_a_value_and_all_can_be_fitted_again(page, address):
    page.open(f"{address}?view=parameters")
    fitted = page.text("status")
    page.until(lambda: page.driver.find_elements(By.CSS_SELECTOR, "#by-hand [role=slider]"))
    page.driver.find_element(By.CSS_SELECTOR, "#by-hand [role=slider]").send_keys(Keys.ARROW_LEFT)
    page.until(lambda: "held by hand" in page.text("status"))
    assert "hold=delta_t_s" in page.driver.current_url
    # The sliders have been made anew: the keyboard is still at this one.
    for _ in range(2):
        before = page.driver.current_url
        page.until(lambda: page.driver.execute_script("return document.activeElement.role") == "slider")
        page.keys(Keys.ARROW_LEFT)
        page.until(lambda was=before: page.driver.current_url != was)
    assert page.driver.current_url.count("hold=") == 1
    page.press("release")
    page.until(lambda: page.text("status") == fitted)


def test_a_narrow_window_stays_usable(page, address):
    page.driver.set_window_size(480, 1400)
    try:
        page.open(f"{address}?view=residuals")
        wide = "return document.documentElement.scrollWidth - document.documentElement.clientWidth"
        assert page.driver.execute_script(wide) <= 0
        page.choose("effects", "leg_slip")
        page.until(lambda: "leg slip" in page.text("status"))
    finally:
        page.driver.set_window_size(1400, 1400)
