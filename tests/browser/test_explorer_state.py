"""The page's state in a real browser: controls, address and figures agree, whatever is pressed while figures come."""

from urllib.parse import parse_qsl, urlsplit

import pytest
from explorer_page import HIDDEN, explorer

pytestmark = [pytest.mark.browser, pytest.mark.slow, pytest.mark.timeout(600)]

# Each press after the page has had time to ask, but not to draw.
APART = """
const [gap, names] = arguments;
names.forEach((name, i) => setTimeout(
  () => document.querySelector(`#effects input[value='${name}']`).click(), i * gap));
"""
ON = "return [...document.querySelectorAll('#effects input:checked')].map((one) => one.value)"


def asked(page):
    """The effects in the address."""
    return {value for key, value in parse_qsl(urlsplit(page.driver.current_url).query) if key == "effect"}


def settled(page, wanted):
    """Address, boxes and figures say the same."""

    def same():
        figures = {name for name in ("disturbed ground", "leg slip", "cohesion") if name in page.text("status")}
        wanted_words = {name.replace("_", " ") for name in wanted}
        return asked(page) == wanted == set(page.driver.execute_script(ON)) and figures == wanted_words

    page.until(same)


# At 20 ms one press of six was still lost in one of two runs: two answers at once, of which one knows less.
@pytest.mark.whole
@pytest.mark.parametrize("gap_ms", [0, 20, 60, 200, 600])
def test_what_is_switched_on_and_off_again_at_once_is_off(page, folder, gap_ms):
    """Figures of a fresh server take a while: each press meets a page that still shows what was before."""
    with explorer(folder / "trials.csv", "--workers", "1") as fresh:
        page.open(fresh)
        page.until(lambda: page.driver.find_elements("css selector", f"#effects input[value='{HIDDEN}']"))
        page.driver.execute_script(APART, gap_ms, [HIDDEN, "leg_slip", HIDDEN, "cohesion"])
        settled(page, {"leg_slip", "cohesion"})
        page.driver.execute_script(APART, gap_ms, ["leg_slip", "leg_slip"])
        # Until the second press has been answered nothing tells that it was.
        page.until(lambda: page.driver.execute_async_script("setTimeout(arguments[0], 1500, true)"))
        settled(page, {"leg_slip", "cohesion"})
        page.press("undo")
        page.until(lambda: asked(page) == set(page.driver.execute_script(ON)))
        assert page.complaints() == []


@pytest.mark.whole  # test_explorer has a suggestion of one page
def test_a_suggestion_is_of_the_model_on_its_page(page, address):
    """What was found for the simple model is neither shown nor switched on beside the full one."""
    page.open(address)
    page.press("suggest")
    page.until(lambda: "Suggestion for the simple model" in page.text("suggestion"))
    page.choose("view", "lock")
    page.until(lambda: "view=lock" in page.driver.current_url)
    assert "Suggestion for the simple model" in page.text("suggestion")
    page.choose("model", "full")
    page.until(lambda: page.text("suggestion") == "")
    assert not page.driver.find_element("id", "adopt").is_displayed()
    page.press("suggest")
    page.until(lambda: "Trying" in page.text("suggestion"))
    # A page of the simple model has its own at once, whatever is tried for the other page.
    page.open(address)
    assert page.text("suggestion") == ""
    page.press("suggest")
    page.until(lambda: "Suggestion for the simple model" in page.text("suggestion"))
    page.press("adopt")
    page.until(lambda: "disturbed ground" in page.text("status"))
    assert page.complaints() == []
