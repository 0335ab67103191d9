from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from explorer_page import HIDDEN, Page, explorer
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.model import model_of
from sandbot_model.physics.walking import Inputs
from sandbot_record.trials.csv_table import write_csv
from sandbot_record.trials.table import Row, from_rows

CHROMIUM = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--window-size=1400,1400",
    # Whatever is asked of a host that is not this one fails.
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
)  # fmt: skip


@pytest.fixture(scope="module")
def downloads(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the browser saves files."""
    return tmp_path_factory.mktemp("downloads")


@pytest.fixture(scope="module")
def chromium(downloads: Path) -> Iterator[webdriver.Chrome]:
    """A real browser that reaches this host only."""
    options = webdriver.ChromeOptions()
    for argument in CHROMIUM:
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    options.add_experimental_option("prefs", {"download.default_directory": str(downloads)})
    service = Service("/usr/bin/chromedriver") if Path("/usr/bin/chromedriver").exists() else Service()
    driver = webdriver.Chrome(options=options, service=service)
    yield driver
    driver.quit()


@pytest.fixture(scope="module")
def trials():
    """4 φ × 5 ω × 3 replicates, made up, in which ground disturbed by the step before is weak."""
    rng = np.random.default_rng(7)
    grid = np.meshgrid([0.59, 0.60, 0.611, 0.633], [4, 8, 14, 20, 24], range(3), indexing="ij")
    phi, omega, replicate = (a.ravel() for a in grid)
    k = np.interp(phi, [0.58, 0.60, 0.633], [170, 185, 220])
    walker = model_of("simple", (HIDDEN,), {effect.identifier: effect for effect in CATALOGUE}).walker
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


@pytest.fixture(scope="module")
def address(folder):
    # One worker: most of what is fitted ahead no test looks at.
    with explorer(folder / "trials.csv", "--workers", "1") as where:
        yield where


@pytest.fixture
def page(chromium):
    # The page of the test before asks a server that may be gone.
    chromium.get("about:blank")
    chromium.get_log("browser")
    return Page(chromium)
