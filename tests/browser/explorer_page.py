"""The explorer as a process, and its page as a user sees it."""

import os
import re
import signal
import subprocess
import sys
from contextlib import contextmanager

import psutil
from selenium import webdriver
from selenium.common.exceptions import TimeoutException
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

HIDDEN = "disturbed_ground"
PATIENCE_S = 150


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
            return WebDriverWait(self.driver, PATIENCE_S, poll_frequency=0.25).until(lambda _: condition())
        except TimeoutException:
            at = self.driver.switch_to.active_element.get_attribute("outerHTML")[:200]
            said = {name: self.text(name) for name in ("status", "message")}
            raise AssertionError(f"{self.driver.current_url} {said} focus at {at} {self.complaints()}") from None

    def text(self, name):
        return self.driver.execute_script("return document.getElementById(arguments[0])?.innerText ?? ''", name)

    def press(self, name):
        self.driver.find_element(By.ID, name).click()

    def click(self, css):
        """By the element, not by its place: effects are sorted and folded as their fits come in."""
        self.driver.execute_script("arguments[0].click()", self.driver.find_element(By.CSS_SELECTOR, css))

    def choose(self, group, value):
        self.click(f"#{group} input[value='{value}']")

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
