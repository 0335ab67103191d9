"""What was saved in the page comes out of the command line; what makes no sense there is refused in one line."""

import json
import shlex
import socket
from pathlib import Path

import bags
import pytest
import yaml
from inline import Inline
from made_up import BOOST

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.selection import Selection, from_query, to_yaml
from sandbot_model.explore.app import Explorer
from sandbot_model.explore.session import Session
from sandbot_model.tools import compare as compare_tool
from sandbot_model.tools import explore as explore_tool
from sandbot_record.trials.csv_table import write_csv
from sandbot_record.trials.read import read


@pytest.fixture(autouse=True)
def _in_a_folder_with_trials(trials, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_csv(trials, tmp_path / "trials.csv")


@pytest.mark.slow
@pytest.mark.parametrize(
    "selection",
    [
        Selection("full", ("leg_slip",)),
        Selection(effects=("leg_slip", "boost"), formulas=(BOOST,)).held("delta_t_s", 0.3),
    ],
    ids=["effects", "formula and a held value"],
)
def test_compare_gives_the_very_numbers_that_were_saved(session, trials, capsys, selection):
    """By the file, and by the command line that stands in it."""
    again = cells_of(read(Path("trials.csv")))
    saved = Explorer(Session(again, Inline()), trials, [Path("trials.csv")], "test").saved(selection)
    Path("explorer.yaml").write_text(saved, encoding="utf-8")
    content = yaml.safe_load(saved)
    commands = (
        ["trials.csv", "--selection", "explorer.yaml"],
        shlex.split(content["command"])[1:],
    )
    for arguments in commands:
        assert compare_tool.main([*arguments, "--json", "out.json"]) == 0
        last = json.loads(Path("out.json").read_text(encoding="utf-8"))["steps"][-1]
        for name in ("rmse_m_s", "cv_rmse_m_s"):
            expected = content["result"][name]
            assert last[name] == (expected if expected is None else pytest.approx(expected, rel=1e-9))
    assert ("held by hand" in capsys.readouterr().out) == bool(selection.by_hand)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--hold", "delta_t_s"], "--hold 'delta_t_s': a finite number is needed"),
        (["--hold", "mass=1"], "the model has no parameter 'mass'; known: delta_t_s"),
        (["--hold", "delta_t_s=0.3", "--bootstrap", "2"], "has no standard error"),
        (["--workers", "4"], "--workers: only the draws of --bootstrap N are shared out; give that too"),
        (["--dask", "tcp://host:1"], "--dask: only the draws of --bootstrap N"),
        (["--hold", "delta_t_s=-1"], "--hold delta_t_s=-1: at least 0.02 is needed"),
        (["--effects", "leg_slip", "--hold", "leg_slip.sigma=2"], "sigma=2: at least 0 and at most 0.9 is needed"),
        (["--selection", "explorer.yaml", "--model", "full"], "leave out the options that do so, too"),
        (["--selection", "held.yaml", "--bootstrap", "2"], "held.yaml: by_hand: a parameter held by hand has no"),
        (["--selection", "trials.csv"], "trials.csv"),
    ],
)
def test_compare_refuses_a_state_that_makes_no_sense_in_one_line(arguments, said, trials, capsys):
    for name, chosen in (("explorer", Selection()), ("held", Selection().held("delta_t_s", 0.3))):
        Path(f"{name}.yaml").write_text(to_yaml(chosen, ["trials.csv"], {}), encoding="utf-8")
    assert compare_tool.main(["trials.csv", *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--port", "99999"], "--port 99999 is not between 0 and 65535"),
        (["--workers", "0"], "--workers: '0' is not a number of processes: 1 or more are needed"),
        (["--bed-drift", "2"], "--bed-drift 2: a fraction above 0 and up to 0.3 is needed"),
        (["--selection", "absent.yaml"], "absent.yaml: no such file"),
        (["--beside", "absent.csv"], "absent.csv: no such file"),
    ],
)
def test_the_command_line_refuses_in_one_line(arguments, said, trials, capsys):
    assert explore_tool.main(["trials.csv", *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


def test_data_beside_of_another_robot_are_refused_in_one_line(trials, tmp_path, capsys):
    plan = bags.PLAN | {"robot": {"leg_radius_m": 0.05}}
    other = bags.trial_bag(tmp_path / "other", plan=plan)
    assert explore_tool.main(["trials.csv", "--beside", str(other), "--workers", "1"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "trials of another robot than DATA (leg_radius_m 0.05 and 0.0355)" in line


def test_a_port_in_use_is_said_in_one_line_and_before_anything_is_read(trials, capsys, monkeypatch):
    monkeypatch.setattr(explore_tool._Servers, "read", lambda _: pytest.fail("read"))
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        assert explore_tool.main(["trials.csv", "--port", port, "--workers", "1"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"--port {port}" in line


@pytest.mark.parametrize("order", [[], ["--effects", "boost,leg_slip"]], ids=["alone", "in an order"])
def test_a_formula_typed_for_compare_is_added(order, trials, capsys):
    typed = ["--effect", BOOST, "--json", "out.json"]
    assert compare_tool.main(["trials.csv", *order, *typed]) == 0
    steps = json.loads(Path("out.json").read_text(encoding="utf-8"))["steps"]
    assert [step["effects"] for step in steps][1] == ["boost"]
    assert len(steps) == 1 + len((order[1:] and ["boost", "leg_slip"]) or ["boost"])
    assert "+ boost" in capsys.readouterr().out


def test_a_formula_that_is_off_is_not_in_the_saved_command_line():
    off = Selection(formulas=(BOOST,))
    on = Selection(effects=("boost",), formulas=(BOOST,))
    assert "--effect" not in yaml.safe_load(to_yaml(off, ["t.csv"], {}))["command"]
    assert "--effect" in shlex.split(yaml.safe_load(to_yaml(on, ["t.csv"], {}))["command"])


def test_the_page_opens_with_the_formula_that_was_typed(trials, monkeypatch):
    opened = []
    monkeypatch.setattr(explore_tool, "_serve", lambda desk, *_: opened.append(desk.query))
    assert explore_tool.main(["trials.csv", "--effect", BOOST, "--workers", "1"]) == 0
    assert from_query(opened[0]) == Selection(effects=("boost",), formulas=(BOOST,))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--effects", "leg slip"], "effect 'leg slip' is not in the catalogue, did you mean 'leg_slip'?"),
        (["--effects", "legslip"], "did you mean 'leg_slip'?"),
        (["--hold", "delta_t=0.3"], "the model has no parameter 'delta_t', did you mean 'delta_t_s'?"),
        (["--efects", "leg_slip"], "no option --efects, did you mean '--effects'?"),
    ],
)
def test_a_misspelt_name_is_answered_with_the_one_that_may_be_meant(arguments, said, trials, capsys):
    assert compare_tool.main(["trials.csv", *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
