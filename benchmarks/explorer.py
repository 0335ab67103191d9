"""The explorer in Chromium: from click to updated figure, and from address to first page."""

import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from selenium import webdriver
from selenium.webdriver.support.ui import WebDriverWait

from _drawn import drawn
from _figures import Figure
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_record.trials.csv_table import write_csv

_found: list[Figure] = []
TOGGLES = 50
NAMES = ("disturbed_ground", "leg_slip", "stance_overlap", "cable_drag", "cohesion")
PATIENCE_S = 180
SUGGESTED = "return document.getElementById('suggestion').innerText.includes('ΔBIC')"
READY = """return /error/.test(document.getElementById('status')?.innerText ?? '')
    && !!document.querySelector('#figure .main-svg')"""
TOGGLE = """
const [name, done] = arguments;
const status = document.getElementById("status"), before = status.innerText;
const plot = document.querySelector("#figure .js-plotly-plot");
const start = performance.now();
plot.on("plotly_afterplot", function drawn() {
  if (status.innerText === before) return;
  plot.removeListener("plotly_afterplot", drawn);
  done(performance.now() - start);
});
document.querySelector(`#effects input[value='${name}']`).closest("label").click();
"""


def main() -> str:
    """Markdown with what was measured."""
    sizes = {147: (7, 7, 3), 5040: (12, 20, 21)}
    with tempfile.TemporaryDirectory() as folder:
        pages, toggles, busy = [], [], os.getloadavg()[0]
        suggestions, firsts = list[float](), dict[int, float]()
        for count, shape in sizes.items():
            table = Path(folder) / f"{count}.csv"
            made_up_trials(table, *shape)
            start, first, clicks, suggested = measure(table, TOGGLES if count == 147 else 0)
            suggestions += suggested
            firsts[count] = first
            pages.append(f"| command to address, {count:,} trials | {start:.2f} s |")
            pages.append(f"| address to first page, {count:,} trials | {first:.2f} s |")
            toggles += clicks
    clicks = sorted(toggles)
    p95 = clicks[int(0.95 * len(clicks)) - 1]
    rows = [
        f"| click to updated figure, median of {len(clicks)} | {statistics.median(clicks):.0f} ms |",
        f"| click to updated figure, 95th percentile | {p95:.0f} ms |",
        f"| Suggest to its answer, 147 trials, fits ahead in | {suggestions[0]:.2f} s |",
        *pages,
    ]
    _found[:] = [
        Figure("page: click to updated figure, 95 %", f"{len(clicks)} clicks, 147 trials", p95, "< 300 ms"),
        Figure("page: Suggest", "147 trials", suggestions[0], "< 3 s"),
        Figure("page: first page", "147 trials", firsts[147], "< 1.5 s"),
    ]
    head = ["## Explorer in Chromium", "", "| what | measured |", "|---|---|"]
    note = (
        "Fits made ahead have come in before the clicks; each effect is switched on and off again. Load average of the "
        f"{os.cpu_count()} CPUs when it began {busy:.1f}, when it ended {os.getloadavg()[0]:.1f}."
    )
    return "\n".join([*head, *rows, "", note])


def figures() -> list[Figure]:
    """Those of the last ``main``."""
    return _found


def measure(table: Path, toggles: int) -> tuple[float, float, list[float], list[float]]:
    """Seconds from the command to the address and from there to the first page; milliseconds of each click, and
    seconds of a suggestion, where there are clicks.
    """
    command = [sys.executable, "-m", "sandbot_model.tools.explore", str(table), "--port", "0"]
    driver = chromium()
    begun = time.perf_counter()
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        address = re.search(r"http://\S+/", server.stdout.readline())
        assert address is not None, "the explorer did not start"
        start_up = time.perf_counter() - begun
        wait = WebDriverWait(driver, PATIENCE_S, poll_frequency=0.02)
        start = time.perf_counter()
        driver.get(address[0])
        wait.until(lambda d: d.execute_script(READY))
        first = time.perf_counter() - start
        if toggles:
            wait.until(lambda d: "…" not in d.execute_script("return document.getElementById('effects').innerText"))
        # Each effect on and off again, so that every click goes to a set that is fitted.
        clicks = [driver.execute_async_script(TOGGLE, NAMES[i // 2 % len(NAMES)]) for i in range(toggles)]
        suggested = []
        if toggles:
            wait.until(lambda d: "…" not in d.execute_script("return document.getElementById('effects').innerText"))
            start = time.perf_counter()
            driver.execute_script("document.getElementById('suggest').click()")
            wait.until(lambda d: d.execute_script(SUGGESTED))
            suggested = [time.perf_counter() - start]
        return start_up, first, clicks, suggested
    finally:
        driver.quit()
        server.terminate()
        server.wait()


def chromium() -> webdriver.Chrome:
    """A browser without a window."""
    options = webdriver.ChromeOptions()
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-background-networking"):
        options.add_argument(argument)
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService("/usr/bin/chromedriver"))
    driver.set_script_timeout(PATIENCE_S)
    return driver


def made_up_trials(path: Path, levels: int, frequencies: int, replicates: int) -> None:
    """A table of the model itself with disturbed ground and noise."""
    walker = model_of("simple", ("disturbed_ground",), catalogue()).walker
    grid = np.linspace(0.58, 0.633, levels), np.linspace(4, 28, frequencies).round(1)
    write_csv(drawn(walker, [{"k_l_n_per_m": 172.0, "s_c": 0.95}], *grid, replicates, seed=5), path)


if __name__ == "__main__":
    print(main())
