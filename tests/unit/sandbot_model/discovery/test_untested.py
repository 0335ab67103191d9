"""Where pure error is unknown, or known so poorly that a gross miss would pass, nothing is claimed."""

from dataclasses import replace

import numpy as np
import pytest

from sandbot_lab.direct import direct_trials
from sandbot_lab.world import World, null_world
from sandbot_model.data.conditions import cells_of, noise_floor
from sandbot_model.discovery.criteria import DEFAULT
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.untested import plainly_missed, repeats, to_run, untested
from sandbot_model.discovery.verdict import judge
from sandbot_model.fitting.fit import fit
from sandbot_model.fitting.goodness import undetected_miss
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_record.trials.table import Row, from_rows

PHI = np.linspace(0.58, 0.633, 7).tolist()
OMEGA = [4.0, 8.0, 12.0, 16.0, 20.0, 24.0, 30.0]
SIMPLE = model_of("simple", (), {})
DISTURBED = World(effects={"disturbed_ground": {"k_l_n_per_m": 175.0, "s_c": 0.95}})


def rows(world, replicates=1, seed=3):
    return [Row(**row) for row in direct_trials(world, PHI, OMEGA, replicates=replicates, seed=seed)]


def one_replicated():
    """49 conditions, one of them three times."""
    return [
        row for row in rows(DISTURBED, 3) if row.replicate == 0 or (row.omega_rad_s == 8 and "0.580" in row.trial_id)
    ]


def as_figure(found, sd):
    """The same numbers as a digitised figure has them: no replicate numbers, an error bar each."""
    return from_rows(
        [
            replace(row, replicate=np.nan, speed_sd_m_s=sd, lift_m=np.nan, peak_speed_m_s=np.nan, first_step_m=np.nan)
            for row in found
        ]
    )


def of_the_base_model(cells):
    """The verdict where no effect is tried, without the long search for a formula."""
    return judge({(): fit(SIMPLE, cells)}).status


def test_copies_test_nothing():
    """A computation without noise, three times: no model of it is right to 0.1 µm/s."""
    alike = [replace(row, trial_id=f"{row.trial_id}{n}", replicate=n) for row in rows(null_world()) for n in (1.0, 2.0)]
    verdict = untested(cells_of(from_rows(alike)), SIMPLE, DEFAULT)
    assert verdict.status == "untested"
    assert verdict.because.startswith("replicates agree to the last digit, as copies or a noise-free computation would")


@pytest.mark.parametrize("found", [one_replicated, lambda: rows(DISTURBED)], ids=["one condition", "none"])
def test_a_gross_miss_is_not_called_adequate(found):
    cells = cells_of(from_rows(found()))
    assert untested(cells, SIMPLE, DEFAULT).status == "untested"
    result = discover(cells, catalogue())
    assert len(result.fits) == 1  # it is said at once: no effect is tried
    assert (result.verdict.status, result.verdict.effects) == ("untested", ())
    assert [step.effects for step in result.steps] == [()]
    content = result.to_dict()
    assert content["schema"] == "sandbot.discovery/2"
    assert content["verdict"]["status"] == "untested"
    assert content["stability"] is None
    assert len(content["next_trials"]) == 6
    assert {trial["replicates"] for trial in content["next_trials"]} == {2}


def test_what_is_to_be_repeated_makes_it_testable():
    found = rows(DISTURBED, 3)
    wanted = {(round(one.phi, 2), one.omega_rad_s) for one in repeats(cells_of(from_rows(rows(DISTURBED))))}
    assert len(wanted) == 6
    measured = [row for row in found if row.replicate == 0 or (round(row.phi, 2), row.omega_rad_s) in wanted]
    cells = cells_of(from_rows(measured))
    assert untested(cells, SIMPLE, DEFAULT) is None
    assert of_the_base_model(cells) == "unexplained"


def run(world, trials, replicates, seed):
    """Trials at these (φ, ω)."""
    return [
        replace(Row(**row), trial_id=f"{seed}_{n}_{at}", lift_m=np.nan, peak_speed_m_s=np.nan, first_step_m=np.nan)
        for n, (phi, omega) in enumerate(trials)
        for at, row in enumerate(direct_trials(world, [phi], [omega], replicates=replicates, seed=seed + n))
    ]


FEW = {
    "two cells": [(0.60, 12.0), (0.633, 16.0)],
    "one cell": [(0.62, 12.0)],
    "one frequency": [(phi, 12.0) for phi in PHI],
    "as many as parameters": [(0.60, 12.0), (0.60, 16.0), (0.633, 12.0), (0.633, 16.0)],
}


@pytest.mark.parametrize("replicates", [1, 2, 8])
@pytest.mark.parametrize("design", FEW.values(), ids=FEW)
def test_a_design_with_too_few_cell_means_is_asked_for_new_conditions_and_then_is_tested(design, replicates):
    """It used to be asked for replicates, again and again, that could not help."""
    measured = run(DISTURBED, design, replicates, seed=10)
    cells = cells_of(from_rows(measured))
    said = untested(cells, SIMPLE, DEFAULT).because
    wanted = to_run(cells, SIMPLE)
    assert "3 trials at each of 6 new conditions would suffice" in said
    assert len(wanted) == 6
    assert not {(round(one.phi, 2), one.omega_rad_s) for one in wanted} & {(round(phi, 2), w) for phi, w in design}
    assert all(cells.level_phi.min() <= one.phi <= cells.level_phi.max() for one in wanted)
    assert all(one.omega_rad_s <= cells.omega.max() for one in wanted)
    for n, one in enumerate(wanted):
        measured += run(DISTURBED, [(one.phi, one.omega_rad_s)], one.replicates, seed=1000 + 100 * n)
    cells = cells_of(from_rows(measured))
    assert untested(cells, SIMPLE, DEFAULT) is None
    assert of_the_base_model(cells) != "untested"


def test_a_design_with_enough_cell_means_is_asked_for_replicates():
    cells = cells_of(from_rows(run(DISTURBED, [(phi, omega) for phi in PHI[:2] for omega in OMEGA], 1, seed=10)))
    assert "2 more trials at each of 6 conditions would suffice" in untested(cells, SIMPLE, DEFAULT).because
    assert list(map(repr, to_run(cells, SIMPLE))) == list(map(repr, repeats(cells)))


def test_replicates_throughout_are_tested():
    assert untested(cells_of(from_rows(rows(null_world(), 2))), SIMPLE, DEFAULT) is None


def test_the_gross_miss_is_that_of_the_f_test():
    assert undetected_miss(6) == pytest.approx(2.98, abs=0.01)
    assert undetected_miss(2) > 10
    assert all(undetected_miss(one) > undetected_miss(one + 1) for one in range(40))


def test_error_bars_of_a_figure_are_pure_error():
    cells = cells_of(as_figure(rows(null_world()), 0.005))
    assert noise_floor(cells)["speed"] == pytest.approx(0.005, rel=0.2)
    verdict = judge({(): fit(SIMPLE, cells)})
    assert verdict.status == "adequate"
    assert "misses the cell means by more than the error bars, too little to reject it (" in verdict.because
    assert of_the_base_model(cells_of(as_figure(rows(DISTURBED), 0.005))) == "unexplained"


def test_an_error_bar_of_phi_widens_that_of_the_speed():
    plain = as_figure(rows(null_world()), 0.005)
    floors = [noise_floor(cells_of(replace(plain, phi_sd=np.full(49, sd))))["speed"] for sd in (0.0, 0.002)]
    assert floors[1] > 1.2 * floors[0]


def test_the_accuracy_of_one_trial_is_no_pure_error():
    # A campaign's own rows say how well tracking measured each trial, not what trials scatter.
    numbered = untested(cells_of(from_rows(rows(null_world()))), SIMPLE, DEFAULT)
    assert numbered.status == "untested"
    assert "those of measuring a single trial, for their rows have a replicate number" in numbered.because
    # Said of no table that has none.
    without = from_rows([replace(row, speed_sd_m_s=np.nan) for row in rows(null_world())])
    assert "no error bars are given" in untested(cells_of(without), SIMPLE, DEFAULT).because


@pytest.mark.parametrize("source", ["error bars", "replicates"])
def test_whatever_gives_too_few_degrees_of_freedom_is_named(source):
    two_bars = replace(as_figure(rows(DISTURBED), 0.005), speed_sd_m_s=np.where(np.arange(49) < 2, 0.005, np.nan))
    cells = cells_of(two_bars if source == "error bars" else from_rows(one_replicated()))
    assert untested(cells, SIMPLE, DEFAULT).because.startswith(f"{source} give ")


def test_where_speed_is_replicated_the_replicates_speak():
    found = from_rows([replace(row, speed_sd_m_s=0.05) for row in rows(null_world(), 3)])
    assert noise_floor(cells_of(found))["speed"] < 0.01
    assert cells_of(found).pure_error_from == "replicates"


def test_what_single_trials_show_plainly_is_said():
    overlap, nothing = World(effects={"stance_overlap": {"eta": 0.2}}), null_world()
    missed, right = (fit(SIMPLE, cells_of(from_rows(rows(world)))) for world in (overlap, nothing))
    assert np.isnan(missed.lack_of_fit_p)
    assert plainly_missed(missed).startswith("body lift is missed by 0.")
    assert "rms (a trial usually scatters by 0.05)" in plainly_missed(missed)
    assert plainly_missed(right) == ""
    slow = replace(right.point, theta=np.where(np.arange(len(right.point.theta)) == 0, 2.0, right.point.theta))
    assert "delta_t_s = 2 (plausible: 0.1 to 1.2)" in plainly_missed(replace(right, point=slow))
