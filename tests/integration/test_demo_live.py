"""The live part of ``make demo``: real nodes, a plot of /speed, and a second tracker that gives the same number."""

import sys
from pathlib import Path

import pytest

from sandbot_record.trials.from_bags import row_from_bag

pytestmark = [pytest.mark.ros, pytest.mark.whole, pytest.mark.timeout(600)]

SCRIPT = Path(__file__).parents[2] / "tools" / "demo_live.py"


def test_two_trials_are_walked_shown_and_replayed(tmp_path, start):
    demo = start(sys.executable, SCRIPT, tmp_path / "demo-live")
    assert demo.wait(500) == 0, "\n".join(demo.lines)
    demo.until(lambda line: line.startswith("Each bag is played"), 10)
    assert sum(line.endswith("replayed: the same") for line in demo.lines) == 2
    assert sum("cm/s  |" in line for line in demo.lines) > 10
    loose, close = (row_from_bag(bag) for bag in sorted((tmp_path / "demo-live" / "trials").glob("phi*")))
    assert close.speed_m_s > 5 * loose.speed_m_s


def test_where_no_node_starts_it_ends_with_a_line(tmp_path, start, ros_env):
    """Control: a ros2 that does nothing."""
    ros2 = tmp_path / "bin" / "ros2"
    ros2.parent.mkdir()
    ros2.write_text("#!/bin/sh\nexit 1\n")
    ros2.chmod(0o755)
    ros_env["PATH"] = f"{ros2.parent}:{ros_env['PATH']}"
    demo = start(sys.executable, SCRIPT, tmp_path / "demo-live")
    assert demo.wait(100) == 1
    demo.until(lambda line: "the live part did not come to its end: a node has ended" in line, 10)
