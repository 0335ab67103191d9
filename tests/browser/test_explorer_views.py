"""Every view of the explorer in a real browser: drawn, by keyboard, narrow, in either light, with thin data."""

import re
from dataclasses import replace
from urllib.parse import unquote

import numpy as np
import pytest
from audit import accessible, misplaced, screen
from explorer_page import HIDDEN, explorer
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from sandbot_record.trials.csv_table import write_csv

pytestmark = [pytest.mark.browser, pytest.mark.slow, pytest.mark.timeout(600)]

BOOST = "boost: strength: k*(1 + a*(phi - 0.6)); a [1] in -5..5"
DRAWN = """
return [...document.querySelectorAll("#effects .formula")].map(
    (place) => place.querySelector("math")?.getBoundingClientRect().width ?? 0)
"""
"""Widths of the effects' formulas."""


def test_every_view_draws(page, address):
    screen(page.driver, "dark", 390)
    for view in ("residuals", "critical", "step", "balance", "lock", "speed"):
        page.open(f"{address}?view={view}&effect={HIDDEN}&cell=3")
        page.until(lambda: page.driver.find_elements(By.CSS_SELECTOR, "#figure .main-svg"))
        assert misplaced(page.driver) == []
    # Views differ in their figures, of whose drawing axe asks nothing.
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
    tick = "return document.querySelector('#figure .xtick text')?.textContent ?? ''"
    page.until(lambda: page.driver.execute_script(tick).isdecimal())
    page.open(f"{address}?view=parameters&effect={HIDDEN}")
    page.until(lambda: "stiffness of disturbed ground" in page.text("parameters"))
    page.unfold()
    accessible(page.driver)
    page.driver.get(f"{address}effects?effect={HIDDEN}")
    page.until(lambda: "still being fitted" not in page.driver.page_source)
    page.unfold()
    accessible(page.driver)
    assert page.complaints() == []


def test_why_argues_the_verdict_and_the_slider_sets_its_rivals_beside(page, address):
    """Asked for at once, without a suggestion: the discovery is run, and the page comes when it has ended."""
    page.driver.get(f"{address}why?model=simple")
    drawn = "return document.documentElement.dataset.drawn ?? ''"
    page.until(lambda: page.driver.execute_script(drawn) == "light 1")
    said = page.driver.find_element(By.CLASS_NAME, "verdict").text
    assert said.startswith("Identified. With disturbed ground")
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


def test_the_atlas_shows_its_plates(page, address):
    page.driver.get(f"{address}atlas?effect={HIDDEN}")
    missing = "return [...document.images].filter((one) => !one.complete || !one.naturalWidth).length"
    page.until(lambda: page.driver.execute_script(missing) == 0)
    assert len(page.driver.find_elements(By.CSS_SELECTOR, "#atlas img")) >= 6
    accessible(page.driver)
    assert page.complaints() == []


def test_an_empty_table_opens_a_page_that_says_why(page, folder):
    (folder / "empty.csv").write_text("phi,omega_rad_s,speed_m_s\n")
    with explorer(folder / "empty.csv", fits=False) as where:
        page.driver.get(where)
        said = page.driver.find_element(By.CSS_SELECTOR, "[role=alert]").text
    assert said.startswith("Nothing can be shown.")
    assert "no trials: nothing below the header" in said


@pytest.mark.whole
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
    page.tab_to("at.type === 'radio' && at.value.endsWith(',8,UNIFORM')", key=Keys.ARROW_DOWN)
    page.keys(Keys.ENTER)
    page.until(lambda: ",8,UNIFORM" in unquote(page.driver.current_url))
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


@pytest.mark.whole  # the negative control of the audit
def test_an_image_without_words_and_a_page_too_wide_would_be_seen(page):
    page.driver.get("data:text/html,<html lang=en><title>t</title><main><h1>t</h1><img src=x><p style='width:900px'>t")
    with pytest.raises(AssertionError, match="image-alt"):
        accessible(page.driver)
    page.driver.execute_script("document.images[0].alt = 'a wide one'")
    with pytest.raises(AssertionError, match=r"390.*900px"):
        accessible(page.driver)
