"""docs/python.md does what it shows, in a process without ROS, and the notebook beside it is made of it."""

import json
import math
import subprocess
import sys
from pathlib import Path

import pytest

import notebook

ROOT = Path(__file__).parents[2]
PARTS = notebook.cells(notebook.PAGE.read_text(encoding="utf-8"))
CODE = [part for part in PARTS if part.code]

RUN = """
import json, sys
import notebook
names = {}
shown = [notebook.run(code, names) for code in json.load(sys.stdin)]
json.dump({"shown": shown, "ros": "rclpy" in sys.modules}, sys.stdout)
"""


def same(word, other):
    """Whether two words are alike, numbers to one part in a thousand: the last digits are the machine's."""
    if word == other:
        return True
    try:
        return math.isclose(float(word), float(other), rel_tol=1e-3, abs_tol=1e-12)
    except ValueError:
        return False


@pytest.mark.slow
def test_the_page_shows_what_its_code_prints():
    ran = subprocess.run(
        [sys.executable, "-c", RUN],
        input=json.dumps([part.code for part in CODE]),
        capture_output=True,
        text=True,
        cwd=ROOT,
        env={"PATH": "", "PYTHONPATH": f"{ROOT / 'tools'}:{':'.join(sys.path)}"},
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    result = json.loads(ran.stdout)
    assert not result["ros"]
    for part, shown in zip(CODE, result["shown"], strict=True):
        expected, found = part.shown.split(), shown.split()
        assert len(found) == len(expected), f"{part.code}\nprints\n{shown}"
        assert all(map(same, expected, found)), f"{part.code}\nprints\n{shown}"


def test_the_notebook_is_made_of_the_page_and_was_run():
    made = json.loads(notebook.NOTEBOOK.read_text(encoding="utf-8"))
    cells = [cell for cell in made["cells"] if cell["cell_type"] == "code"]
    assert ["".join(cell["source"]) for cell in cells] == [part.code.rstrip() for part in CODE]
    assert all(cell["execution_count"] for cell in cells)
    assert any("image/png" in output.get("data", {}) for cell in cells for output in cell["outputs"])
    assert not any(output["output_type"] == "error" for cell in cells for output in cell["outputs"])


def test_a_page_that_shows_something_else_is_told_apart():
    (wrong,) = notebook.cells("```python\n1 + 1\n```\n\n```text\n3\n```\n")
    assert not same(wrong.shown.split()[0], notebook.run(wrong.code, {}).split()[0])
    assert same("0.49999", "0.5")
