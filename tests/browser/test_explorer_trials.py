"""Trials, films and bags behind the explorer's figures in a real browser; the report."""

import base64
import csv
import re
import urllib.request
from functools import partial

import cv2
import numpy as np
import pytest
from audit import accessible, screen
from explorer_page import HIDDEN, explorer
from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.compare import compare
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.report import atlas_section, write_comparison

pytestmark = [pytest.mark.browser, pytest.mark.slow, pytest.mark.timeout(600)]

EFFECTS = {effect.identifier: effect for effect in CATALOGUE}
TORN = "phi0.6000_w08.000_r01"
PLAYED = """
const [address, done] = arguments, video = document.createElement("video");
video.onloadeddata = () => done([video.videoWidth, video.duration]);
video.onerror = () => done(null);
video.src = address;
"""
"""Width and seconds of a video of which the browser has decoded the first picture."""


@pytest.fixture(scope="module")
def campaign(tmp_path_factory, batch_campaign, slow_cameras):
    """Eight trials of the virtual lab in bags, one of them torn; the frames of one are kept."""
    folder = tmp_path_factory.mktemp("campaign") / "campaign"
    plan = folder.parent / "plan.yaml"
    small = (
        "name: small\nseed: 3\ngait: UNIFORM\nphi: [0.600, 0.633]\nomega_rad_s: [8, 16]\nreplicates: 2\nperiods: 4\n"
    )
    plan.write_text(f"{small}cameras: {slow_cameras}\n")
    assert batch_campaign(plan, "--out", folder) == 0
    (folder / "trials.csv").unlink()
    torn = folder / "trials" / TORN / f"{TORN}_0.mcap"
    torn.write_bytes(torn.read_bytes()[:-1000])
    return folder


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
        page.until(lambda: "\n7 trials used" in page.driver.execute_script("return document.body.innerText"))
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


def test_trials_behind_a_cell_are_listed(page, address):
    page.open(f"{address}?cell=4")
    page.until(lambda: "Trials of this condition" in page.text("trials"))
    assert page.text("trials").count(" ok") + page.text("trials").count("\tok") == 3


def test_the_report_draws_without_a_network_and_its_steps_switch(page, downloads, trials):
    path = downloads / "report.html"
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
    page.until((downloads / "balance.csv").exists)
    rows = list(csv.DictReader((downloads / "balance.csv").read_text(encoding="utf-8").splitlines()))
    assert {(row["x name"], row["y name"]) for row in rows} == {("depth (cm)", "force on a leg (N)")}
    assert {row["panel"] for row in rows} == {f"φ {phi:.3f}" for phi in cells_of(trials).level_phi}
    assert page.complaints() == []


SIZES = "return [...document.querySelectorAll('.plot')].map(({_fullLayout: at}) => [at.width, at.height])"


def told(driver, event):
    driver.execute_script("window.dispatchEvent(new Event(arguments[0]))", event)


def test_a_report_prints_alike_before_and_after_a_resize_and_fills_the_screen_again(
    page, downloads, trials, monkeypatch
):
    """Paper has its own width and height; a resize of the window changes neither."""
    monkeypatch.setattr(atlas_section, "PLATES", ())  # pictures, which nothing draws anew
    path = downloads / "printed.html"
    write_comparison(path, compare(cells_of(trials), EFFECTS), trials, title="report")
    sizes = partial(page.driver.execute_script, SIZES)
    screen(page.driver, "light", 1400)
    page.driver.get(path.as_uri())
    page.until(lambda: page.driver.execute_script("return document.documentElement.dataset.drawn") == "light 0")
    wide = sizes()
    told(page.driver, "beforeprint")
    page.until(lambda: sizes() != wide)
    paper = sizes()
    told(page.driver, "afterprint")
    page.until(lambda: sizes() == wide)
    screen(page.driver, "light", 700)
    page.until(lambda: sizes() != wide)
    told(page.driver, "beforeprint")
    page.until(lambda: sizes() == paper)
