"""Tables for pandas: the same numbers, or one line that says where they are."""

import sys

import numpy as np
import pytest

from sandbot_common.data_frame import data_frame
from sandbot_common.errors import InputError
from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting.fit import fit
from sandbot_model.physics.model import model_of
from sandbot_record.trials.table import Row, from_rows
from sandbot_tracking.videos import Track

TRIALS = from_rows([Row("a", 0.61, omega_rad_s=8.0, speed_m_s=0.1), Row("b", 0.61, omega_rad_s=12.0, speed_m_s=0.15)])


def results():
    """Everything that gives a frame, and what it says has the same numbers."""
    cells = cells_of(TRIALS)
    found = fit(model_of("simple", (), {}), cells)
    nothing = np.zeros((2, 3))
    track = Track(np.arange(2.0), nothing, nothing, nothing, np.zeros(2), np.zeros(2), 0.0, None)
    return {"rows()": TRIALS.to_frame, "columns()": track.to_frame, "to_dict()": found.to_frame}


def test_rows_and_columns_give_the_same_frame():
    rows = data_frame([{"a": 1, "b": "x"}, {"a": 2, "b": "y"}], "")
    assert rows.equals(data_frame({"a": [1, 2], "b": ["x", "y"]}, ""))


def test_without_pandas_every_result_says_so_in_one_line(monkeypatch):
    made = results()
    assert all(len(frame()) for frame in made.values())
    monkeypatch.setitem(sys.modules, "pandas", None)
    for instead, frame in made.items():
        with pytest.raises(InputError) as refusal:
            frame()
        assert str(refusal.value) == f"pandas is not installed; pip install pandas (the same numbers: {instead})"
