"""docs/lookup says what the code does; the site has every page, and a quarter for each."""

import sys
from pathlib import Path

import pytest
import yaml

import reference
from sandbot_lab.effects import EFFECTS

ROOT = Path(__file__).parents[3]
DOCS = ROOT / "docs"
MAKERS = {
    "commands.md": reference.commands,
    "files.md": reference.files,
    "topics.md": reference.all_topics,
    "formulas.md": reference.formulas,
    "effects.md": reference.all_effects,
}


def words(text):
    """Without line breaks: where argparse puts them differs from Python to Python."""
    return " ".join(text.split())


@pytest.mark.parametrize("name", MAKERS)
def test_a_page_is_what_the_code_says(name):
    if name == "commands.md" and sys.version_info >= (3, 13):
        pytest.skip("argparse words its help otherwise")
    made = MAKERS[name]()
    page = (DOCS / "lookup" / name).read_text(encoding="utf-8")
    assert words(page) == words(made), "make reference writes it anew"
    assert page.startswith(reference.MADE)


def test_the_page_of_files_has_every_effect_of_a_world():
    page = (DOCS / "lookup" / "files.md").read_text(encoding="utf-8").partition("## effects in world.yaml")[2]
    assert "| `crater_refill` | `z0_m` or `z_0_m` | m | 0 to 0.015 | `0.01` |" in page
    assert [name for name in EFFECTS if f"`{name}`" not in page] == []


def test_each_effect_is_drawn_as_the_code_draws_it():
    made = dict(reference.drawings())
    folder = DOCS / "lookup" / "drawings"
    assert {f"drawings/{path.name}": path.read_text(encoding="utf-8") for path in folder.iterdir()} == made


def test_the_page_of_json_knows_what_the_design_promises():
    page = (DOCS / "lookup" / "json.md").read_text(encoding="utf-8")
    for key in ("schema", "noise_floor_m_s", "steps[].cv_rmse_m_s", "verdict.status", "verdict.because", "data.trials"):
        assert f"| `{key}` |" in page


def test_the_types_of_json_are_those_of_all_results_together():
    whole = {"a": 1.5, "b": {"c": "x"}, "l": [], "parameters": {"k": 1}, "d": None, "m": [{"e": 1}], "v": {}}
    untested = {"a": None, "b": None, "l": ["x"], "parameters": {"z": None}, "d": None, "m": [], "v": {}}
    assert reference.merged([whole]) == [
        *(("a", "number"), ("b.c", "text"), ("d", "null or number"), ("l", "list"), ("m[].e", "number")),
        *(("parameters.*", "number"), ("v", "object")),
    ]
    assert reference.merged([whole, untested]) == [
        *(("a", "null or number"), ("b", "null or object"), ("b.c", "text"), ("d", "null or number")),
        *(("l[]", "text"), ("m[].e", "number"), ("parameters.*", "null or number"), ("v", "object")),
    ]
    also = {"a": "null", "l[]": "text", "v.*": "text"}
    added = [("a", "null or number"), ("l[]", "text"), ("v.*", "text")]
    assert [row for row in reference.merged([whole], also) if row[0] in ("a", "l[]", "l", "v", "v.*")] == added


@pytest.mark.slow
def test_the_page_of_json_is_what_results_hold():
    page = (DOCS / "lookup" / "json.md").read_text(encoding="utf-8")
    assert page == reference.schemas(), "make reference writes it anew"
    of_discover = page.partition("## discover")[2]
    for key in ("stability", "noise_floor_m_s", "noise_floor.*", "steps[].lack_of_fit_p", "steps[].rmse.*"):
        assert f"| `{key}` | null or number |" in of_discover
    for key in ("partial", "residual"):
        assert f"| `{key}` | null or object |" in of_discover
    for key in ("phi", "omega_rad_s", "observable", "separates[]", "expected_gap_sd", "replicates", "depth_m"):
        assert f"| `next_trials[].{key}` |" in of_discover


def listed(nav):
    """The pages of a navigation, however deep."""
    for entry in nav:
        if isinstance(entry, str):
            yield entry
        else:
            for value in entry.values():
                yield from [value] if isinstance(value, str) else listed(value)


def test_every_page_has_its_place():
    nav = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]
    assert [next(iter(quarter)) for quarter in nav[1:]] == [
        "Tutorial",
        "How-to",
        "Reference",
        "Explanation",
        "Glossary",
    ]
    there = {str(path.relative_to(DOCS)) for path in DOCS.rglob("*.md") if path.parent.name != "decisions"}
    assert set(listed(nav)) == there


def test_every_wheel_of_the_site_is_pinned():
    lines = (ROOT / "requirements-docs.lock").read_text(encoding="utf-8").split()
    assert any(line.startswith("mkdocs-material==") for line in lines)
    assert all(line.count("==") == 1 for line in lines)
