"""Every command of README and docs, typed as it stands into one shell that nobody has prepared, and its exit code.

``python tools/pasted.py`` writes docs/lookup/pasted.md, with ``--new`` it runs only what is not in it yet;
tests/integration/test_pasted.py runs most of them again and holds the page to it. Campaigns are checked to their last
limit instead of run (``--dry-run``), and what reads a campaign finds six trials: here it is commands that are tried.
``make test-whole`` runs README and tutorial in full.
"""

import argparse
import os
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "lookup" / "pasted.md"
PAGES = [ROOT / "README.md", *sorted(path for path in (ROOT / "docs").rglob("*.md") if path != PAGE)]
BEGINS = ("ros2 ", "make ", "source ", "cut ", "printf ", "trackway ", ".venv/bin/trackway ")
MAKES = ("cut ", "printf ")
"""Commands that make a file for others, and so are always run."""
SERVES_S = 25
UNTIL_INTERRUPTED = ("ros2 launch", " explore ", "trackway simulate", "trackway live")
"""Commands, identified by a part, that run until Ctrl-C, which is sent after ``SERVES_S``."""
LONGER = ("trackway doctor", "trackway atlas")
"""What is run for the page, and by tests of its own."""
ELSEWHERE = {
    "make ": "the test of this page knows each target; what they do has tests of its own",
    "lab:=false": "wants a robot; test_readme checks its arguments, test_camera_drivers its nodes",
    "ros2 service call": "asks a robot that walks; test_ros2_fallback",
    "trackway calibrate": "wants a table of points; test_calibration has one",
    "__ns:=/robot1": "wants a robot in a namespace; test_two_robots has two",
    "trackway export": "wants bags; test_python_api has one",
    "unseal": "wants a sealed campaign; README in full (make test-whole), test_until_verdict",
}
"""Commands, identified by a part, that are not run here, with the reason."""


def commands(page: Path) -> list[str]:
    """The commands on a page, one per line."""
    lines = [line.strip() for line in page.read_text(encoding="utf-8").splitlines() if line.startswith("    ")]
    typed = [line.split("  #")[0].rstrip() for line in lines if line.startswith(BEGINS)]
    return [line for line in typed if not line.endswith("\\")]


ALL = list(dict.fromkeys(line for page in PAGES for line in commands(page)))


def one_of(parts: Sequence[str], line: str) -> bool:
    """Whether a command contains one of these parts."""
    return any(part in line for part in parts)


# Of commands that differ only in their folder, the first.
QUICK = list(
    {
        re.sub(r"runs/\w+", "runs/x", line): line
        for line in reversed(ALL)
        if not one_of([*UNTIL_INTERRUPTED, *LONGER, *ELSEWHERE], line)
    }.values()
)[::-1]


def prepared(folder: Path) -> Path:
    """A reader's folder: env.sh, the files that the pages describe, and campaigns of six trials each."""
    (folder / "env.sh").write_text(f"source {shlex.quote(str(ROOT))}/env.sh\n")
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    boost = readme[readme.index("    # boost.py") :].split("\n\n    trackway ")[0]
    (folder / "boost.py").write_text("\n".join(line[4:] for line in boost.splitlines()) + "\n")
    (folder / "table.csv").write_text("phi,omega_rad_s,speed_m_s\n0.633,16,0.203\n0.633,16,0.198\n")
    (folder / "robot.yaml").write_text("leg_radius_m: 0.036\n")
    (folder / "plan.yaml").write_text("name: mine\ngait: UNIFORM\nphi: [0.6]\nomega_rad_s: [8]\nreplicates: 1\n")
    (folder / "mine.csv").write_text((folder / "table.csv").read_text())
    (folder / "examples").symlink_to(ROOT / "examples")
    (folder / "explorer.yaml").write_text("schema: sandbot.selection/1\nmodel: simple\neffects: [leg_slip]\n")
    return folder


def with_campaigns(folder: Path) -> Path:
    """The same, with all campaigns that the pages name."""
    head = "trial_id,phi,phi_sd,omega_rad_s,gait,replicate,speed_m_s"
    rows = [
        f"{phi}w{omega},{phi},0.001,{omega},UNIFORM,1,{0.012 * omega}" for phi in (0.59, 0.62) for omega in (6, 9, 12)
    ]
    for name in {part.split("/")[1] for line in ALL for part in line.split() if re.match(r"runs/\w", part)}:
        (folder / "runs" / name).mkdir(parents=True)
        (folder / "runs" / name / "trials.csv").write_text("\n".join([head, *rows]) + "\n")
    return prepared(folder)


def as_typed(line: str) -> str:
    """A command with the reader's data for DATA; a campaign is checked to its last limit, not run."""
    line = re.sub(r"\bDATA\b", "runs/demo", line)
    if " campaign " in line and "--dry-run" not in line:
        # Into a new folder, as existing ones contain another campaign, which would be refused.
        line = re.sub(r"--out runs/\w+", "--out runs/new", line)
        line = f"{line.replace(' --plan first.json', '')} --dry-run"
    if one_of(UNTIL_INTERRUPTED, line):
        line = f"timeout --preserve-status --signal=INT --kill-after=20 {SERVES_S} {line}"
    return line


def fresh_shell(lines: Sequence[str], folder: Path, timeout_s: float) -> dict[str, int]:
    """Exit code of each line, typed one after the other into one shell whose environment knows the ROS domain only.

    What they said is in out.txt and err.txt of the folder.
    """
    script = "\n".join(f"{{ {line}; }} </dev/null >>out.txt 2>>err.txt; echo $?" for line in lines)
    domain = f"ROS_DOMAIN_ID={os.environ.get('ROS_DOMAIN_ID', '0')}"
    done = subprocess.run(
        ["env", "-i", "HOME=/tmp", "PATH=/usr/bin:/bin", domain, "bash", "--norc", "-c", script],
        cwd=folder, text=True, capture_output=True, timeout=timeout_s, check=False,
    )  # fmt: skip
    assert done.stderr == "", done.stderr
    return dict(zip(lines, map(int, done.stdout.split()), strict=True))


def tried(lines: Sequence[str]) -> dict[str, int]:
    """Exit codes of those of the commands that are run here."""
    run = [line for line in lines if not one_of(list(ELSEWHERE), line)]
    typed = ["source env.sh", *(as_typed(line) for line in run if line != "source env.sh")]
    with tempfile.TemporaryDirectory() as folder:
        codes = fresh_shell(typed, with_campaigns(Path(folder)), 3600)
    return {line: codes[as_typed(line)] for line in run}


def page(codes: dict[str, int]) -> str:
    """The table."""
    escaped = {line: line.replace("|", "\\|") for line in ALL}
    rows = [f"| `{escaped[line]}` | {where(line)} | {how(line)} | {codes.get(line, '–')} |" for line in ALL]
    wrong = sum(not right(line, code) for line, code in codes.items())
    return "\n".join(
        [
            "<!-- made by `make pasted` (tools/pasted.py) -->",
            "# Commands of these pages, run",
            "",
            "Every command that README and these pages tell you to type, pasted into a shell that nobody has prepared: "
            f"{len(codes)} of {len(ALL)} run here, {wrong} of them ended otherwise than they should. What serves until "
            f"Ctrl-C gets it after {SERVES_S} s: it ends with 130, `ros2 launch` and nodes with 0.",
            "",
            "| command | stands in | run | exit code |",
            "| --- | --- | --- | --- |",
            *rows,
            "",
        ]
    )


def right(line: str, code: int) -> bool:
    """Whether a command ended as it should."""
    return code in ((0, 130) if one_of(UNTIL_INTERRUPTED, line) else (0,))


def where(line: str) -> str:
    """The pages that contain a command."""
    return ", ".join(path.name for path in PAGES if line in commands(path))


def how(line: str) -> str:
    """How a command was run here, or why it was not."""
    if why := [why for part, why in ELSEWHERE.items() if part in line]:
        return f"not here: {why[0]}"
    typed = as_typed(line)
    if one_of(UNTIL_INTERRUPTED, line):
        return f"Ctrl-C after {SERVES_S} s"
    if typed.endswith("--dry-run") and not line.endswith("--dry-run"):
        return "with `--dry-run`"
    return "on six trials" if "runs/" in typed else "as it stands"


def rows_of(text: str) -> Iterator[tuple[str, str]]:
    """Command and exit code of each row of the page."""
    for line in text.splitlines():
        if line.startswith("| `"):
            cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
            yield cells[0].strip("`").replace("\\|", "|"), cells[3]


def main() -> int:
    """Write the page; returns 1 if a command did not end as it should."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--new", action="store_true", help="run only the commands that are not on the page yet")
    known = {}
    if parser.parse_args().new:
        rows = rows_of(PAGE.read_text(encoding="utf-8"))
        known = {line: int(code) for line, code in rows if code.isdigit() and not line.startswith(MAKES)}
    codes = {line: known[line] for line in ALL if line in known} | tried([line for line in ALL if line not in known])
    PAGE.write_text(page(codes), encoding="utf-8")
    wrong = [f"{code}: {line}" for line, code in codes.items() if not right(line, code)]
    print(PAGE.relative_to(ROOT), *wrong, sep="\n")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
