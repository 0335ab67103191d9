"""The benchmark's peers are no straw men: each finds what it can find, and the scores are of cells it has not seen."""

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from sandbot_model.fitting.fit import fit
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_model.physics.walking import Inputs
from sandbot_record.trials.table import Row, from_rows

K, DELTA_T, V_SWIM = np.array([172.0, 205.0, 220.0]), 0.4, 0.02
NOISE = np.array([0.003, 0.0003, 0.006, 0.001])


@pytest.fixture(scope="module")
def benchmark():
    # Here and not above: its peers' libraries take seconds to load.
    import discovery

    return discovery


@pytest.fixture(scope="module")
def peers(benchmark):
    import _peers

    return _peers


@pytest.fixture(autouse=True)
def one_thread():
    with threadpool_limits(1):
        yield


def draw(effects=(), values=(), seed=0):
    """27 trials a level on three levels."""
    rng = np.random.default_rng(seed)
    grid = np.meshgrid(np.arange(3), [4.0, 8.0, 12.0, 16.0, 18.0, 20.0, 22.0, 26.0, 30.0], np.arange(3), indexing="ij")
    level, omega, replicate = (one.ravel() for one in grid)
    level = level.astype(int)
    phi = np.array([0.585, 0.605, 0.63])[level]
    model = model_of("simple", effects, catalogue())
    seen = model.walker.predict(Inputs(K[level], omega, DELTA_T, phi, V_SWIM), list(values)).observables
    seen = seen + NOISE * rng.normal(size=seen.shape)
    return from_rows(
        [
            Row(f"t{i}", float(phi[i]), 2e-4, float(omega[i]), "UNIFORM", float(replicate[i]), float(seen[i, 0]), 0.001,
                float(seen[i, 1]), float(seen[i, 2]), float(seen[i, 3]), "ok")
            for i in range(len(phi))
        ]
    )  # fmt: skip


@pytest.fixture
def few(peers, monkeypatch):
    known = catalogue()
    names = ("stance_overlap", "swimming_thrust", "motor_saturation")
    monkeypatch.setattr(peers, "CATALOGUE", {name: known[name] for name in names})


@pytest.mark.usefixtures("few")
@pytest.mark.slow
def test_lmfit_names_what_is_there_and_nothing_where_nothing_is(peers):
    method = peers.lmfit_aic((0, 1, 2, 3))
    found = method(draw(("stance_overlap",), [{"eta": 0.15}]))
    assert found.named[0] == {"stance_overlap"}
    assert method(draw()).named == ()
    predict = found.refit(draw(("stance_overlap",), [{"eta": 0.15}], seed=1))
    base = model_of("simple", (), catalogue()).walker.predict(Inputs(205.0, 16.0, DELTA_T)).speed_m_s
    assert predict(np.array([0.605]), np.array([16.0])) == pytest.approx(0.85 * base, abs=0.004)


def test_lmfit_reaches_the_optimum_of_the_projects_own_fit(peers):
    table = peers.table_of(draw(seed=2))
    found = peers.best_lmfit(table, [0], ())
    ours = peers.base_fit(draw(seed=2))
    seen = table.predicted(found.model, found.theta, found.k[table.level])[table.condition, 0]
    rms = float(np.sqrt(np.mean((seen - table.values[:, 0]) ** 2)))
    assert rms == pytest.approx(ours.rmse_m_s, rel=0.03)


def test_sparse_regression_finds_a_term_of_its_library_and_nothing_in_noise(peers):
    rng = np.random.default_rng(3)
    trials = draw(seed=3)
    base = fit(model_of("simple", (), catalogue()), peers.cells_of(peers.speed_only(trials)))
    phi, omega, _ = peers._measured(trials)
    term = peers.physical(base, phi, omega)["S/w"]
    noise = 0.003 * rng.normal(size=len(phi))

    def found(residual):
        measured = peers.speed_of(base)(phi, omega) + residual + noise
        return peers._sparse(peers.physical, True, base, peers.replace(trials, speed_m_s=measured))

    coefficients, gain = found(0.4 * term)
    assert gain > 10
    assert coefficients["S/w"] == pytest.approx(0.4, rel=0.3)
    assert sum(value != 0 for value in coefficients.values()) <= 4
    assert found(0.0)[1] < 10


def test_mapped_terms_are_a_pair_only_by_two(peers):
    assert peers._mapped(["W v"]) == ({"stance_overlap"},)
    assert peers._mapped(["S/w", "W v"])[0] == {"swimming_thrust", "stance_overlap"}
    assert peers._mapped(["S/w", "W v", "W v Fr"])[0] == {"swimming_thrust"}
    assert peers._mapped([]) == ()


def test_the_discrepancy_repairs_what_the_base_model_misses(peers):
    thrust = {catalogue()["swimming_thrust"].parameters[0].name: 0.45}
    trials = draw(("swimming_thrust",), [thrust])
    at = np.array([0.585, 0.585]), np.array([12.0, 30.0])
    truth = model_of("simple", ("swimming_thrust",), catalogue()).walker.predict(
        Inputs(172.0, at[1], DELTA_T), [thrust]
    )
    with_gp = peers.gp_discrepancy(trials).refit(trials)(*at)
    alone = peers.base_alone(trials).refit(trials)(*at)
    assert np.abs(with_gp - truth.speed_m_s).max() < 0.4 * np.abs(alone - truth.speed_m_s).max()


def test_held_out_cells_are_whole_and_distinct(benchmark):
    trials = draw()
    masks = benchmark.cells_to_hold_out(trials)
    assert len(masks) == benchmark.HELD_OUT
    assert all(mask.sum() == 3 for mask in masks)
    assert (np.sum(masks, axis=0) <= 1).all()
    column = benchmark.fastest_column(trials)
    assert column.sum() == 9
    gaps = benchmark.gaps(lambda phi, omega: np.asarray(trials.speed_m_s)[column] - 0.01, trials.select(column))
    assert gaps == pytest.approx([0.01] * 9)


def test_a_score_knows_the_truth_and_what_is_missed(benchmark):
    world = next(one for one in benchmark.WORLDS if one.truth == ("stance_overlap",))
    gaps = (0.02, 0.02, 0.02) + (0.0,) * 3 * (benchmark.HELD_OUT - 1)
    score = benchmark.Score("m", world, (frozenset({"leg_slip"}), frozenset(world.truth)), 1.0, gaps, gaps, 0.005)
    assert (score.first, score.among, score.missed) == (False, True, 1)
    assert benchmark._said(score) == "leg_slip (+1) (✓)"


def test_the_report_says_where_a_peer_is_better(benchmark):
    mine = benchmark.WITH_FORMULA
    errors = {mine: {"cells": 2.0, "column": 1.0}, "discover, otherwise": {"cells": 1.0}, "peer": {"cells": 1.5}}
    errors["peer"]["column"] = 0.99
    assert benchmark._better(errors)[-1] == f"* cells: {mine} 2.00; better: peer (1.50)"
    assert len(benchmark._better(errors)) == 3
    assert "nobody" in benchmark._better({mine: {"cells": 1.0}, "peer": {"cells": 1.0}})[0]
