"""Every command of README and docs is typed as it stands into one fresh shell, whose environment is empty."""

import re
import shlex
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BEGINS = ("ros2 ", "make ", "source ", "cut ", "printf ", "trackway ", ".venv/bin/trackway ")
LEFT_OUT = {
    "ros2 launch": "runs until Ctrl-C; test_readme checks its arguments, test_live_trial its nodes",
    "ros2 service call": "asks a robot that walks",
    "make ": "test_readme checks the targets",
    "sandbot_model explore": "serves until Ctrl-C; tests/browser opens it",
    "trackway explore": "the same",
    "trackway doctor": "starts nodes; test_doctor does",
    "sandbot_hardware simulate": "runs until Ctrl-C; test_serial_devices starts it",
    "sandbot_tracking calibrate": "wants a table of points; test_calibrate has one",
    "__ns:=/robot1": "wants a robot in a namespace; test_two_robots has two",
    "sandbot_model atlas": "draws for ten seconds; test_atlas does, and the run of the whole",
    "unseal": "wants a sealed campaign; in the run of the whole",
}
"""Commands that are not run here, by a part of them, and why."""


def commands(page):
    """What a page tells its reader to type, a line each."""
    lines = [line.strip() for line in page.read_text(encoding="utf-8").splitlines() if line.startswith("    ")]
    typed = [line.split("  #")[0].rstrip() for line in lines if line.startswith(BEGINS)]
    return [line for line in typed if not line.endswith("\\")]


ALL = list(dict.fromkeys(line for page in PAGES for line in commands(page)))
# Of commands that differ in their folder only, the first.
QUICK = list(
    {
        re.sub(r"runs/\w+", "runs/x", line): line
        for line in reversed(ALL)
        if not any(part in line for part in LEFT_OUT)
    }.values()
)[::-1]
TUTORIAL = [line for line in commands(ROOT / "docs" / "tutorial.md") if "explore" not in line]
README = [line for line in commands(ROOT / "README.md") if not re.match(r"make |ros2 launch|.*runs/monday", line)]


def fresh_shell(lines, folder, timeout_s):
    """Exit code of each line, typed one after the other into one shell that nobody has prepared."""
    script = "\n".join(f"{{ {line}; }} </dev/null >>out.txt 2>>err.txt; echo $?" for line in lines)
    done = subprocess.run(
        ["env", "-i", "HOME=/tmp", "PATH=/usr/bin:/bin", "bash", "--norc", "-c", script],
        cwd=folder, text=True, capture_output=True, timeout=timeout_s, check=False,
    )  # fmt: skip
    assert done.stderr == ""
    return dict(zip(lines, map(int, done.stdout.split()), strict=True))


@pytest.fixture
def desk(tmp_path):
    """A reader's folder: the workspace's env.sh, and the files that the pages describe, with little in them."""
    (tmp_path / "env.sh").write_text(f"source {shlex.quote(str(ROOT))}/env.sh\n")
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    boost = readme[readme.index("    # boost.py") :].split("\n\n    ros2 ")[0]
    (tmp_path / "boost.py").write_text("\n".join(line[4:] for line in boost.splitlines()) + "\n")
    (tmp_path / "table.csv").write_text("phi,omega_rad_s,speed_m_s\n0.633,16,0.203\n0.633,16,0.198\n")
    return tmp_path


def prepared(folder):
    """Campaigns as a reader would have them by then, with six trials each: here it is commands that are tested."""
    for name in {part.split("/")[1] for line in ALL for part in line.split() if re.match(r"runs/\w", part)}:
        (folder / "runs" / name).mkdir(parents=True)
        rows = [
            f"{phi}w{omega},{phi},0.001,{omega},UNIFORM,1,{0.012 * omega}"
            for phi in (0.59, 0.62)
            for omega in (6, 9, 12)
        ]
        text = "\n".join(["trial_id,phi,phi_sd,omega_rad_s,gait,replicate,speed_m_s", *rows]) + "\n"
        (folder / "runs" / name / "trials.csv").write_text(text)
    (folder / "robot.yaml").write_text("leg_radius_m: 0.036\n")
    (folder / "plan.yaml").write_text("name: mine\ngait: UNIFORM\nphi: [0.6]\nomega_rad_s: [8]\nreplicates: 1\n")
    return folder


def as_typed(line):
    """A line with the reader's data for DATA; a campaign is checked to its last limit, not run."""
    line = re.sub(r"\bDATA\b", "runs/demo", line)
    if " campaign " in line and "--dry-run" not in line:
        line = f"{line.replace(' --plan first.json', '')} --dry-run"
    return line


def test_the_pages_are_read():
    assert len(QUICK) > 12
    assert len(README) > 20
    assert len(TUTORIAL) > 8
    assert any("campaign demo.yaml" in line for line in QUICK)
    assert all(any(part in line for line in ALL) for part in LEFT_OUT)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_every_command_is_understood_in_a_fresh_shell(desk):
    prepared(desk)
    (desk / "explorer.yaml").write_text("schema: sandbot.selection/1\nmodel: simple\neffects: [leg_slip]\n")
    codes = fresh_shell(["source env.sh", *map(as_typed, QUICK)], desk, 500)
    assert {line: code for line, code in codes.items() if code} == {}, (desk / "err.txt").read_text()


def test_a_command_that_is_wrong_would_be_seen(desk):
    codes = fresh_shell(["source env.sh", "ros2 run sandbot_bringup campaign dmo.yaml --dry-run"], desk, 100)
    assert list(codes.values()) == [0, 2]


@pytest.mark.whole
@pytest.mark.timeout(1800)
def test_the_tutorial_from_its_first_line_to_its_last(desk):
    codes = fresh_shell(TUTORIAL, desk, 1700)
    assert {line: code for line, code in codes.items() if code} == {}, (desk / "err.txt").read_text()
    told = (desk / "out.txt").read_text()
    for promised in (
        "simple model fails",
        "verdict: identified: stance_overlap",
        "truth:   agrees",
        "verdict: untested",
    ):
        assert promised in told


@pytest.mark.whole
@pytest.mark.timeout(3600)
def test_readme_from_its_first_line_to_its_last(desk):
    codes = fresh_shell(["source env.sh", *README], desk, 3500)
    assert {line: code for line, code in codes.items() if code} == {}, (desk / "err.txt").read_text()
