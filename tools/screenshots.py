"""Every view of the explorer and the report as a picture in docs/screenshots, and in dark/ below it.

A campaign of 70 trials is run on the virtual lab, in whose ground a leg that steps into its own crater finds it weak
(disturbed ground), and each page is opened in Chromium. ``python tools/screenshots.py``
takes about five minutes; given a campaign it takes that one, and given names of pictures those only.
"""

import argparse
import io
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from PIL import Image
from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

OUT = Path(__file__).resolve().parent.parent / "docs" / "screenshots"
PATIENCE_S = 120
COLOURS = 256
"""A picture of a page has few: a palette makes it half the size."""
PLAN = """\
name: collapse
seed: 2009
gait: UNIFORM
phi: [0.590, 0.600, 0.611, 0.622, 0.633]
omega_rad_s: [4, 8, 12, 16, 20, 24, 30]
replicates: 2
"""
WORLD = """\
schema: sandbot.world/1
phi_knots: [0.58, 0.6, 0.633]
k_knots_n_per_m: [170.0, 195.0, 220.0]
delta_t_s: 0.4
effects: {disturbed_ground: {k_l_n_per_m: 172.0, s_c: 0.95}}
noise: {scale: 1.0, speed_sd_m_s: 0.005, lift_sd_m: 0.0003, peak_sd: 0.01, first_step_sd_m: 0.001, phi_sd: 0.0005}
"""
TITLE = "Walking collapses on loose ground"
HIDDEN = "disturbed_ground"
FITTED = """return /error/.test(document.getElementById('status')?.innerText ?? '')
    && !!document.querySelector('#figure .main-svg')
    && /→/.test(document.getElementById('effects').innerText)
    && !/…/.test(document.getElementById('effects').innerText)"""
CARDS_FITTED = "return !document.body.innerText.includes('still being fitted')"
FILMED = "phi0.6330_w16.000_r01"
DRAWN = "return document.documentElement.dataset.drawn !== undefined"

PLATES = "return document.images.length > 5 && [...document.images].every((one) => one.complete && one.naturalWidth)"

Act = Callable[[webdriver.Chrome], None]


@dataclass(frozen=True)
class Shot:
    """One picture: the page, its size, and the actions before it is taken."""

    name: str
    query: str = ""
    size: tuple[int, int] = (1360, 1120)
    act: Act | None = None
    scroll_to: str = ""
    """CSS selector of the element at the top of the picture; empty: the top of the page."""


def suggest(driver: webdriver.Chrome) -> None:
    """Ask for a suggestion and wait for it."""
    driver.find_element(By.ID, "suggest").click()
    done = "return document.getElementById('suggestion').innerText.includes('ΔBIC')"
    WebDriverWait(driver, PATIENCE_S).until(lambda d: d.execute_script(done))


def unfold(driver: webdriver.Chrome) -> None:
    """Open the box for one's own formula, with a wrong one in it and the message."""
    driver.execute_script("for (const one of document.querySelectorAll('.controls details')) one.open = true")
    driver.find_element(By.ID, "formula").send_keys("boost: strength: k*(1 + a*")
    driver.find_element(By.ID, "add").click()
    said = "return document.getElementById('message').innerText !== ''"
    WebDriverWait(driver, PATIENCE_S).until(lambda d: d.execute_script(said))


ON = f"?effect={HIDDEN}"


def scrub(driver: webdriver.Chrome) -> None:
    """Put the time cursor into the third period, where a leg holds."""
    move = "const clock = document.getElementById('clock'); clock.value = 0.5; clock.dispatchEvent(new Event('input'))"
    driver.execute_script(move)


EXPLORER = (
    Shot("1-base-model"),
    Shot("2-where-it-fails", "?view=residuals", (1360, 980)),
    Shot("3-effect-on", ON),
    Shot("4-where-it-fails-no-more", f"{ON}&view=residuals", (1360, 980)),
    Shot("5-collapse", f"{ON}&view=critical", (1360, 980)),
    Shot("6-step-length", f"{ON}&view=step", (1360, 980)),
    Shot("7-force-balance", f"{ON}&view=balance&cell=31"),
    Shot("8-geometry-lock", f"{ON}&view=lock", (1360, 1020)),
    Shot("9-by-hand", f"{ON}&view=parameters&hold=delta_t_s%3D0.3", (1360, 1500)),
    Shot("10-behind-a-cell", f"{ON}&cell=31", (1360, 1140), scroll_to="#cell"),
    Shot("11-suggest", "", (1360, 1120), suggest),
    Shot("12-wrong-formula", ON, (1360, 1120), unfold),
    Shot("13-two-models", f"{ON}&against=%3Fmodel%3Dsimple", (1500, 1120)),
    Shot("15-narrow", f"{ON}&view=lock", (500, 1500)),
)
WHY = Shot("18-why", "why?model=simple", (1180, 1500))
TRIAL = Shot("19-trial", f"trial?trial={FILMED}&effect={HIDDEN}", (1180, 1500), scrub)
CARDS = Shot("20-cards", "effects", (1180, 1300))
ATLAS = Shot("21-atlas", f"atlas{ON}", (1180, 1500))
OWN_PAGES = ((WHY, DRAWN), (TRIAL, DRAWN), (CARDS, CARDS_FITTED), (ATLAS, PLATES))
REPORT = (Shot("16-report", "", (1180, 1500)), Shot("17-report-figures", "", (1180, 1500), scroll_to="#lock"))


def main() -> int:
    """Run the campaign, open every page, write every picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path, nargs="?", help="a campaign that was run already")
    parser.add_argument("--only", nargs="*", default=[], metavar="NAME", help="pictures to draw (default: all)")
    args = parser.parse_args()
    (OUT / "dark").mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder, chromium() as driver:
        data = Path(folder) / "collapse"
        if args.data:
            data.symlink_to(args.data.resolve())
        else:
            campaign(data)
        report = data.parent / "report.html"
        # A relative name, as the report shows its command.
        shown = ("compare", data.name, "--effects", HIDDEN, "--html", report.name, "--title", TITLE)
        ros2("sandbot_model", *shown, cwd=data.parent)
        with explorer(data) as address:
            shots = [(shot, address + shot.query, FITTED) for shot in EXPLORER]
            shots += [(shot, address + shot.query, ready) for shot, ready in OWN_PAGES]
            shots += [(shot, report.as_uri(), DRAWN) for shot in REPORT]
            for shot, where, ready in shots:
                if not args.only or shot.name in args.only:
                    take(driver, shot, where, ready, OUT, "light")
                    take(driver, shot, where, ready, OUT / "dark", "dark")
    return 0


def campaign(out: Path) -> None:
    """The trials, in bags."""
    plan, world = out.with_name("plan.yaml"), out.with_name("world.yaml")
    plan.write_text(PLAN, encoding="utf-8")
    world.write_text(WORLD, encoding="utf-8")
    ros2("sandbot_bringup", "campaign", plan, "--out", out, "--batch", "--world", world)


def ros2(package: str, executable: str, *arguments: object, cwd: Path | None = None) -> None:
    """One of the project's commands."""
    command = ["ros2", "run", package, executable, *map(str, arguments)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, cwd=cwd)


@contextmanager
def explorer(data: Path) -> Iterator[str]:
    """The address of a running explorer."""
    command = [sys.executable, "-m", "sandbot_model.tools.explore", str(data), "--port", "0", "--title", TITLE]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        address = re.search(r"http://\S+/", server.stdout.readline())
        assert address is not None, "the explorer did not start"
        yield address[0]
    finally:
        server.terminate()
        server.wait()


@contextmanager
def chromium() -> Iterator[webdriver.Chrome]:
    """A browser without a window."""
    options = webdriver.ChromeOptions()
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"):
        options.add_argument(argument)
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService("/usr/bin/chromedriver"))
    try:
        yield driver
    finally:
        driver.quit()


def take(driver: webdriver.Chrome, shot: Shot, address: str, ready: str, folder: Path, colours: str) -> None:
    """One picture in a colour scheme, small enough for a repository."""
    look(driver, colours, shot.size)
    driver.get(address)
    WebDriverWait(driver, PATIENCE_S).until(lambda d: d.execute_script(ready))
    if shot.act is not None:
        shot.act(driver)
    # After two frames everything is painted.
    driver.execute_async_script(
        "requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(arguments[0], 400)))"
    )
    if shot.scroll_to:
        driver.execute_script(f"document.querySelector({shot.scroll_to!r}).scrollIntoView()")
    save(driver, folder / f"{shot.name}.png")


def look(driver: webdriver.Chrome, colours: str, size: tuple[int, int]) -> None:
    """Emulate the reader's screen and colour scheme."""
    scheme = [{"name": "prefers-color-scheme", "value": colours}]
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": scheme})
    metrics = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": False}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)


def save(driver: webdriver.Chrome, path: Path) -> None:
    """Save the browser's view with a reduced palette."""
    picture = Image.open(io.BytesIO(driver.get_screenshot_as_png())).convert("RGB")
    picture.quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)
    print(f"{path.relative_to(OUT)}: {path.stat().st_size // 1024} kB")


if __name__ == "__main__":
    raise SystemExit(main())
