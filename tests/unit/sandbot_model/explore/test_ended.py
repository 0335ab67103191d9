"""The explorer ends by Ctrl-C at once and in one line, whatever its threads and workers are at."""

import re
import signal
import subprocess
import sys
import time
import urllib.request

import psutil
import pytest

from sandbot_record.trials.csv_table import write_csv

BUSY = """
import sys, time
from multiprocessing.connection import Connection
from pathlib import Path
from sandbot_model.discovery import effect_search
from sandbot_model.tools.explore import main

def fit(task):
    Connection._send_bytes = half

def half(self, content):
    # The length of a message, of which nothing comes: a worker is ended while it sends what no pipe holds at once.
    self._send(bytes([0, 1, 0, 0]))
    Path(sys.argv[1]).with_name("begun").touch()
    time.sleep(600)

effect_search.solve = fit
sys.exit(main())
"""


@pytest.mark.slow
def test_ctrl_c_ends_it_in_one_line_while_a_fit_is_half_sent(trials, tmp_path):
    write_csv(trials, tmp_path / "trials.csv")
    (tmp_path / "explore").write_text(BUSY)
    command = [sys.executable, str(tmp_path / "explore"), str(tmp_path / "trials.csv"), "--workers", "2", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as explorer:
        try:
            address = re.search(r"http://\S+:\d+/", explorer.stdout.readline())[0]
            # A discovery, which waits for its fits in a thread of its own.
            urllib.request.urlopen(f"{address}why?model=simple", timeout=60).close()
            while not (tmp_path / "begun").exists():
                assert explorer.poll() is None
                time.sleep(0.05)
            workers = psutil.Process(explorer.pid).children()
            explorer.send_signal(signal.SIGINT)
            assert explorer.wait(20) == 130
        finally:
            explorer.kill()
        assert explorer.stderr.read() == "explore: interrupted; what was finished is kept\n"
    assert len(workers) == 2
    assert psutil.wait_procs(workers, timeout=20)[1] == []
