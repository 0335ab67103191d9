"""Nothing cites what is not in the repository."""

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
FILES = [
    ROOT / name
    for name in subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout.split("\0")
    if name.endswith((".py", ".md", ".yaml", ".toml", ".sh", "Makefile"))
    and (ROOT / name).is_file() and not name.endswith("test_references.py")
]  # fmt: skip
DECISIONS = {int(path.name[:4]) for path in (ROOT / "docs" / "decisions").glob("[0-9]*.md")}
FOLDERS = ("docs", "benchmarks", "tests", "reference", "examples", "ros_ws/src")
SECTION = re.compile(r"\b(?P<page>[A-Za-z][\w-]*)(?:\.md)?\]?(?:\([\w./-]*\))?[,;]? §(?P<number>\d+)")
PAPERS = {"Li09", "Li", "CPython"}
PATH = re.compile(rf"(?<![\w/.{{}}*-])(?:{'|'.join(FOLDERS)})/[\w./-]*[\w/]")
DECISION = re.compile(r"\bdecision\s+(?P<number>\d+)\b")
LINK = re.compile(r"\]\((?!https?:|#|mailto:)(?P<path>[^)#\s]+)")
SESSION = re.compile(r"\b[Ss]ession \d+")
"""Of which a reader of the repository has none: a date, or a commit."""
MODULE = re.compile(r"\bsee ``(?P<name>[a-z_]+)``")

CODE = re.compile(r"`(?:\w+\.)*(\w+)\.((?!(?:py|md|xml|yaml|csv|jsonl?)`)[A-Za-z]\w*)`")
SOURCE = re.compile(r"(?<!\w)[a-z][a-z_/.]*\.py\b")
OTHERS = {"mcap.writer"}
"""Code that is not this repository's."""

OWN = {"and", "in", "of"}
"""Words before a section of the page itself."""


def missing(text: str, path: Path, names: set[str]) -> list[str]:
    """What a text, that of the file at ``path``, cites and the repository has not."""
    found = []
    for one in SECTION.finditer(text):
        page = path if one["page"] in OWN else ROOT / "docs" / f"{one['page'].lower()}.md"
        if one["page"] not in PAPERS and not (
            page.is_file() and re.search(rf"^## {one['number']}\.", page.read_text(encoding="utf-8"), flags=re.M)
        ):
            found.append(one[0])
    found += [one[0] for one in PATH.finditer(text) if not (ROOT / one[0].rstrip(".")).exists()]
    found += [one[0] for one in DECISION.finditer(text) if int(one["number"]) not in DECISIONS]
    found += [one[0] for one in SESSION.finditer(text)]
    if path.suffix == ".md":
        found += [one[0] for one in LINK.finditer(text) if not (path.parent / one["path"]).exists()]
    found += [one[0] for one in MODULE.finditer(text) if one["name"] not in names]
    return found


def gone(text: str, sources: dict[str, str]) -> list[str]:
    """The code a text names, ``module.name``, ``Class.name`` or a .py, that is not in the sources by path."""
    found = [one[0] for one in SOURCE.finditer(text) if not any(path.endswith(f"/{one[0]}") for path in sources)]
    names = (one for one in CODE.finditer(text) if one[0].strip("`") not in OTHERS)
    return found + [one[0] for one in names if not any(defines(*one.groups(), *source) for source in sources.items())]


def defines(of: str, name: str, path: str, source: str) -> bool:
    """Whether a source is the module ``name`` of the package ``of``, or holds it as the module or the class ``of``."""
    inside = path.endswith(f"/{of}.py") or f"\nclass {of}" in source
    return (
        f"/{of}/{name}.py" in path or f"/{of}/{name}/" in path or (inside and bool(re.search(rf"\b{name}\b", source)))
    )


@pytest.fixture(scope="module")
def sources():
    return {f"/{path.relative_to(ROOT)}": path.read_text(encoding="utf-8") for path in FILES if path.suffix == ".py"}


@pytest.mark.parametrize("path", sorted((ROOT / "docs" / "decisions").glob("*.md")), ids=lambda path: path.stem)
def test_the_code_a_decision_names_is_there(path, sources):
    assert gone(path.read_text(encoding="utf-8"), sources) == []


@pytest.mark.parametrize("text", ["`cells.ACCURACY`", "`sandbot_record.mcap_writer`", "`Cells.rabbit`", "terms.py"])
def test_code_that_is_gone_is_noticed(text, sources):
    assert gone(text, sources)


def diary(page: str) -> list[str]:
    """What a page tells of earlier versions, which is for decisions and the log."""
    return re.findall(r"\([Bb]efore: .*?\)|\bthe \d+(?:rd|th|st|nd)\b", page)


def test_the_page_of_faults_says_what_happens_now():
    assert diary((ROOT / "docs" / "faults.md").read_text(encoding="utf-8")) == []
    assert diary("ignored. (Before: ok), fixes of the 23rd") == ["(Before: ok)", "the 23rd"]


@pytest.fixture(scope="module")
def names():
    """Modules, and the functions and classes in any of them."""
    defined = re.compile(r"^\s*(?:def|class) (\w+)", flags=re.M)
    found = {path.stem for path in FILES}
    for path in FILES:
        if path.suffix == ".py":
            found |= set(defined.findall(path.read_text(encoding="utf-8")))
    return found


def test_everything_cited_is_here(names):
    found = {str(path.relative_to(ROOT)): missing(path.read_text(encoding="utf-8"), path, names) for path in FILES}
    assert {path: cited for path, cited in found.items() if cited} == {}


@pytest.mark.parametrize(
    "text",
    [
        "as design §7 has it", "physics §99", "docs/nowhere.md", "tests/unit/test_none.py", "see decision 999",
        "[page](nowhere.md)", "(see ``unheard_of_module``)", "[physics](physics.md) §99",
        "Until session 21",
    ],
)  # fmt: skip
def test_what_is_not_here_is_noticed(text, names):
    assert missing(text, ROOT / "docs" / "physics.md", names)


@pytest.mark.parametrize("text", ["physics §6", "docs/physics.md", "decision 1", "Li09 §3", "(see ``catalogue``)"])
def test_what_is_here_is_not(text, names):
    assert not missing(text, ROOT / "docs" / "physics.md", names)
