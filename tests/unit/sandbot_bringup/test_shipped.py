"""A plan or a world that comes with the package is found by its name, from any folder."""

from pathlib import Path

import pytest

from sandbot_bringup.config import config_folder, shipped
from sandbot_bringup.tools import campaign
from sandbot_common.errors import InputError


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_shipped_plan_is_found_by_its_name(capsys):
    assert campaign.main(["demo.yaml", "--dry-run"]) == 0
    assert capsys.readouterr().out.startswith("campaign demo: 105 trials")


def test_a_file_of_ones_own_comes_first(elsewhere):
    assert shipped(Path("demo.yaml")) == config_folder() / "demo.yaml"
    (elsewhere / "demo.yaml").write_text("name: mine\n")
    assert shipped(Path("demo.yaml")) == Path("demo.yaml")


def test_its_trials_lie_where_it_was_called_not_in_the_package(elsewhere, capsys):
    options = campaign._parser().parse_args(["pilot.yaml"])
    _, folder = campaign._plan_and_folder(options)
    assert (elsewhere / folder.path).parent == elsewhere


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        (["dmo.yaml"], "dmo.yaml: no such file, did you mean 'demo.yaml'?"),
        (["xyz"], "xyz: no such file; known: demo.yaml, "),
        (["plans/demo.yaml"], "plans/demo.yaml: no such file"),
        (["demo.yaml", "--world", "pilot-world.yaml", "--batch"], "did you mean 'pilot_world.yaml'?"),
    ],
)
def test_a_misspelt_one_is_answered_with_the_one_that_may_be_meant(typed, said, capsys):
    assert campaign.main(typed) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


def test_only_a_bare_name_is_looked_for(elsewhere):
    assert shipped(Path("plans/demo.yaml")) == Path("plans/demo.yaml")
    with pytest.raises(InputError):
        shipped(Path("nowhere.yaml"))
