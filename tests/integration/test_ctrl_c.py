"""Ctrl-C at any moment of a long computation ends it in one line: imports, searches on two workers, samples."""

import os
import random
import signal
import time

import psutil
import pytest

from sandbot_lab.direct import direct_trials
from sandbot_lab.world import World
from sandbot_record.trials.csv_table import write_csv
from sandbot_record.trials.table import Row, from_rows

PHI, OMEGA = (0.59, 0.605, 0.62, 0.633), (8.0, 12.0, 16.0, 20.0, 24.0)
MOMENTS = 20
FIRST_S, LAST_S = 0.5, 8.0
"""CPU times of the command between which it is interrupted: from its imports to the end of most verdicts."""


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    world = World(effects={"disturbed_ground": {}})
    path = tmp_path_factory.mktemp("ctrl_c") / "trials.csv"
    write_csv(from_rows([Row(**row) for row in direct_trials(world, PHI, OMEGA, "UNIFORM", 3, seed=5)]), path)
    return path


def cpu_s(pid):
    """CPU time of a process and its children; none once it has ended."""
    try:
        first = psutil.Process(pid)
        family = [first, *first.children(recursive=True)]
        if first.status() == psutil.STATUS_ZOMBIE:
            return None
        return sum(sum(each.cpu_times()[:2]) for each in family)
    except psutil.NoSuchProcess:
        return None


@pytest.mark.whole
@pytest.mark.parametrize("seed", range(MOMENTS))
def test_ctrl_c_at_any_moment_is_one_line_and_130(start, table, tmp_path, seed):
    drawn = random.Random(seed)
    moment_s, again = drawn.uniform(FIRST_S, LAST_S), drawn.random() < 0.5
    out = tmp_path / "out.json"
    process = start("ros2", "run", "sandbot_model", "discover", table, "--json", out, "--workers", "2")
    while (used_s := cpu_s(process.pid)) is not None and used_s < moment_s:
        time.sleep(0.05)
    for _ in range(1 + again):
        os.killpg(process.pid, signal.SIGINT)
    code = process.wait(60)
    if code == 0:  # it was faster
        assert out.exists()
        return
    assert code == 130
    assert [line for line in process.lines if "Traceback" in line or "rror" in line] == []
    assert process.lines[-1].endswith("interrupted; what was finished is kept")
    assert list(tmp_path.iterdir()) == []
