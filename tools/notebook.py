"""``make notebook``: docs/python.md run as a notebook, its outputs written back, and examples/python.ipynb from it.

A fenced ``python`` block is a cell; a fenced ``text`` block right below it is what that cell prints. There is one
source: the page is the notebook, and a test runs it.
"""

import ast
import contextlib
import io
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "python.md"
NOTEBOOK = ROOT / "examples" / "python.ipynb"
_FENCED = re.compile(r"^```python\n(?P<code>.*?)^```\n(?:\n?```text\n(?P<shown>.*?)^```\n)?", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Cell:
    """A piece of the page: prose, or code with its output."""

    prose: str = ""
    code: str = ""
    shown: str = ""


def cells(page: str) -> list[Cell]:
    """The page split into prose and code, in order."""
    found, end = [], 0
    for match in _FENCED.finditer(page):
        found += [Cell(prose=page[end : match.start()].strip()), Cell(code=match["code"], shown=match["shown"] or "")]
        end = match.end()
    found.append(Cell(prose=page[end:].strip()))
    return [cell for cell in found if cell.prose or cell.code]


def run(code: str, names: dict[str, Any]) -> str:
    """A cell's printed output, and its last expression as a notebook would show it in text."""
    body = ast.parse(code).body
    last = body.pop() if body and isinstance(body[-1], ast.Expr) else None
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(ast.Module(body, []), "<page>", "exec"), names)
        value = eval(compile(ast.Expression(last.value), "<page>", "eval"), names) if last is not None else None
    text = printed.getvalue() + ("" if value is None or hasattr(value, "_repr_png_") else f"{value!r}\n")
    return "\n".join(line.rstrip() for line in text.splitlines()) + ("\n" if text else "")


def page_of(parts: list[Cell]) -> str:
    """The page with the given cells."""
    pieces = [
        part.prose or f"```python\n{part.code}```" + (f"\n\n```text\n{part.shown}```" if part.shown else "")
        for part in parts
    ]
    return "\n\n".join(pieces) + "\n"


def notebook_of(parts: list[Cell]) -> Any:
    """The page as a notebook, executed in the repository's folder."""
    import nbformat
    from nbclient import NotebookClient

    made = nbformat.v4.new_notebook(
        cells=[
            nbformat.v4.new_code_cell(part.code.rstrip()) if part.code else nbformat.v4.new_markdown_cell(part.prose)
            for part in parts
        ]
    )
    NotebookClient(made, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(ROOT)}}).execute()
    for number, cell in enumerate(made.cells):
        cell["id"] = f"cell-{number}"
        cell.get("metadata", {}).clear()
    return made


def main() -> int:
    """Write the page's outputs and the notebook."""
    import nbformat

    names: dict[str, Any] = {}
    parts = [
        Cell(code=part.code, shown=run(part.code, names)) if part.code else part
        for part in cells(PAGE.read_text(encoding="utf-8"))
    ]
    PAGE.write_text(page_of(parts), encoding="utf-8")
    NOTEBOOK.parent.mkdir(exist_ok=True)
    nbformat.write(notebook_of(parts), NOTEBOOK)
    return 0


if __name__ == "__main__":
    sys.exit(main())
