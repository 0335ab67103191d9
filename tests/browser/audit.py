"""axe-core on a page as it is shown, wide and narrow, in both colours."""

from contextlib import suppress
from pathlib import Path

from selenium.common.exceptions import TimeoutException
from selenium.webdriver.support.ui import WebDriverWait

AXE = Path(__file__).parent / "axe" / "axe.min.js"
AUDIT = """
const done = arguments[arguments.length - 1];
const context = { exclude: [".main-svg"] }, options = { resultTypes: ["violations"] };
axe.run(context, options).then(({ violations, passes }) => done([passes.length,
  violations.flatMap(({ id, nodes }) => nodes.map((node) => `${id}: ${node.html.slice(0, 160)}`))]));
"""
"""How many rules find something to check, and violations. Figures' drawings are left out: axe judges no contrast of
their words, passes all else, and takes a third of its time for it."""
BEYOND = """
return [...document.querySelectorAll("body *")].filter((one) => one.getBoundingClientRect().right > innerWidth + 1)
  .slice(0, 3).map((one) => one.outerHTML.slice(0, 120)).filter(() => document.documentElement.scrollWidth > innerWidth)
"""
"""What makes the page wider than its window."""
CUT = """
const box = (one) => one && one.getBoundingClientRect(), found = [];
for (const plot of document.querySelectorAll(".js-plotly-plot")) {
  const [bar, legend] = [".modebar-group", ".legend"].map((name) => box(plot.querySelector(name)));
  if (bar && legend && bar.left < legend.right && legend.top < bar.bottom && legend.bottom > bar.top)
    found.push(`buttons over the legend of ${plot.id}`);
  for (const text of plot.querySelectorAll(".main-svg text")) {
    const [inner, outer] = [box(text), box(text.ownerSVGElement)];
    if (inner.width && (inner.left < outer.left - 1 || inner.right > outer.right + 1 || inner.top < outer.top - 1
        || inner.bottom > outer.bottom + 1)) found.push(`cut in ${plot.id}: ${text.textContent}`);
  }
}
return found
"""
"""Words of figures that end beyond their edge, and legends below the buttons."""
PATIENCE_S = 150
REDRAW_S = 10
"""Figures are drawn again for another width, after the page has it."""
LEAST = 15
"""Rules that find something to check on the smallest page: fewer, and it was not there yet."""


def accessible(driver, screens=(("light", 1400), ("dark", 390))):
    """No violation and nothing beyond the window's edge, in these colours and widths; wide and light afterwards."""
    driver.set_script_timeout(PATIENCE_S)
    driver.execute_script(AXE.read_text(encoding="utf-8"))
    try:
        for scheme, width in screens:
            screen(driver, scheme, width)
            checked, found = driver.execute_async_script(AUDIT)
            assert checked >= LEAST, checked
            assert found == [], (scheme, width, found)
            assert (left := misplaced(driver)) == [], (scheme, width, left)
    finally:
        screen(driver, "light", 1400)


def misplaced(driver):
    """What is cut off, or beyond the window's edge."""
    return [one for script in (BEYOND, CUT) for one in still_there(driver, script)]


def still_there(driver, script):
    """What a script finds on the page once its figures have their places."""
    with suppress(TimeoutException):
        WebDriverWait(driver, REDRAW_S, poll_frequency=0.05).until(lambda _: driver.execute_script(script) == [])
    return driver.execute_script(script)


def screen(driver, scheme, width):
    """A screen so wide, in the colours of this scheme."""
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    metrics = {"width": width, "height": 1400, "deviceScaleFactor": 1, "mobile": False}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
