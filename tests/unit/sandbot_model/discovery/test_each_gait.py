"""Where an effect acts in one gait and not in another, the verdict says what holds in each."""

from dataclasses import replace

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.each_gait import judged_by_gait
from sandbot_model.physics.catalogue import catalogue
from sandbot_record.trials.table import from_rows

FEW = {name: catalogue()[name] for name in ("stance_overlap", "swimming_thrust")}


def two_gaits(first, second):
    """One table of two gaits, UNIFORM and one that turns alike but has another name."""
    other = replace(second, gait=np.full(len(second), "CUSTOM(3.1415926 0 0.5)"))
    rows = [*first.rows(), *(replace(row, trial_id=f"b{row.trial_id}") for row in other.rows())]
    return from_rows(rows)


@pytest.mark.parametrize("there", [True, False])
def test_an_effect_of_one_gait_is_named_with_it(drawn, there):
    """Control: where no gait is explained by itself either, nothing is added."""
    many = {"levels": 3, "omega": (6, 10, 14, 18)}
    first = drawn(seed=5, **many)
    second = drawn(("stance_overlap",), seed=6, values={"stance_overlap": {"eta": 0.2}}, **many)
    if not there:
        first, second = (
            replace(one, peak_speed_m_s=one.peak_speed_m_s * (1 - 0.02 * one.omega_rad_s)) for one in (first, second)
        )
    trials = two_gaits(first, second)
    found = discover(cells_of(trials), FEW, max_effects=1)
    assert found.verdict.status in ("unexplained", "partial")
    after = judged_by_gait(found, trials, FEW)
    said = [remark for remark in after.verdict.remarks if "of each gait by themselves are explained" in remark]
    assert len(said) == there
    if there:
        assert "by stance_overlap" in said[0]
        assert "by the base model" in said[0]


def test_of_one_gait_nothing_is_said(drawn):
    trials = drawn(("leg_slip",), seed=6, levels=3, omega=(6, 10, 14, 18))
    found = discover(cells_of(trials), FEW, max_effects=1)
    assert judged_by_gait(found, trials, FEW) is found
