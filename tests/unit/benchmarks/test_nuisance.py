"""The harness of the nuisance benchmark: what counts as what, and a run that goes on where it was stopped."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

import nuisance


@pytest.mark.parametrize(
    ("truth", "status", "sets", "said"),
    [
        ("null", "adequate", [], "adequate"),
        ("null", "identified", [["leg_slip"]], "false claim"),
        ("stance_overlap", "identified", [["stance_overlap"]], "named"),
        ("stance_overlap", "identified", [["leg_slip"]], "false claim"),
        ("stance_overlap", "ambiguous", [["leg_slip"], ["stance_overlap"]], "ambiguous"),
        ("stance_overlap", "ambiguous", [["leg_slip"], ["cable_drag"]], "false claim"),
        ("stance_overlap", "unexplained", [], "unexplained"),
        ("null", "untested", [], "untested"),
    ],
)
def test_a_verdict_falls_in_its_column(truth, status, sets, said):
    verdict = SimpleNamespace(status=status, alternatives=sets, effects=sets[0] if sets else [])
    assert nuisance.outcome(frozenset(nuisance.TRUTHS[truth]), verdict) == said
    assert said in nuisance.STATUSES


def test_the_matrix_has_every_row_and_every_world_is_one():
    some = list(nuisance.cases(len(nuisance.EFFECTS)))
    rows = ((len(nuisance.NUISANCES) - 1) * 2 + 1) * 2
    assert len(some) == len(set(some)) == rows * 2 * len(nuisance.EFFECTS)
    assert len(nuisance.EFFECTS) >= 5
    for row in {(case.nuisance, case.dose, case.order) for case in some}:
        hidden = [case.truth for case in some if (case.nuisance, case.dose, case.order) == row]
        assert set(hidden) == {*nuisance.TRUTHS}
    assert all(case.world.effects.keys() == nuisance.TRUTHS[case.truth].keys() for case in some)
    clean = [case.world.week == nuisance.Week() for case in some if case.nuisance == "clean"]
    assert all(clean)
    assert not any(case.world.week == nuisance.Week() for case in some if case.nuisance != "clean")


def test_what_is_known_is_not_run_again_and_coverage_is_counted(tmp_path):
    wanted = list(nuisance.cases(1, ["drift"]))[:1]
    known = {**vars(wanted[0]), "outcome": "adequate", "z": {"delta_t_s": 0.5, "k[0]": 1.5, "k[1]": -3.0}}
    path = tmp_path / "out.jsonl"
    path.write_text(json.dumps(known) + "\n")
    found = nuisance.collect(nuisance.analyse, wanted, path, 1)
    assert found == [known]
    assert len(path.read_text().splitlines()) == 1
    assert nuisance.report(found).splitlines()[2] == (
        "| drift | mild | as_listed | nothing | 1 | 1 | 0 | 0 | 0 | 0 | 0 | 0 | – | 1.00/1.00 | 0.00/0.50 | – |"
    )


def test_what_could_not_be_told_is_not_missed():
    of = {"nuisance": "jump", "dose": "strong", "order": "as_listed", "truth": "stance_overlap", "z": {}}
    some = [("named", 90.0), ("named", 20.0), ("adequate", 30.0), ("adequate", 60.0), ("ambiguous", 90.0)]
    found = [{**of, "outcome": outcome, "gain": gain} for outcome, gain in some]
    assert " | 2 of 3 | " in nuisance.report(found).splitlines()[2]
    # Of a run that did not ask, nothing is said.
    assert " | – | – | – | – |" in nuisance.report([{**one, "gain": None} for one in found]).splitlines()[2]


def test_a_week_from_the_priors_scatters_as_they_say():
    weeks = [nuisance.drawn(seed) for seed in range(400)]
    priors = {
        "k_batch_sd": nuisance.DEFAULT.bed_scatter,
        "k_drift": nuisance.DEFAULT.drift,
        "lift_zero_m": nuisance.Accuracy().lift_zero_m,
        "speed_scale": nuisance.Accuracy().speed_scale,
    }
    for name, sd in priors.items():
        values = np.array([getattr(week, name) for week in weeks])
        assert np.sqrt(np.mean(values**2)) == pytest.approx(sd, rel=0.12)
        assert (values.min() >= 0) == (name == "k_batch_sd")
    some = list(nuisance.cases(1, (), drawn_from_priors=True))
    assert {case.dose for case in some} == {nuisance.FROM_PRIORS}
    assert all(case.world.week == weeks[0] for case in some)


def test_few_seeds_are_said_to_show_little():
    few, many = nuisance.resolution(20), nuisance.resolution(1000)
    assert "0.60 to 0.76 in only 66% of rows" in few
    assert "0.90 to 0.99 in 55%" in few
    assert "within 0.45 to 0.85 and 0.85 to 1.00 (95 %)" in few
    assert "0.60 to 0.76 in only 100% of rows" in many
