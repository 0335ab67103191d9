"""The explorer in a real browser: switch an effect on, watch the error fall; controls, formulas, what is saved."""

import csv
import json
from urllib.parse import urlsplit

import numpy as np
import pytest
import yaml
from explorer_page import HIDDEN, explorer
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.compare import compare
from sandbot_model.discovery.selection import from_mapping, to_query
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.tools.compare import main as compare_main

pytestmark = [pytest.mark.browser, pytest.mark.slow, pytest.mark.timeout(600)]

EFFECTS = {effect.identifier: effect for effect in CATALOGUE}
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
BOOST = "boost: strength: k*(1 + a*(phi - 0.6)); a [1] in -5..5"
COLUMNS = """
const axes = document.querySelector("#figure .js-plotly-plot")._fullLayout;
return [axes.xaxis, axes.xaxis2].filter(Boolean).map((axis) => axis._categories)
"""
DROP = """
const [name, content] = arguments, dataTransfer = new DataTransfer();
dataTransfer.items.add(new File([content], name));
document.body.dispatchEvent(new DragEvent("drop", { bubbles: true, cancelable: true, dataTransfer }));
"""


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
    # Both maps have the frequencies in order, whichever cells fail.
    page.until(lambda: len(page.driver.execute_script(COLUMNS)) == 2)
    assert all(one == sorted(one, key=float) for one in page.driver.execute_script(COLUMNS))
    assert "effect=disturbed_ground" in page.driver.current_url
    page.press("undo")
    page.until(lambda: "disturbed ground" not in page.text("status"))
    assert page.complaints() == []


@pytest.mark.whole
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


def test_a_wrong_formula_gives_a_message_and_loses_nothing_a_right_one_is_fitted(page, address):
    page.open(f"{address}?effect={HIDDEN}").unfold()
    before, address_before = page.text("status"), page.driver.current_url
    box = page.driver.find_element(By.ID, "formula")
    box.send_keys("boost: strength k*2")
    page.click("#add")
    page.until(lambda: "expected" in page.text("message"))
    assert (page.text("status"), page.driver.current_url) == (before, address_before)
    box.send_keys(Keys.CONTROL, "a")
    box.send_keys(BOOST)
    page.until(lambda: "a from -5 to 5" in page.text("formula-read"))
    assert page.driver.find_elements(By.CSS_SELECTOR, "#formula-read math")
    page.click("#add")
    page.until(lambda: "disturbed ground + boost" in page.text("status") and page.text("message") == "")
    # Another one, with a symbol by a press on it.
    box.send_keys(Keys.CONTROL, "a")
    box.send_keys("more: strength: k*(1 + b*")
    page.unfold()
    page.click("[data-symbol='φ']")
    page.until(lambda: "is not an expression" in page.text("formula-read"))
    page.keys("); b in 0..1")
    page.until(lambda: "b from 0 to 1" in page.text("formula-read"))
    assert box.get_attribute("value") == "more: strength: k*(1 + b*φ); b in 0..1"


@pytest.mark.whole
def test_an_effect_that_fails_half_way_is_named_and_the_page_goes_on(page, folder, tmp_path):
    own = tmp_path / "own.py"
    own.write_text(FAILING)
    with explorer(folder / "trials.csv", "--effects-from", own) as where:
        page.open(where)
        page.fitted()
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


def test_the_saved_file_reproduces_the_numbers_from_the_command_line(page, address, folder, downloads):
    page.open(f"{address}?effect={HIDDEN}&hold=delta_t_s%3D0.35")
    page.press("save")
    saved = downloads / "explorer.yaml"
    page.until(saved.exists)
    content = yaml.safe_load(saved.read_text(encoding="utf-8"))
    arguments = [str(folder / "trials.csv"), "--selection", str(saved), "--json", str(folder / "again.json")]
    assert compare_main(arguments) == 0
    again = json.loads((folder / "again.json").read_text(encoding="utf-8"))["steps"][-1]
    assert content["result"]["rmse_m_s"] == pytest.approx(again["rmse_m_s"], rel=1e-9)
    assert page.error_cm_s() == pytest.approx(100 * again["rmse_m_s"], abs=0.006)
    assert to_query(from_mapping(content, "saved")) == f"?effect={HIDDEN}&hold=delta_t_s%3D0.35"


def test_a_figure_is_saved_as_drawing_picture_and_numbers(page, address, downloads, trials):
    page.open(f"{address}?effect={HIDDEN}")
    for kind in ("svg", "png", "csv"):
        page.driver.find_element(By.CSS_SELECTOR, f"[data-figure=figure][data-format={kind}]").click()
        page.until((downloads / f"figure.{kind}").exists)
    assert "<svg" in (downloads / "figure.svg").read_text(encoding="utf-8")
    assert (downloads / "figure.png").read_bytes().startswith(b"\x89PNG")
    rows = list(csv.reader((downloads / "figure.csv").read_text(encoding="utf-8").splitlines()))
    assert rows[0] == ["panel", "series", "x name", "x", "y name", "y", "error"]
    cells = cells_of(trials)
    seen = [(float(row[3]), float(row[5])) for row in rows if row[1].endswith("measured")]
    meant = sorted(zip(cells.omega, 100 * cells.mean[:, 0], strict=True))
    assert np.array(sorted(seen)) == pytest.approx(np.array(meant), rel=1e-4)


@pytest.mark.whole  # the others have one page each
def test_two_models_and_two_data_sets_stand_side_by_side(page, address, folder):
    page.open(address)
    page.press("pin")
    page.until(lambda: "second model" in page.text("beside"))
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


def test_a_slider_holds_a_value_and_all_can_be_fitted_again(page, address):
    page.open(f"{address}?view=parameters")
    fitted = page.text("status")
    page.until(lambda: page.driver.find_elements(By.CSS_SELECTOR, "#by-hand [role=slider]"))
    page.driver.find_element(By.CSS_SELECTOR, "#by-hand [role=slider]").send_keys(Keys.ARROW_LEFT)
    page.until(lambda: "held by hand" in page.text("status"))
    assert "hold=delta_t_s" in page.driver.current_url
    # The keyboard is still at this one, and no press is lost.
    for _ in range(2):
        before = page.driver.current_url
        page.until(lambda: page.driver.execute_script("return document.activeElement.role") == "slider")
        page.keys(Keys.ARROW_LEFT)
        page.until(lambda was=before: page.driver.current_url != was)
    assert page.driver.current_url.count("hold=") == 1
    page.press("release")
    page.until(lambda: page.text("status") == fitted)


def test_it_listens_on_this_host_only(address, listening):
    assert listening(urlsplit(address).port) == {"127.0.0.1"}
