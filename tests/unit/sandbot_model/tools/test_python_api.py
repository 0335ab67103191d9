"""``import sandbot_model as sm``: any data in, results that print, draw and pickle, errors that name the argument."""

import json
import pickle
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import sandbot_model as sm
from sandbot_common.accuracy import USUAL
from sandbot_common.errors import InputError
from sandbot_common.robot import SANDBOT
from sandbot_model.tools import discover as command
from sandbot_record.trials.csv_table import write_csv

OVERLAP = {"stance_overlap": {"eta": 0.15}}
FEW = {"levels": 3, "omega": (6, 12, 18, 24, 30)}


@pytest.fixture(scope="module")
def trials(drawn):
    return drawn(("stance_overlap",), values=OVERLAP, **FEW)


@pytest.fixture(scope="module")
def found(trials):
    return sm.discover(trials, max_effects=1)


def test_a_hidden_effect_is_found_and_said_first(found):
    assert found.verdict.status == "identified"
    assert found.fit.effects == ("stance_overlap",)
    assert "\nidentified: stance_overlap" in repr(found)


def test_nothing_is_found_where_nothing_is_hidden(drawn):
    null = sm.discover(drawn((), **FEW), max_effects=1)
    assert null.verdict.status == "adequate"
    assert null.fit.effects == ()


def test_what_is_printed_is_short_and_in_the_readers_units(found):
    text = repr(found)
    assert len(text) < 3000
    assert len(text.splitlines()) <= 30
    assert max(map(len, text.splitlines())) <= 100
    assert "cm/s" in text
    assert "<table" in found._repr_html_()
    assert "<script" not in found._repr_html_()


def test_what_is_odd_about_the_data_is_said_first(trials, found):
    assert found.notes == (
        "robot: not given, SandBot is assumed",
        "cameras: accuracy not given, a zero of the lift within 0.6 mm and a scale of speed within 1 % (s.d.) assumed",
        "bed: scatter not given, 0.7 % of k from batch to batch (s.d.) assumed",
        "order of trials: not given, no drift of k is assumed",
    )
    assert found.to_dict()["data"]["notes"] == list(found.notes)
    zeros = replace(trials, first_step_m=np.zeros_like(trials.first_step_m))
    odd = sm.compare(zeros)
    assert repr(odd).startswith("note: ")
    assert odd._repr_html_().startswith("<p>Note: ")
    assert odd.to_dict()["data"]["notes"] == list(odd.notes)
    porosity = replace(trials, phi=1 - trials.phi)
    with pytest.raises(InputError, match="is it the porosity"):
        sm.discover(porosity)


def test_what_the_data_leave_open_is_a_note(trials):
    walked = replace(trials, robot=SANDBOT, accuracy=USUAL)
    assert sm.compare(walked).notes == sm.compare(replace(trials, accuracy=USUAL), robot=SANDBOT).notes == ()
    trot = np.full_like(trials.gait, "trot", dtype=object)
    assert sm.compare(replace(walked, gait=trot)).notes == ("gait 'trot': the clock signal of SGCS is assumed",)


def test_a_reading_that_is_not_used_is_said_with_what_is_odd(trials, tmp_path):
    path = tmp_path / "readings.csv"
    path.write_text(f"phi,k_n_per_m\n{trials.phi[0]},190\n0.7,260\n")
    odd = sm.compare(trials, penetrometer=path)
    assert odd.to_dict()["data"]["notes"][2:] == ["penetrometer: 1 of 2 readings is at no level of the trials: φ 0.700"]


def test_a_result_pickles_small_and_comes_back(found):
    packed = pickle.dumps(found)
    assert len(packed) < 1_000_000
    back = pickle.loads(packed)
    assert back.to_dict() == found.to_dict()
    assert repr(back) == repr(found)


@pytest.mark.slow
def test_the_python_api_says_what_the_command_says(trials, found, tmp_path, capsys):
    write_csv(trials, tmp_path / "table.csv")
    out = tmp_path / "found.json"
    few = ["--max-effects", "1", "--workers", "1"]
    assert command.main([str(tmp_path / "table.csv"), *few, "--json", str(out)]) == 0
    written, returned = json.loads(out.read_text()), json.loads(json.dumps(found.to_dict()))
    assert written["verdict"] == returned["verdict"]
    assert written["data"]["notes"] == returned["data"]["notes"]


def test_a_frame_a_path_and_trials_are_the_same_data(trials, tmp_path):
    write_csv(trials, tmp_path / "table.csv")
    tables = [trials, str(tmp_path / "table.csv"), [tmp_path / "table.csv"], trials.to_frame()]
    errors = [sm.compare(table).fit.rmse_m_s for table in tables]
    np.testing.assert_allclose(errors, errors[0], rtol=0, atol=1e-15)


def test_models_are_compared_in_one_frame(trials):
    """One row for each step, with the numbers of the JSON; control: without effects it is the base model's alone."""
    found = sm.compare(trials, ["stance_overlap"])
    frame = found.to_frame()
    assert list(frame.index) == ["simple model", "simple model + stance_overlap"] == [step.name for step in found.steps]
    for (_, row), step in zip(frame.iterrows(), found.to_dict()["steps"], strict=True):
        assert row["cv_rmse_m_s"] == step["cv_rmse_m_s"]
        assert row["lack_of_fit_p"] == step["lack_of_fit_p"]
    assert frame["bic"].idxmin() == found.fit.name
    assert frame["cells_missed"].iloc[0] > frame["cells_missed"].iloc[1]
    assert list(sm.compare(trials).to_frame().index) == ["simple model"]


def test_a_frame_without_speed_is_refused_by_row_and_column(trials):
    frame = trials.to_frame()
    with pytest.raises(sm.InputError, match=r"^data: row 1: column speed_m_s is missing"):
        sm.compare(frame.drop(columns=["speed_m_s"]))
    frame["phi"] = frame["phi"].astype(object)
    frame.loc[3, "phi"] = "loose"
    with pytest.raises(sm.InputError, match=r"^data: row 5, column phi: 'loose' is not a number"):
        sm.compare(frame)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"data": "nowhere.csv"}, "data: nowhere.csv: no such file or folder"),
        ({"data": 7}, "data: int; a path, several paths, a DataFrame or Trials is needed"),
        ({"model": "simpel"}, "model: 'simpel' is not one of simple, full"),
        ({"max_effects": -1}, "max_effects: -1; 0 or more are needed"),
        ({"formulas": "a: b: c"}, "formulas: 'a: b: c' is one string"),
        ({"formulas": ["a: b: c"]}, "formulas: 'a: b: c': no stage 'b'"),
        ({"effects_from": "nowhere.py"}, "nowhere.py: no such file"),
        ({"workers": 0}, "workers: 0; at least one process is needed"),
        ({"max_effects": 1.5}, "max_effects: 1.5; a whole number is needed"),
        ({"max_effects": "2"}, "max_effects: '2'; a whole number is needed"),
        ({"workers": "2"}, "workers: '2'; a whole number is needed"),
        ({"criteria": None}, "criteria: None; Criteria is needed"),
        ({"progress": None}, "progress: None; a function is needed"),
    ],
)
def test_an_argument_that_cannot_be_used_is_named(trials, arguments, message):
    with pytest.raises(sm.InputError, match=re.escape(message)) as error:
        sm.discover(**({"data": trials} | arguments))
    assert "\n" not in str(error.value)


def test_effects_given_as_one_text_are_refused(trials):
    with pytest.raises(sm.InputError, match=re.escape("effects: 'leg_slip' is one string")):
        sm.compare(trials, "leg_slip")
    with pytest.raises(sm.InputError, match=r"leg_slipp.*did you mean|leg_slipp.*is not in the catalogue"):
        sm.compare(trials, ["leg_slipp"])


@pytest.mark.parametrize(
    ("effects", "ladder"),
    [([], ("brake",)), (["leg_slip"], ("leg_slip", "brake")), (["brake", "leg_slip"], ("brake", "leg_slip"))],
)
def test_a_formula_is_fitted_as_by_the_command(trials, effects, ladder):
    """Control: ``effects`` says where in the order."""
    found = sm.compare(trials, effects, formulas=["brake: speed: kept *= 1 - a; a in 0..0.5"])
    assert found.fit.effects == tuple(name for name in found.fit.model.catalogue if name in ladder)
    assert [len(step.effects) for step in found.steps] == list(range(len(ladder) + 1))
    assert found.steps[1].effects == ladder[:1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"robot": {"leg_radius_m": 0.05}}, "robot: {'leg_radius_m': 0.05}; a string, Path, Robot or None is needed"),
        ({"penetrometer": 3}, "penetrometer: 3; a string, Path or None is needed"),
        ({"effects": None}, "effects: None; a list (a string each) is needed"),
        ({"effects": [3]}, "effects: [3]; a list (a string each) is needed"),
        ({"formulas": [3]}, "formulas: [3]; a list"),
        ({"effects_from": 3}, "effects_from: 3; a string, Path or a list (a string or Path each) is needed"),
        ({"model": []}, "model: []; a string is needed"),
    ],
)
def test_an_argument_of_another_type_is_named(trials, arguments, message):
    with pytest.raises(sm.InputError, match=re.escape(message)) as error:
        sm.compare(trials, **arguments)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("value", ["22", True, None, float("nan")])
def test_criteria_are_numbers(value):
    with pytest.raises(sm.InputError, match=f"criteria: claim is {value!r}; a number"):
        sm.Criteria(claim=value)
    assert sm.Criteria(claim=np.float32(9)).claim == 9


def test_a_comparison_draws_measured_base_and_effect(trials):
    figure = sm.compare(trials, ["stance_overlap"]).plot()
    panels = [panel for panel in figure.axes if panel.get_visible()]
    assert len(panels) == FEW["levels"]
    dashed = [line for line in panels[-1].lines if line.get_linestyle() == "--"]
    assert len(dashed) == 1
    assert figure._repr_png_().startswith(b"\x89PNG")


def test_a_base_model_alone_has_no_ghost(trials):
    panels = sm.compare(trials).plot().axes
    assert not [line for line in panels[-1].lines if line.get_linestyle() == "--"]


@pytest.mark.slow
def test_a_report_is_written_or_the_path_is_named(found, tmp_path):
    assert "stance overlap" in found.report(tmp_path / "report.html").read_text()
    (tmp_path / "file").write_text("")
    with pytest.raises(sm.InputError, match="can't be written"):
        found.report(tmp_path / "file" / "report.html")


@pytest.mark.slow
def test_nothing_of_ros_or_of_the_page_is_loaded():
    code = (
        "import sys, sandbot_model as sm; sm.discover; sm.compare; sm.Effect\n"
        "print(sorted({'rclpy', 'dash', 'cv2', 'matplotlib', 'pandas'} & set(sys.modules)))"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert shown.strip() == "[]"


def test_a_package_lists_its_public_names_and_no_more():
    assert set(sm.__all__) <= set(dir(sm))
    for name in sm.__all__:
        assert getattr(sm, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'discovr'"):
        sm.discovr  # noqa: B018
