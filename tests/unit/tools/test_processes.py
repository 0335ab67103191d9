import re
import sys
import threading

import pytest

from ros2cli_fallback.launching import describe, processes
from ros2cli_fallback.processes import Group, Process
from sandbot_bringup import node_table

FOREVER = "import time; print('up', flush=True)\nwhile True: time.sleep(0.05)"
STUBBORN = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN); " + FOREVER


def python(code):
    return [sys.executable, "-S", "-c", code]


class Said:
    """Collects what the group says and does something when a line comes."""

    def __init__(self):
        self.lines = []
        self.when = {}

    def __call__(self, line):
        self.lines.append(line)
        if line in self.when:
            self.when.pop(line)()


def test_output_is_prefixed_and_an_interrupt_stops_all():
    said = Said()
    group = Group([Process("a-1", python(FOREVER)), Process("b-2", python(FOREVER))], said)
    said.when = {"[a-1] up": lambda: None, "[b-2] up": group.interrupt}
    assert group.run() == 0
    text = "\n".join(said.lines)
    for label in ("a-1", "b-2"):
        assert re.search(rf"\[INFO\] \[{label}\]: process started with pid \[\d+\]", text)
        assert re.search(rf"\[INFO\] \[{label}\]: process has finished cleanly \[pid \d+\]", text)


@pytest.mark.parametrize("code", [0, 3])
def test_when_a_required_one_ends_all_end(code):
    said = Said()
    ends = Process("a-1", python(f"raise SystemExit({code})"))
    stays = Process("b-2", python(FOREVER))
    assert Group([ends, stays], said).run() == (1 if code else 0)
    assert stays.running.poll() is not None
    assert "[INFO] [launch]: process[a-1] was required: shutting down launched system" in said.lines
    died = [line for line in said.lines if "process has died" in line]
    assert len(died) == (1 if code else 0)
    assert not died or "exit code 3" in died[0]


def test_when_one_that_is_not_required_ends_the_others_go_on():
    said = Said()
    ends = Process("a-1", python("raise SystemExit(3)"), required=False)
    stays = Process("b-2", python(FOREVER))
    group = Group([ends, stays], said)
    watcher = threading.Thread(target=group.run)
    watcher.start()
    try:
        while not any("process has died" in line for line in said.lines):
            watcher.join(0.02)
            assert watcher.is_alive()
        assert stays.running.poll() is None
    finally:
        group.interrupt()
        watcher.join(10)
    assert stays.running.poll() is not None


def test_a_stubborn_one_is_met_with_stronger_signals():
    said = Said()
    process = Process("a-1", python(STUBBORN))
    group = Group([process], said, grace_s=0.2)
    said.when = {"[a-1] up": group.interrupt}
    group.run()
    assert process.running.returncode == -15
    assert any("escalating to 'SIGTERM'" in line for line in said.lines)


def test_a_command_that_can_not_start_stops_those_before_it(tmp_path):
    first = Process("a-1", python(FOREVER))
    with pytest.raises(FileNotFoundError):
        Group([first, Process("b-2", [str(tmp_path / "nothing")])], Said()).run()
    assert first.running.poll() is not None


def test_the_table_becomes_processes_with_names_and_parameters():
    table = node_table.read_table(node_table.table_path())
    made = processes(node_table.selected(table, {"bed.pulse_off_s": "0.8"}))
    (bed,) = [one for one in made if one.label.startswith("bed-")]
    assert bed.command[0].endswith("/lib/sandbot_bed/bed")
    assert bed.command[1:4] == ["--ros-args", "-r", "__node:=bed"]
    assert "pulse_off_s:=0.8" in bed.command
    assert "'lab':" in describe(table)
