"""The console's page where the line to it, or the console itself, is not as it should be: without a trackway."""

import threading
import time

import pytest
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

from sandbot_bringup.console import Console
from sandbot_bringup.console_page import serve

pytestmark = [pytest.mark.browser, pytest.mark.slow]

PATIENCE_S = 60


class Slow:
    """A console that takes ``state_s`` to tell its state, and never answers STOP until it is ``over``."""

    actions = ()

    def __init__(self):
        self.state_s, self.over = 0.0, threading.Event()

    def snapshot(self, _page):
        made = Console({}).snapshot(time.monotonic())
        time.sleep(self.state_s)
        return made

    def picture(self, _camera):
        return None

    def stop(self):
        self.over.wait()

    acknowledge = order = call = None


@pytest.fixture
def console(chromium):
    source = Slow()
    server = serve(source, 0)
    chromium.get(f"http://127.0.0.1:{server.port}/")
    until(chromium, "connection", "live")
    yield source
    source.over.set()
    chromium.get("about:blank")
    server.shutdown()
    server.server_close()


def until(browser, name, text):
    shown = "return document.getElementById(arguments[0]).textContent"
    WebDriverWait(browser, PATIENCE_S, 0.1).until(lambda _: text in browser.execute_script(shown, name))


def test_what_comes_late_is_not_called_live(console, chromium):
    console.state_s = 3.0
    until(chromium, "safety", "not known: the console does not answer")
    time.sleep(console.state_s + 0.5)  # what was asked first would have come
    until(chromium, "connection", "connection lost")
    console.state_s = 0.0
    until(chromium, "connection", "live")


@pytest.mark.usefixtures("console")
def test_who_stops_a_console_that_is_stuck_is_told_to_cut_the_power(chromium):
    chromium.find_element(By.TAG_NAME, "body").send_keys(Keys.ESCAPE)
    until(chromium, "said", "NO ANSWER FROM THE CONSOLE: cut the power")
