"""Bootstrap standard errors: near the Jacobian's where the model is right, refused where nothing can be drawn."""

from dataclasses import replace

import numpy as np
import pytest

from sandbot_common.errors import InputError
from sandbot_common.parallel import Processes
from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting.bootstrap import bootstrap
from sandbot_model.fitting.fit import fit
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_model.physics.walking import Inputs
from sandbot_record.trials.table import Row, from_rows

MODEL = model_of("simple", (), catalogue())


def table(replicates):
    rng = np.random.default_rng(3)
    grid = np.meshgrid([0.60, 0.633], [4.0, 8.0, 12.0, 16.0, 20.0], range(replicates), indexing="ij")
    phi, omega, _ = (one.ravel() for one in grid)
    values = MODEL.walker.predict(Inputs(np.interp(phi, [0.6, 0.633], [205, 220]), omega, 0.4, phi), []).observables
    values = values + rng.normal(0, 1, values.shape) * [0.005, 0.0003, 0.01, 0.002]
    return from_rows(
        [
            Row(f"t{i}", float(phi[i]), 2e-4, float(omega[i]), "UNIFORM", 1.0, float(values[i, 0]), 0.001,
                float(values[i, 1]), float(values[i, 2]), float(values[i, 3]), "ok")
            for i in range(len(phi))
        ]
    )  # fmt: skip


def test_it_agrees_with_the_jacobian_within_a_factor_of_two():
    trials = table(5)
    best = fit(MODEL, cells_of(trials))
    drawn = bootstrap(trials, MODEL, 30, near=best.warm_start, seed=1)
    assert drawn["delta_t_s"] == pytest.approx(best.parameters["delta_t_s"].stderr, rel=1.0)
    assert drawn["delta_t_s"] > 0.4 * best.parameters["delta_t_s"].stderr
    assert drawn["k[1]"] == pytest.approx(best.k_stderr_n_per_m[1], rel=1.0)


@pytest.mark.parametrize(("replicates", "draws", "message"), [(1, 10, "no condition has replicates"), (3, 1, "2 or")])
def test_it_refuses_what_tells_no_spread(replicates, draws, message):
    with pytest.raises(InputError, match=message):
        bootstrap(table(replicates), MODEL, draws)


def test_the_result_does_not_depend_on_who_fits():
    trials = table(3)
    alone = bootstrap(trials, MODEL, 5)
    with Processes(2).map() as fit_all:
        assert bootstrap(trials, MODEL, 5, fit_all=fit_all) == alone
    assert bootstrap(trials, MODEL, 5, seed=1) != alone


def on_days(offset_m, replicates=6):
    """Replicates of all conditions, one of each a day; days differ by as much in lift."""
    trials = table(replicates)
    day = np.arange(len(trials)) % replicates
    lift = trials.lift_m + offset_m * np.random.default_rng(5).standard_normal(replicates)[day]
    return replace(trials, batch=np.array([f"day{one}" for one in day]), lift_m=lift)


def test_days_are_drawn_whole():
    """What the trials of a day share shows in the errors, and not if trials are drawn one by one."""
    shared, told = on_days(1e-3), {"near": None, "seed": 1}
    by_day = bootstrap(shared, MODEL, 30, **told)
    by_trial = bootstrap(replace(shared, batch=np.full(len(shared), "")), MODEL, 30, **told)
    assert by_day["k[1]"] > 1.3 * by_trial["k[1]"]


def test_days_that_do_not_differ_leave_the_errors_as_they_were():
    alike = on_days(0.0)
    by_day = bootstrap(alike, MODEL, 30, seed=1)
    assert by_day["k[1]"] == pytest.approx(fit(MODEL, cells_of(alike)).k_stderr_n_per_m[1], rel=1.0)


def test_a_day_for_each_level_can_stand_for_no_other():
    trials = table(3)
    days = replace(trials, batch=np.array([f"phi{phi}" for phi in trials.phi]))
    assert bootstrap(days, MODEL, 3) == bootstrap(trials, MODEL, 3)


def test_what_days_are_called_does_not_change_which_are_drawn():
    shared = on_days(1e-3)
    renamed = replace(shared, batch=np.array([f"day{9 - int(day[3:])}" for day in shared.batch]))
    drawn = bootstrap(shared, MODEL, 3, seed=1)
    assert bootstrap(renamed, MODEL, 3, seed=1) == pytest.approx(drawn, rel=1e-6, nan_ok=True)
