"""Trials gathered into cells."""

import dataclasses

import numpy as np
import pytest

from sandbot_common.errors import InputError
from sandbot_model.data.conditions import cells_of, noise_floor
from sandbot_model.physics.observables import Observable
from sandbot_record.trials.table import Row, from_rows


def test_cells_hold_means_scatter_and_counts(drawn):
    trials = drawn(levels=3, omega=(8, 16))
    cells = cells_of(trials)
    assert len(cells) == 6
    assert cells.trials == 18
    assert cells.observables == ("speed", "lift", "peak_speed", "first_step")
    first = (trials.omega_rad_s == 8) & (trials.phi < 0.59)
    # The loosest level swims at 8 rad/s: nothing is there to bring to the level's φ.
    np.testing.assert_allclose(cells.mean[0, 0], trials.speed_m_s[first].mean())
    np.testing.assert_allclose(cells.sd[0, 0], trials.speed_m_s[first].std(ddof=1))
    assert (cells.n == 3).all()
    np.testing.assert_array_equal(cells.level, [0, 0, 1, 1, 2, 2])


def test_what_was_not_measured_is_absent_not_zero(drawn):
    trials = drawn(levels=3, omega=(8, 16))
    cells = cells_of(dataclasses.replace(trials, lift_m=np.full(18, np.nan)))
    assert cells.observables == ("speed", "peak_speed", "first_step")
    assert np.isnan(cells.mean[:, Observable.lift]).all()
    assert (cells.n[:, Observable.lift] == 0).all()


def test_failed_trials_are_left_out_and_counted(drawn):
    trials = drawn(levels=3, omega=(8, 16))
    status = trials.status.copy().astype("<U10")
    status[:2] = "aborted"
    cells = cells_of(dataclasses.replace(trials, status=status))
    assert (cells.trials, cells.excluded) == (16, 2)
    with pytest.raises(InputError, match="none of 18 trials"):
        cells_of(dataclasses.replace(trials, status=np.full(18, "aborted")))


def test_pooled_noise_is_what_was_drawn(drawn):
    cells = cells_of(drawn(levels=7, replicates=5, seed=4))
    floor = noise_floor(cells)
    assert cells.noise[1] == pytest.approx(0.0004, rel=0.25)
    assert floor["peak_speed"] > 0.005


def test_without_replicates_noise_is_unknown(drawn):
    cells = cells_of(drawn(levels=3, replicates=1))
    assert np.isnan(cells.noise).all()
    assert (cells.pure_error_dof == 0).all()
    assert np.isfinite(cells.covariance).all()


def test_a_row_without_a_frequency_is_left_out_in_silence(recwarn):
    good, bad = (Row("t", 0.6, 0.001, omega, "SGCS", 1, 0.1, np.nan, 0.005, 0.4, 0.03, "ok") for omega in (12.0, 0.0))
    assert cells_of(from_rows([good, bad])).n.tolist() == [[1, 1, 1, 1]]
    assert [str(one.message) for one in recwarn] == []


def test_without_a_cell_everything_over_cells_is_one_shorter():
    """Each gait's own clock included: a cell that is left out takes its rates along."""
    gaits = ("SGCS", "UNIFORM")
    rows = [Row(f"{g}{w}{i}", 0.6, 0.0, w, g, i, 0.1) for g in gaits for w in (4.0, 8.0) for i in (0, 1)]
    cells = cells_of(from_rows(rows))
    assert len(cells) == 4
    over_cells = [one.name for one in dataclasses.fields(cells) if one.metadata.get("shape", "").startswith("(n,")]
    for cell in range(4):
        fewer, kept = cells.without(cell), np.arange(4) != cell
        assert fewer.gait == tuple(np.array(cells.gait)[kept])
        for name, per_cell in vars(cells.clock).items():
            np.testing.assert_array_equal(getattr(fewer.clock, name), per_cell[kept])
        for name in set(over_cells) - {"gait", "clock"}:
            if getattr(cells, name) is not None:
                np.testing.assert_array_equal(getattr(fewer, name), getattr(cells, name)[kept])


def test_without_a_cell_its_trials_are_counted_as_left_out_and_no_batch_is_empty():
    """An empty batch has an offset that is 0 of 0."""
    days = {4.0: "mon", 8.0: "tue", 12.0: "tue"}
    rows = [Row(f"{w}{i}", 0.6, 0.0, w, "UNIFORM", i, 0.1, batch=day) for w, day in days.items() for i in (0, 1)]
    cells = cells_of(from_rows(rows))
    fewer = cells.without(0)
    assert (fewer.trials, fewer.excluded) == (4, 2)
    assert cells.batch_share.shape == (3, 2)
    np.testing.assert_array_equal(fewer.batch_share, [[1.0], [1.0]])
    assert fewer.batch_mean.shape == (2, 1, 4)


def test_a_trial_that_names_no_batch_shares_one_with_those_of_its_condition_alone():
    def shares(*batches):
        rows = [
            Row(f"{w}{i}", 0.6, 0.0, w, "UNIFORM", i, 0.1, batch=batches[(w == 8.0) * 2 + i])
            for w in (4.0, 8.0) for i in (0, 1)
        ]  # fmt: skip
        return cells_of(from_rows(rows)).batch_share

    np.testing.assert_array_equal(shares("mon", "", "", ""), [[0.5, 0.5, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_array_equal(shares("mon", "tue", "mon", "tue"), [[0.5, 0.5], [0.5, 0.5]])
    assert shares("", "", "", "") is None


@pytest.mark.parametrize("whole", [True, False])
def test_what_batches_are_called_is_of_no_consequence(whole):
    """Each has conditions of its own, or trials of all of them."""

    def of(*names):
        rows = [
            Row(f"{w}{i}", 0.6, 0.0, w, "UNIFORM", i, 0.01 * w + i**2, batch=names[int(w) // 4 - 1 if whole else i],
                run_order=w + 20 * i)
            for w in (4.0, 8.0, 12.0) for i in range(3)
        ]  # fmt: skip
        return cells_of(from_rows(rows))

    cells, renamed = of("mon", "tue", "wed"), of("zebra", "cow", "ant")
    np.testing.assert_array_equal(cells.batch_share, renamed.batch_share)
    np.testing.assert_array_equal(cells.batch_mean, renamed.batch_mean)
    np.testing.assert_array_equal(cells.batch_order, renamed.batch_order)
    # Control: share and mean of a batch stay together.
    total = np.nansum(cells.batch_share[..., None] * cells.batch_mean, axis=1)
    np.testing.assert_allclose(total[:, 0], cells.mean[:, 0])
    np.testing.assert_allclose(np.nansum(cells.batch_share * cells.batch_order, axis=1), cells.order, atol=1e-12)


def with_lifts_of_swimmers(trials, change):
    swam = trials.lift_m < 0.0015
    return dataclasses.replace(trials, lift_m=np.where(swam, change(trials.lift_m), trials.lift_m))


def test_lifts_that_are_cut_off_at_0_tell_nothing_of_the_zero_of_the_reading(drawn):
    """Controls: with a negative one all count; so they do where the reading is coarse, and 0 is what was read."""
    trials = drawn(seed=3)
    used = np.isfinite(cells_of(trials).mean[:, Observable.lift])
    cut = with_lifts_of_swimmers(trials, lambda lift: np.maximum(lift - 0.0002, 0.0))
    assert (trials.lift_m < 0).sum() > 3
    cells = cells_of(cut)
    lost = used & np.isnan(cells.mean[:, Observable.lift])
    assert lost.any()
    assert (cells.mean[lost, Observable.speed] < 0.035).all()
    assert np.isfinite(cells.mean[cells.mean[:, Observable.speed] > 0.05, Observable.lift]).all()
    one_below = dataclasses.replace(
        cut, lift_m=np.where(np.arange(len(cut)) == np.argmin(cut.lift_m), -1e-5, cut.lift_m)
    )
    coarse = dataclasses.replace(cut, lift_m=np.round(cut.lift_m, 3))
    for other in (trials, one_below, coarse):
        assert (np.isfinite(cells_of(other).mean[:, Observable.lift]) == used).all()
