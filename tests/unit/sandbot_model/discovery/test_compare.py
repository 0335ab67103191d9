"""The ladder of a comparison, and the geometry lock."""

import pickle

import numpy as np
import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.compare import compare, geometry_lock
from sandbot_model.physics.catalogue import catalogue

EFFECTS = catalogue()


@pytest.mark.slow
def test_misses_what_it_lacks_and_says_where(drawn):
    cells = cells_of(drawn(("stance_overlap",), values={"stance_overlap": {"eta": 0.2}}))
    ladder = compare(cells, EFFECTS, ["stance_overlap"])
    base, better = ladder
    assert base.lack_of_fit_p < 1e-6
    assert base.fails
    assert {fail.observable for fail in base.fails} & {"speed", "lift"}
    assert abs(base.fails[0].z) == max(abs(fail.z) for fail in base.fails)
    assert better.lack_of_fit_p > 1e-3
    assert better.rmse_m_s < base.rmse_m_s
    assert better.cv_rmse_m_s < base.cv_rmse_m_s
    assert better.parameters["stance_overlap.eta"].value == pytest.approx(0.2, abs=0.02)
    assert np.nanmedian(ladder.lock) == pytest.approx(0.8, abs=0.03)
    content = ladder.to_dict()
    assert [step["effects"] for step in content["steps"]] == [[], ["stance_overlap"]]


def test_it_prints_its_ladder_and_its_last_step_and_pickles_small(drawn):
    ladder = compare(cells_of(drawn(levels=3)), EFFECTS, ["leg_slip"])
    said = repr(ladder)
    assert len(said.splitlines()) < 25
    assert "+ leg_slip" in said
    assert said.endswith(repr(ladder.fit))
    assert "<script" not in ladder._repr_html_()
    assert len(pickle.dumps(ladder)) < 50_000
    assert pickle.loads(pickle.dumps(ladder)).to_dict() == ladder.to_dict()


def test_errors_across_stairs_are_looked_for_in_the_last_step_alone(drawn, monkeypatch):
    asked = []
    monkeypatch.setattr("sandbot_model.discovery.compare.with_sampled_errors", lambda fit: asked.append(fit) or fit)
    ladder = compare(cells_of(drawn(levels=3)), EFFECTS, ["leg_slip"])
    assert asked == [ladder.fit]
    assert len(ladder) == 2


def test_the_lock_holds_without_an_effect(drawn):
    assert np.nanmedian(geometry_lock(cells_of(drawn()))) == pytest.approx(1.0, abs=0.03)
