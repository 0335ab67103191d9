"""What a report opens with: where trials come from, as the recordings tell, and the paper's figures from them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sandbot_common.errors import InputError
from sandbot_common.robot import SANDBOT, Robot
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.compare import compare
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.walking import Inputs, Walker
from sandbot_model.report import atlas_section, supplement
from sandbot_model.report.curves import steps
from sandbot_model.report.table_sections import parameters
from sandbot_record.trials.table import Row, from_rows

OMEGA = (4.0, 12.0, 20.0)


def trials_at(*phis):
    rng, rows = np.random.default_rng(3), []
    for phi in phis:
        found = Walker().predict(Inputs(1e3 * (phi - 0.41), np.array(OMEGA), 0.4, phi))
        for number, omega in enumerate(OMEGA):
            for replicate in (1, 2):
                seen = found.observables[number] + rng.normal(0, [1e-3, 1e-4, 1e-3, 1e-4])
                name = f"t{phi}_{omega:g}_{replicate}"
                rows.append(Row(name, phi, 0.0003, omega, "UNIFORM", replicate, seen[0], 0.001, *seen[1:]))
    return from_rows(rows)


TRIALS = trials_at(0.59, 0.61, 0.63)
CELLS = cells_of(TRIALS)


def bag(clock="simulated", lab=False):
    """A recording as far as the report asks it."""
    names = ("clock", "lab") if lab else ("clock", "serial_legs")
    told = SimpleNamespace(decode=lambda: SimpleNamespace(status=[SimpleNamespace(name=name) for name in names]))
    provenance = {"clock": clock, "plan": "monday", "software_version": "0.1.0", "commit": "abc123"}
    return SimpleNamespace(provenance={"trial": provenance}, topics={"/diagnostics": 1}, messages=lambda _: [told])


def said(monkeypatch, opened, command="ros2 run x"):
    monkeypatch.setattr(supplement.Bag, "open", lambda _: opened)
    (table,) = supplement.origin(TRIALS, CELLS, {str(TRIALS.trial_id[0]): "a bag"}, command).tables
    return dict(table.rows)


@pytest.mark.parametrize(
    ("opened", "words"),
    [(bag(), "A virtual lab"), (bag("live", lab=True), "behind live nodes"), (bag("live"), "no virtual lab appears")],
)
def test_a_virtual_lab_is_called_one_and_nothing_else_is(monkeypatch, opened, words):
    told = said(monkeypatch, opened)
    assert words in told["source"]
    assert told["recorded by"] == "trackway 0.1.0, commit abc123"
    assert told["plan"].startswith("monday: 18 trials: φ 0.590, 0.610, 0.630; ω 4, 12, 20 rad/s")
    assert told["robot"] == "not stated; SandBot is assumed"
    assert told["command"] == "ros2 run x"


def test_a_robot_is_told_by_what_differs_from_sandbot():
    def told(robot):
        (table,) = supplement.origin(replace(TRIALS, robot=robot), CELLS, {}, "").tables
        return dict(table.rows)["robot"]

    assert told(Robot(leg_radius_m=0.06)) == "leg_radius_m 0.06 (SandBot's 0.0355)"
    assert told(SANDBOT) == "SandBot"


def test_of_a_table_only_what_it_tells_is_said(monkeypatch):
    """Control."""

    def torn(_):
        raise InputError("torn")

    monkeypatch.setattr(supplement.Bag, "open", torn)
    (table,) = supplement.origin(TRIALS, CELLS, {str(TRIALS.trial_id[0]): "a torn bag"}, "").tables
    assert dict(table.rows)["source"] == supplement.UNKNOWN
    assert {"recorded", "recorded by", "command"}.isdisjoint(dict(table.rows))


def test_the_papers_figures_are_drawn_with_their_captions_and_those_without_bags_are_named():
    (section,) = atlas_section.sections(TRIALS, compare(CELLS, catalogue(), []), {})
    assert section.pictures[0].caption.startswith("Fig. 1e of the paper. Mean speed against volume fraction")
    assert all(picture.source.startswith("data:image/svg+xml;base64,") for picture in section.pictures)
    assert [picture.caption[:8] for picture in section.pictures if picture.wide] == ["Fig. 2bc"]
    assert len(section.pictures) == 9
    assert "1c: two trials with bags" in section.text[0]


def test_a_single_volume_fraction_has_no_atlas():
    """Control."""
    trials = trials_at(0.61)
    assert atlas_section.sections(trials, compare(cells_of(trials), catalogue(), []), {}) == []


def test_correlations_of_the_errors_are_those_of_the_covariance():
    (shown,) = steps(compare(CELLS, catalogue(), []))
    table = next(one for one in parameters((shown,)).tables if one.caption.startswith("Correlations"))
    assert [row[1 + i] for i, row in enumerate(table.rows)] == ["1.00", "1.00"]
    a, b = shown.fit.covariance[:2, :2]
    assert float(table.rows[1][1].replace("−", "-")) == pytest.approx(b[0] / np.sqrt(a[0] * b[1]), abs=0.006)
