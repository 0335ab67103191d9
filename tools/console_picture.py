"""Screenshots of the console during a trial, docs/screenshots/console.png and in dark/: a live virtual campaign.

On a busy machine the picture shows losses; take it on an idle one.
"""

import os
import re
import signal
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import yaml
from selenium.webdriver.support.ui import WebDriverWait

from sandbot_bringup.node_table import table_path
from screenshots import OUT, PATIENCE_S, chromium, look, save

SIZE, FRAME_RATE_HZ = (1400, 1350), 25.0
BED = {"fluidise_s": 2.0, "ramp_s": 0.3, "settle_s": 0.4, "pulse_off_s": 0.3, "average_s": 0.2}
PLAN = {
    "name": "one", "cameras": "cameras.yaml", "seed": 5, "gait": "UNIFORM", "phi": [0.600, 0.605],
    "omega_rad_s": [8.0, 12.0], "replicates": 2, "periods": 10.0, "images": "none", "bed": BED,
}  # fmt: skip
CAMPAIGN_S = 600
DONE = 2
"""Trials finished before the picture is taken."""
UNDER_WAY = f"""
const state = document.getElementById("campaign-state").textContent;
return new RegExp("walking .* {DONE} of").test(state) && /legs move/.test(document.getElementById("safety").textContent)
"""
REDRAWN = """
const ink = getComputedStyle(document.documentElement).getPropertyValue("--ink").trim();
return ["speed", "packing", "curve"].every((name) => document.getElementById(name).layout?.font.color === ink)
"""
"""Whether all figures have been redrawn after a change of colours."""
NICE = 15
WALKED_MS = 2500
"""Then v_x(t) fills half of its figure, and the legs still move."""


def main() -> int:
    """Launch the nodes, run the campaign, take the pictures, end everything."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        arguments = [f"{key}:={value}" for key, value in files(folder).items()]
        run = ("ros2", "run", "sandbot_bringup", "campaign", folder / "plan.yaml", "--out", folder / "one")
        with running(folder, "launch", "ros2", "launch", "sandbot_bringup", "trackway.launch.py", *arguments):
            page = WebDriverWait(folder, PATIENCE_S).until(address)
            # A browser without a GPU draws on the CPU, so it gets a lower priority than the nodes.
            with running(folder, "campaign", *run), after_all_else(), chromium() as driver:
                driver.set_script_timeout(PATIENCE_S)
                look(driver, "light", SIZE)
                driver.get(page)
                WebDriverWait(driver, CAMPAIGN_S).until(lambda d: d.execute_script(UNDER_WAY))
                driver.execute_async_script(f"setTimeout(arguments[0], {WALKED_MS})")
                for colours, where in (("light", OUT), ("dark", OUT / "dark")):
                    look(driver, colours, SIZE)
                    WebDriverWait(driver, PATIENCE_S).until(lambda d: d.execute_script(REDRAWN))
                    save(driver, where / "console.png")
    return 0


def files(folder: Path) -> dict[str, object]:
    """Write plan and cameras; returns the launch arguments."""
    cameras = yaml.safe_load(table_path().with_name("cameras.yaml").read_text(encoding="utf-8"))
    for name in ("dorsal", "lateral"):
        cameras[name]["frame_rate_hz"] = FRAME_RATE_HZ
    (folder / "cameras.yaml").write_text(yaml.safe_dump(cameras), encoding="utf-8")
    (folder / "plan.yaml").write_text(yaml.safe_dump(PLAN), encoding="utf-8")
    bed = {f"bed.{name}": value for name, value in BED.items()}
    return bed | {"console": "true", "console.port": 0, "cameras": folder / "cameras.yaml"}


@contextmanager
def running(folder: Path, name: str, *command: object) -> Iterator[None]:
    """A process in a separate group, with its output in a file; ended by Ctrl-C."""
    with (folder / f"{name}.log").open("w") as log:
        process = subprocess.Popen([str(one) for one in command], stdout=log, stderr=log, start_new_session=True)
    try:
        yield
    finally:
        os.killpg(process.pid, signal.SIGINT)
        process.wait(60)


@contextmanager
def after_all_else() -> Iterator[None]:
    """Lower the priority of this process and of those it starts from now on."""
    os.nice(NICE)
    yield


def address(folder: Path) -> str:
    """The console's address, as soon as it is printed."""
    found = re.search(r"http://127\.0\.0\.1:\d+/", (folder / "launch.log").read_text(encoding="utf-8"))
    return found[0] if found else ""


if __name__ == "__main__":
    raise SystemExit(main())
