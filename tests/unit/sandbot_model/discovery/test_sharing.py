"""A verdict beside what trials share: a lift zero is no effect, an effect no lift zero; clean data stay as they are."""

import copy
import dataclasses
import re
from types import SimpleNamespace

import numpy as np
import pytest

import _drawn
from sandbot_common.accuracy import USUAL
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery import nuisances_about, sharing
from sandbot_model.discovery.batch_sd import BATCH, BATCH_SCALE, BATCH_ZERO, BatchSd
from sandbot_model.discovery.criteria import DEFAULT
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.nuisances_about import averaged_over_scatter, estimated_batch_sd, nuisances_for
from sandbot_model.discovery.nuisances_in_words import confounded_drift
from sandbot_model.discovery.residual import suggest_formula
from sandbot_model.discovery.sharing import (
    _improved_beside,
    _nearest_rivals,
    _refused_if_parts_suffice,
    nuisances_suffice,
    refitted_globally,
)
from sandbot_model.discovery.structure import STRUCTURE, at_random, smooth_p, trend_p_of
from sandbot_model.discovery.verdict import Verdict, judge
from sandbot_model.fitting.fit import fit, fitted_at, refitted
from sandbot_model.fitting.goodness import Estimate
from sandbot_model.physics.averaging import predicted
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_model.physics.observables import Observable
from sandbot_model.physics.walking import Inputs, KCurve, Walker
from sandbot_record.trials.table import from_rows

OVERLAP = {name: effect for name, effect in catalogue().items() if name == "stance_overlap"}


def table(drawn, effects=(), *, lift_zero_m=0.0, batch="", seed=2):
    rows = drawn(effects, seed=seed, levels=4, noise=0.4).rows()
    return from_rows(
        [
            dataclasses.replace(row, lift_m=row.lift_m + lift_zero_m, batch=batch.format(row=row), run_order=i + 1.0)
            for i, row in enumerate(rows)
        ]
    )


def verdict(trials):
    return discover(cells_of(trials), OVERLAP, max_effects=1)


def test_a_lift_read_one_grain_too_high_is_no_overlap(drawn):
    found = verdict(table(drawn, lift_zero_m=1e-3))
    assert found.verdict.status == "adequate"
    assert "a lift-zero error of" in found.verdict.because
    assert "k that scatters" not in found.verdict.because
    zero = next(one for one in found.to_dict()["nuisances"] if one["name"] == "lift_zero_m")
    assert zero["value"] == pytest.approx(1e-3, abs=3 * zero["stderr"])
    assert zero["prior_sd"] == USUAL.lift_zero_m


def test_where_a_zero_denies_an_effect_errors_cover_the_fit_with_it_too(drawn):
    """Of few trials, an overlap may as well be a zero and another Δt."""
    cells = cells_of(drawn(("stance_overlap",), seed=2, levels=3, omega=(8, 12, 16, 20), replicates=2, noise=1.4))
    found, other = discover(cells, OVERLAP, max_effects=1), fit(model_of("simple", ("stance_overlap",), OVERLAP), cells)
    assert found.verdict.status == "adequate"
    assert "would be identified: stance_overlap (standard errors of Δt and k cover both)" in found.verdict.because
    here, there = found.fit.parameters["delta_t_s"], other.parameters["delta_t_s"]
    own = averaged_over_scatter(found.fit, DEFAULT).parameters["delta_t_s"].stderr
    weight = 1 / (1 + np.exp((other.bic - found.fit.bic) / 2))
    rms = np.sqrt((1 - weight) * own**2 + weight * (there.stderr**2 + (there.value - here.value) ** 2))
    assert here.stderr == pytest.approx(rms, rel=0.05)
    assert here.stderr > 1.5 * own
    assert (found.fit.k_stderr_n_per_m > 0.7 * np.abs(other.k_n_per_m - found.fit.k_n_per_m)).all()
    # Control: nothing is denied.
    clean = verdict(table(drawn))
    assert clean.verdict.status == "adequate"
    assert "cover both" not in clean.verdict.because


def test_errors_cover_another_formula_that_fits_as_well_beside_the_scatter_of_preparations():
    """Δt by the model's acceleration is 0.9 s, by the exact one 0.4 s; a bed that scatters hides which."""
    exact = catalogue()["exact_vertical_acceleration"]
    found = discover(cells_of(prepared(exact)), {exact.identifier: exact}, max_effects=1)
    assert found.verdict.status == "adequate"
    assert found.unseen == (exact.identifier,)
    assert "(its standard error covers both)" in found.verdict.because
    value, stderr = found.fit.parameters["delta_t_s"]
    assert abs(value - _drawn.DELTA_T_S) < 2 * stderr
    # Control: by the base model's formula, a small error that covers the truth.
    null = discover(cells_of(prepared()), {exact.identifier: exact}, max_effects=1)
    assert null.verdict.status == "adequate"
    assert "covers both" not in null.verdict.because
    value, stderr = null.fit.parameters["delta_t_s"]
    assert abs(value - _drawn.DELTA_T_S) < 3 * stderr < 0.1


def prepared(*effects, seed=1):
    """15 conditions of three trials; k scatters by 0.7 % from one preparation to the next, of which each has one."""
    rng = np.random.default_rng(seed)
    grid = np.meshgrid((0.585, 0.605, 0.625), (6, 11, 16, 20, 24), np.arange(3), indexing="ij")
    phi, omega, replicate = (axis.ravel().astype(float) for axis in grid)
    k = _drawn.GROUND(phi) * np.exp(0.007 * np.repeat(rng.normal(size=15), 3))
    inputs = Inputs(k, omega, _drawn.DELTA_T_S, phi)
    seen = predicted(Walker(effects), inputs, [{} for _ in effects], _drawn.GROUND).observables
    return _drawn.table(phi, omega, replicate, seen + 0.4 * _drawn.NOISE * rng.normal(size=seen.shape))


def test_a_zero_farther_off_than_is_believed_is_no_explanation_but_is_said(drawn):
    far = verdict(table(drawn, lift_zero_m=4e-3)).verdict
    assert far.status == "unexplained"
    assert re.search(r"; a lift-zero error of (3\.9|4) ± 0\.\d+ mm .* would explain it all: check that", far.because)
    clogged = drawn(seed=2, levels=4, formulas=["c: speed: kept *= 1 - 0.3/(1 + exp((15 - omega)/2))"])
    other = verdict(clogged).verdict
    assert other.status == "unexplained"
    assert "check that" not in other.because


def test_of_two_readings_that_which_is_off_is_named(drawn):
    """Beside a free lift zero it is the scale, held as it is, that takes in speeds 5 % too large."""
    rows = drawn(seed=2, levels=7).rows()
    along = ("speed_m_s", "peak_speed_m_s", "first_step_m")
    rows = [dataclasses.replace(row, **{name: 1.05 * getattr(row, name) for name in along}) for row in rows]
    few = {name: effect for name, effect in catalogue().items() if name in ("bed_slope", "stance_overlap")}
    because = discover(cells_of(from_rows(rows)), few, max_effects=1).verdict.because
    assert re.search(r"a speed-scale error of (4\.\d|5) ± .* would explain as much", because)
    assert "lift zero" not in because


def with_lift_scaled(table, scale):
    return from_rows([dataclasses.replace(row, lift_m=scale * row.lift_m) for row in table.rows()])


def test_a_lift_read_too_large_looks_like_a_loss_of_speed_and_is_said(drawn):
    few = {name: effect for name, effect in catalogue().items() if name in ("disturbed_ground", "stance_overlap")}
    scaled = discover(cells_of(with_lift_scaled(drawn(seed=2, levels=7, noise=0.4), 1.15)), few, max_effects=1).verdict
    assert scaled.effects == ("stance_overlap",)
    assert re.search(r"a lift-scale error of 1[3-7] ± .* would explain as much", scaled.because)
    disturbed = discover(cells_of(drawn(("disturbed_ground",), seed=2, levels=7)), few, max_effects=1).verdict
    assert disturbed.effects == ("disturbed_ground",)
    assert "scale of the lift" not in disturbed.because


def test_a_lift_read_too_small_is_no_explanation_but_is_said(drawn):
    """No effect adds to the speed of legs that are as deep as the lift says."""
    few = {name: effect for name, effect in catalogue().items() if name in ("disturbed_ground", "stance_overlap")}
    far = discover(cells_of(with_lift_scaled(drawn(seed=2, levels=7, noise=0.4), 0.85)), few, max_effects=1).verdict
    assert far.status == "unexplained"
    assert re.search(r"a lift-scale error of -1[3-9] ± .* would explain it all: check that", far.because)


def test_a_pair_that_stands_beside_nuisances_ends_no_search_among_single_effects(drawn):
    """It was found beyond the best of them, and its rivals have not been tried yet."""
    few = {name: effect for name, effect in catalogue().items() if name in ("stance_overlap", "swimming_thrust")}
    search = EffectSearch(cells_of(drawn(tuple(few), seed=2, levels=4, noise=0.4)), few, "simple")
    search.run(2)
    assert judge(search.fits).effects == tuple(few)
    assert not nuisances_suffice(search, 1)
    assert nuisances_suffice(search, 2)


def with_range(name, low, high):
    """An effect of the catalogue with another plausible range of its one parameter."""
    effect = copy.copy(catalogue()[name])
    (parameter,) = effect.parameters
    effect.parameters = (dataclasses.replace(parameter, low=low, high=high),)
    return effect


@pytest.mark.parametrize(
    ("low", "planted", "fallen"),
    [
        (0.13, ("stance_overlap",), True),
        (0.0, ("stance_overlap",), False),
        (0.13, ("stance_overlap", "leg_slip"), False),
    ],
)
def test_a_claim_falls_with_an_effect_that_only_brings_another_within_its_range(drawn, low, planted, fallen):
    """Controls: a number that is believed without it, and an effect that is there."""
    few = {"stance_overlap": with_range("stance_overlap", low, 0.5), "leg_slip": catalogue()["leg_slip"]}
    search = EffectSearch(cells_of(table(drawn, planted)), few, "simple")
    search.run(2)
    search.fit("the pair", [tuple(few)], nearby=True)
    found = _refused_if_parts_suffice(search, Verdict("identified", tuple(few), (tuple(few),), ""))
    assert (found is not None) == fallen
    if found:
        assert "but only with stance_overlap.eta = 0." in found.verdict.because


DAYS_MM = dict(zip((4.0, 8.0, 12.0, 16.0, 20.0, 24.0, 30.0), (-0.3, 0.7, -0.6, -0.1, 0.5, -0.4, 0.5), strict=True))
"""Another zero each day, and one frequency a day."""


def zeroed_each_day(trials, *, told=True, times=1.0):
    rows = [
        dataclasses.replace(
            row,
            lift_m=row.lift_m + times * 1e-3 * DAYS_MM[row.omega_rad_s],
            batch=f"day{row.omega_rad_s:g}" if told else "",
        )
        for row in trials.rows()
    ]
    return from_rows(rows)


def test_a_lift_zero_set_anew_each_day_is_granted(drawn):
    found = verdict(zeroed_each_day(table(drawn)))
    assert found.verdict.status == "adequate"
    assert "a lift zero that scatters by" in found.verdict.because
    assert "from batch to batch (prior 0.6 mm)" in found.verdict.because
    zeros = next(one for one in found.to_dict()["nuisances"] if one["name"] == BATCH_ZERO)
    assert zeros["count"] == 7
    assert zeros["value"] == pytest.approx(0.48e-3, rel=0.3)


@pytest.mark.parametrize("how", [{"told": False}, {"times": 10.0}])
def test_a_lift_zero_of_days_that_nobody_told_or_believes_is_not(drawn, how):
    assert verdict(zeroed_each_day(table(drawn), **how)).verdict.status != "adequate"


def test_an_overlap_is_named_beside_a_lift_zero_set_anew_each_day(drawn):
    found = verdict(zeroed_each_day(table(drawn, ("stance_overlap",))))
    assert (found.verdict.status, found.verdict.effects) == ("identified", ("stance_overlap",))


KICKED = "kicked: speed: kept *= 1 - a*R*omega**2/g; a [1] in 0.03..0.06"


@pytest.mark.slow
@pytest.mark.parametrize("planted", [(), (KICKED,)])
def test_no_formula_has_the_zeros_of_days_for_its_own(drawn, planted):
    """What is to speak against a claim takes for granted what the claim does."""
    trials = zeroed_each_day(drawn(seed=2, levels=4, noise=0.4, formulas=planted), times=2.0)
    base = fit(model_of("simple", (), OVERLAP), cells_of(trials))
    anew = nuisances_for(base, DEFAULT, BatchSd(lift_zero_of_batch_m=1e-3))
    found = suggest_formula(fitted_at(base.model, base.cells, base.point, anew), OVERLAP)
    assert suggest_formula(base, OVERLAP) is not None
    assert found.leaves_nothing if planted else found is None


@pytest.mark.parametrize(("off", "granted"), [(0.02, True), (0.08, False)])
def test_a_scale_of_one_day_that_no_calibration_is_off_by_explains_nothing(drawn, off, granted):
    """What happens at one frequency only is no scale of its day, were that the only one so far off."""
    trials = zeroed_each_day(table(drawn), times=0.0)
    short = read_too_short(trials, np.where(trials.omega_rad_s == 12, off, 0.0))
    assert (verdict(short).verdict.status == "adequate") == granted


def test_how_far_batches_differ_is_told_apart(drawn):
    """A zero and a scale of each day are not taken for k of the bed."""
    plain = fit(model_of("simple", (), OVERLAP), cells_of(zeroed_each_day(table(drawn))))
    apart = estimated_batch_sd(plain, DEFAULT)
    assert apart[BATCH_ZERO] == pytest.approx(0.5e-3, rel=0.4)
    assert apart[BATCH] < 0.5 * DEFAULT.bed_scatter
    assert apart[BATCH_SCALE] == 0.0


def test_an_overlap_is_no_lift_zero(drawn):
    found = verdict(table(drawn, ("stance_overlap",)))
    assert (found.verdict.status, found.verdict.effects) == ("identified", ("stance_overlap",))
    assert not re.search("(zero|speed-scale) error of", found.verdict.because)
    zero = next(one for one in found.to_dict()["nuisances"] if one["name"] == "lift_zero_m")
    assert abs(zero["value"]) < 3 * zero["stderr"]


def read_too_short(trials, share):
    along = ("speed_m_s", "peak_speed_m_s", "first_step_m")
    return dataclasses.replace(trials, **{column: getattr(trials, column) * (1 - share) for column in along})


def test_a_scale_a_little_off_is_granted(drawn):
    found = verdict(read_too_short(table(drawn), 0.015))
    assert found.verdict.status == "adequate"
    assert "a speed-scale error of" in found.verdict.because


def test_a_scale_that_no_calibration_is_off_by_explains_nothing(drawn):
    found = verdict(read_too_short(table(drawn), 0.08))
    assert found.verdict.status != "adequate"


def test_a_claim_beside_which_no_scale_is_believable_is_reported_beside_what_is(drawn):
    """All lengths 12 % too short: a slip, or a scale twelve times its prior off."""
    slip = {name: effect for name, effect in catalogue().items() if name == "leg_slip"}
    found = discover(cells_of(read_too_short(table(drawn), 0.12)), slip, max_effects=1)
    assert (found.verdict.status, found.verdict.effects) == ("identified", ("leg_slip",))
    assert found.fit.nuisances is not None


def test_a_bed_that_does_not_scatter_is_found_not_to(drawn):
    plain = fit(model_of("simple", (), OVERLAP), cells_of(drawn(seed=3)))
    assert not estimated_batch_sd(plain, DEFAULT)


def test_batches_and_order_of_a_table_are_those_of_its_cells(drawn):
    cells = cells_of(table(drawn, batch="day{row.omega_rad_s:g}"))
    assert cells.batch_share.shape == (len(cells), 7)
    np.testing.assert_allclose(cells.batch_share.sum(axis=1), 1.0)
    assert (cells.batch_share.max(axis=1) == 1.0).all()
    np.testing.assert_allclose(np.nansum(cells.batch_mean, axis=1), cells.mean)
    blocks = cells_of(table(drawn, batch="block{row.replicate:g}"))
    np.testing.assert_allclose(blocks.batch_share, 1 / 3)
    np.testing.assert_allclose(blocks.batch_mean.mean(axis=1), blocks.mean)
    assert (np.abs(cells.order) < 0.5).all()
    assert cells.without(0).batch_share.shape == (len(cells) - 1, 7)
    np.testing.assert_allclose(np.nansum(cells.batch_share * cells.batch_order, axis=1), cells.order)
    np.testing.assert_allclose(blocks.batch_order.mean(axis=1), blocks.order)
    np.testing.assert_array_equal(np.isfinite(cells.batch_order), cells.batch_share > 0)


@pytest.mark.parametrize("batch", ["", "only"])
def test_one_batch_or_none_is_no_batch(drawn, batch):
    assert cells_of(table(drawn, batch=batch)).batch_share is None


def test_no_order_told_is_none_known(drawn):
    cells = cells_of(drawn(levels=2))
    assert cells.order is None
    assert cells.batch_order is None


def test_nuisances_move_what_they_are_said_to_move(drawn):
    plain = fit(model_of("simple", (), OVERLAP), cells_of(table(drawn, batch="day{row.omega_rad_s:g}")))
    own = nuisances_for(plain, DEFAULT, BatchSd(0.005))
    assert own.names == (*[BATCH] * 7, "drift", "lift_zero_m", "speed_scale")
    zero = own.slope[:, :, own.names.index("lift_zero_m")]
    assert (zero[:, Observable.lift] == 1.0).all()
    assert not np.delete(zero, Observable.lift, axis=1).any()
    scale = own.slope[:, :, own.names.index("speed_scale")]
    np.testing.assert_array_equal(scale[:, Observable.speed], plain.predicted[:, Observable.speed])
    assert not scale[:, Observable.lift].any()
    # All batches at once are a change of every ln k.
    step = 1e-4
    point = dataclasses.replace(plain.point, ln_k=plain.point.ln_k + step)
    moved = fitted_at(plain.model, plain.cells, point).predicted - plain.predicted
    clear = own.slope[:, Observable.lift, :7].any(axis=1)
    clear &= plain.problem.widening(plain.state.covariance[0]) == 1.0  # no slope is that of a share that walks
    assert clear.any()
    np.testing.assert_allclose(moved[clear] / step, own.slope[clear, :, :7].sum(axis=-1), rtol=0.05, atol=2e-3)


def in_order_of(trials, key):
    """The same trials, run in the order of ``key``."""
    rows = sorted(trials.rows(), key=key)
    return cells_of(from_rows([dataclasses.replace(row, run_order=i + 1.0) for i, row in enumerate(rows)]))


@pytest.mark.parametrize(
    ("key", "told"),
    [
        (lambda row: row.omega_rad_s, "in order of ω, so a drift of the bed looks like a dependence on ω"),
        (lambda row: -row.phi, "in order of φ, so a drift of the bed looks like part of k(φ)"),
        (lambda row: (row.replicate, row.speed_m_s * 1e9 % 1), ""),
        (lambda row: row.speed_m_s * 1e9 % 1, ""),
    ],
    ids=["ω", "φ", "blocks", "random"],
)
def test_what_a_drift_looks_like_is_said_where_trials_were_run_in_order(drawn, key, told):
    assert confounded_drift(in_order_of(drawn(levels=4), key)).endswith(told)
    assert bool(told) == bool(confounded_drift(in_order_of(drawn(levels=4), key)))


ACCELERATION, RESPONSE = ("exact_vertical_acceleration",), ("phi_dependent_response",)


@pytest.mark.parametrize(("drift", "seed", "rivals"), [(-0.03, 20, {RESPONSE}), (0.0, 220, set())])
def test_a_claim_does_not_hide_what_fits_as_well_with_a_drift(monkeypatch, drift, seed, rivals):
    """In order of ω, k falls by 3 %: without a drift only another effect than the true one fits, with it both do."""
    walker, ground, rows = Walker((catalogue()[ACCELERATION[0]],)), _drawn.GROUND, []
    for day, omega in enumerate((6, 11, 16, 20, 24)):
        drifted = KCurve(ground.phi, ground.k_n_per_m * (1 + drift * day / 4))
        monkeypatch.setattr(_drawn, "GROUND", drifted)
        rows += _drawn.drawn(walker, [{}], [0.59, 0.61, 0.63], (omega,), 3, seed + day).rows()
    offered = {name: effect for name, effect in catalogue().items() if (name,) in (ACCELERATION, RESPONSE)}
    key = (lambda row: row.omega_rad_s) if drift else (lambda row: row.speed_m_s * 1e9 % 1)
    found = discover(in_order_of(from_rows(rows), key), offered, max_effects=1).verdict
    assert set(found.alternatives) == {ACCELERATION, *rivals}
    assert ("would be identified: phi_dependent_response" in found.because) == bool(rivals)


def test_a_drift_is_sought_from_both_sides_and_other_offsets_are_not(drawn):
    trials = table(drawn, batch="day{row.omega_rad_s:g}")
    plain = fit(model_of("simple", (), OVERLAP), cells_of(trials))
    own = nuisances_for(plain, DEFAULT, BatchSd(0.005))
    at = own.names.index("drift")
    np.testing.assert_allclose(own.starts[:, at], [0.0, -DEFAULT.drift, DEFAULT.drift])
    assert not np.delete(own.starts, at, axis=1).any()
    unordered = nuisances_for(fit(plain.model, cells_of(drawn(levels=2))), DEFAULT)
    np.testing.assert_array_equal(unordered.starts, [unordered.initial])


def wider(cells, off):
    """How much larger errors of Δt and k are that average over the bed's scatter; batches are ``off`` in ln k."""
    model = model_of("simple", (), OVERLAP)
    own = nuisances_for(fit(model, cells), DEFAULT, BatchSd(0.005))
    by_ln_k = own.slope[:, :, [name == BATCH for name in own.names]].sum(axis=-1)
    mean = cells.mean + by_ln_k * (cells.batch_share @ off)[:, None]
    moved = dataclasses.replace(cells, mean=mean, batch_mean=cells.batch_mean + by_ln_k[:, None] * off[:, None])
    plain = fit(model, moved)
    beside = fitted_at(model, moved, plain.point, nuisances_for(plain, DEFAULT))
    averaged = averaged_over_scatter(beside, DEFAULT)
    assert averaged.point is beside.point
    ratio = averaged.stderr / beside.stderr
    return ratio[0], np.nanmax(ratio[2:])


def test_one_frequency_a_day_costs_what_only_days_tell(drawn):
    cells = cells_of(table(drawn, batch="day{row.omega_rad_s:g}"))
    assert wider(cells, np.array([5, -4, 3, -6, 2, 6, -5]) * 1e-3)[0] > 1.5


def test_blocks_tell_how_far_they_differ(drawn):
    """They cost Δt nothing, and k what they differ. Where all walk: beside a switch errors are those of a sample."""
    cells = cells_of(table(drawn, batch="block{row.replicate:g}"))
    cells = cells.without(np.flatnonzero(cells.level_phi[cells.level] < 0.59))
    assert max(wider(cells, np.zeros(3))) < 1.15
    delta_t, k = wider(cells, np.array([-1, 0, 1]) * 6e-3)
    assert delta_t < 1.1
    assert k > 1.5


def block_by_block(row):
    return row.replicate, row.omega_rad_s, row.phi


def drifting(drift, key, zeros_m=(0.0, 0.0, 0.0)):
    """A base model's fit, beside its nuisances, to trials run in the order of ``key`` while k grew by ``drift``; each
    replicate's block has a lift zero of its own."""
    grid = np.meshgrid((0.59, 0.605, 0.62), (6, 9, 12, 15, 18, 21, 24), np.arange(3), indexing="ij")
    phi, omega, replicate = (axis.ravel().astype(float) for axis in grid)
    rows = _drawn.table(phi, omega, replicate, np.zeros((len(phi), 4))).rows()
    place = np.argsort(sorted(range(len(rows)), key=lambda trial: key(rows[trial])))
    k = _drawn.GROUND(phi) * (1 + drift * place / (len(rows) - 1))
    seen = predicted(Walker(()), Inputs(k, omega, _drawn.DELTA_T_S, phi), [], _drawn.GROUND).observables
    seen[:, Observable.lift] += np.array(zeros_m)[replicate.astype(int)]
    noise = 0.4 * _drawn.NOISE * np.random.default_rng(1).normal(size=seen.shape)
    rows = _drawn.table(phi, omega, replicate, seen + noise).rows()
    rows = [
        dataclasses.replace(row, batch=f"block{row.replicate:g}", run_order=at + 1.0)
        for row, at in zip(rows, place.tolist(), strict=True)
    ]
    plain = fit(model_of("simple", (), OVERLAP), cells_of(from_rows(rows)))
    return refitted(plain, nuisances_for(plain, DEFAULT))


def drift_of(fit):
    return fit.shared[fit.nuisances.names.index("drift")].value


@pytest.mark.parametrize("drift", [0.0, 0.04])
@pytest.mark.parametrize("zeros_m", [(0.0, 0.0, 0.0), (-4e-4, 3e-4, 5e-4)])
def test_replicates_of_other_blocks_tell_a_drift_from_a_response(drift, zeros_m):
    """In order of ω a drift looks like another Δt, but the second block begins where the first has ended."""
    beside = drifting(drift, block_by_block, zeros_m)
    informed = averaged_over_scatter(beside, DEFAULT)
    before, after = beside.parameters["delta_t_s"], informed.parameters["delta_t_s"]
    assert after.stderr < 0.5 * before.stderr
    assert abs(after.value - _drawn.DELTA_T_S) < 2 * after.stderr
    assert drift_of(informed) == pytest.approx(drift, abs=0.015)
    # Control: what cell means alone tell.
    if drift:
        assert abs(drift_of(beside)) < 0.015


@pytest.mark.parametrize(
    "key",
    [
        lambda row: (row.omega_rad_s, row.phi, row.replicate),  # those of a condition in a row
        lambda row: (row.replicate, (997 * row.phi + 31.7 * row.omega_rad_s) % 1),  # in no order: a drift costs nothing
    ],
)
def test_replicates_that_tell_no_drift_change_nothing(key):
    beside = drifting(0.0, key)
    averaged = averaged_over_scatter(beside, DEFAULT)
    assert averaged.point is beside.point
    assert averaged.stderr[0] > 0.9 * beside.stderr[0]


def test_a_drift_that_cell_means_contradict_is_not_reported(monkeypatch):
    """After a jump the replicates may tell of a drift that is none."""
    beside = drifting(0.0, block_by_block)
    monkeypatch.setattr(nuisances_about, "_drift_of_replicates", lambda *_: Estimate(1.0, 1e-3))
    assert averaged_over_scatter(beside, DEFAULT).point is beside.point


def test_a_cell_near_a_switch_does_not_tell_how_far_blocks_differ(drawn):
    """Its slope by k, which holds for a tiny change only, would by itself tell that they are alike."""
    plain = fit(model_of("simple", (), OVERLAP), cells_of(table(drawn, batch="block{row.replicate:g}")))
    clear = plain.problem.away_from_switch(plain.problem.widening(plain.state.covariance[0]))
    assert clear.any()
    assert not clear.all()

    def error(where):
        apart = plain.cells.batch_mean + 0.02 * where[:, None, None] * np.array([-1.0, 0.0, 1.0])[:, None]
        cells = dataclasses.replace(plain.cells, batch_mean=apart)
        return averaged_over_scatter(fitted_at(plain.model, cells, plain.point, nuisances_for(plain, DEFAULT)), DEFAULT)

    as_they_are = error(np.zeros(len(clear)))
    np.testing.assert_array_equal(error(~clear).stderr, as_they_are.stderr)
    # Control: any other cell does.
    assert (error(clear).stderr[2:] > 1.2 * as_they_are.stderr[2:]).any()


def test_the_offsets_of_all_batches_are_one_line_of_the_json(drawn):
    plain = fit(model_of("simple", (), OVERLAP), cells_of(table(drawn, batch="day{row.omega_rad_s:g}")))
    beside = fitted_at(plain.model, plain.cells, plain.point, nuisances_for(plain, DEFAULT, BatchSd(0.005)))
    batches, *others = beside.nuisances_to_dict()
    assert (batches["name"], batches["count"], batches["prior_sd"], batches["stderr"]) == (BATCH, 7, 0.005, None)
    offsets = [value for value, _ in beside.shared[:7]]
    assert batches["value"] == pytest.approx(np.sqrt(np.mean(np.square(offsets))))
    assert [one["name"] for one in others] == ["drift", "lift_zero_m", "speed_scale"]
    assert plain.nuisances_to_dict() == []


@pytest.mark.parametrize(("batch", "told"), [("", True), ("day{row.omega_rad_s:g}", False)])
def test_offsets_that_grow_with_the_frequency_are_no_scatter(drawn, batch, told):
    """Of one offset a condition; seven days that scatter may do so too."""
    plain = fit(model_of("simple", (), OVERLAP), cells_of(table(drawn, batch=batch)))
    own = nuisances_for(plain, DEFAULT, BatchSd(0.005))
    assert trend_p_of(fitted_at(plain.model, plain.cells, plain.point, own), DEFAULT, BATCH) > STRUCTURE
    omega = (plain.cells.omega - 15) / 15
    slope = own.slope[:, :, [name == BATCH for name in own.names]].sum(axis=2)
    cells = dataclasses.replace(plain.cells, mean=plain.cells.mean + slope * (0.07 * omega**2)[:, None])
    found = trend_p_of(fitted_at(plain.model, cells, plain.point, own), DEFAULT, BATCH)
    assert (found < STRUCTURE) == told
    assert at_random(plain, DEFAULT)


@pytest.mark.parametrize(("gaits", "told"), [(("UNIFORM", "SGCS"), True), (("UNIFORM", "UNIFORM"), False)])
def test_offsets_from_gait_to_gait_are_no_scatter(drawn, gaits, told):
    """In every other cell, so that nothing but the gait tells; control: of one gait they may be the bed's."""
    plain = fit(model_of("simple", (), OVERLAP), cells_of(table(drawn, batch="")))
    own = nuisances_for(plain, DEFAULT, BatchSd(0.01))
    every_other = np.arange(len(plain.cells)) % 2
    by_cell = own.slope[:, :, [name == BATCH for name in own.names]]
    cells = dataclasses.replace(
        plain.cells, mean=plain.cells.mean + by_cell @ (0.04 * every_other), gait=tuple(gaits[i] for i in every_other)
    )
    assert (trend_p_of(fitted_at(plain.model, cells, plain.point, own), DEFAULT, BATCH) < STRUCTURE) == told


def test_blocks_without_an_order_follow_no_trend(drawn):
    cells = dataclasses.replace(cells_of(table(drawn, batch="block{row.replicate:g}")), order=None)
    plain = fit(model_of("simple", (), OVERLAP), cells)
    beside = fitted_at(plain.model, cells, plain.point, nuisances_for(plain, DEFAULT, BatchSd(0.005)))
    assert np.isnan(trend_p_of(beside, DEFAULT, BATCH))
    assert at_random(beside, DEFAULT)


def test_offsets_that_are_smooth_are_no_scatter(drawn):
    """A resonance is no trend of second order over φ and ω, but it is smooth."""
    plain = fit(model_of("simple", (), OVERLAP), cells_of(table(drawn, batch="")))
    own = nuisances_for(plain, DEFAULT, BatchSd(0.01))
    by_cell = own.slope[:, :, [name == BATCH for name in own.names]]
    scattered = 0.02 * np.random.default_rng(1).standard_normal(len(plain.cells))
    resonant = 0.06 * np.exp(-0.5 * ((plain.cells.omega - 12) / 4) ** 2)
    found = []
    for offsets in (scattered, resonant):
        cells = dataclasses.replace(plain.cells, mean=plain.cells.mean + by_cell @ offsets)
        found.append(fitted_at(plain.model, cells, plain.point, own))
    assert at_random(found[0], DEFAULT)
    assert smooth_p(found[0], DEFAULT, BATCH) > STRUCTURE > smooth_p(found[1], DEFAULT, BATCH)
    assert not at_random(found[1], DEFAULT)


def test_a_fit_in_another_valley_is_brought_to_the_deepest_where_legs_meet_what_was_left(drawn):
    effects, cells = catalogue(), cells_of(table(drawn, batch="day{row.omega_rad_s:g}"))
    plain = fit(model_of("simple", ("disturbed_ground",), effects), cells)
    off = dataclasses.replace(plain.point, theta=plain.point.theta * [1.3, 1.0, 1.0, 1.0])
    astray = fitted_at(plain.model, cells, off, nuisances_for(plain, DEFAULT, BatchSd(0.005)))
    assert refitted_globally(astray).deviance < astray.deviance - 10
    base = fit(model_of("simple", (), effects), cells)
    for stays in (base, fitted_at(base.model, cells, base.point, nuisances_for(base, DEFAULT, BatchSd(0.005)))):
        assert refitted_globally(stays) is stays


def test_rivals_of_a_claim_differ_from_it_in_one_effect_and_are_the_best():
    bic = {("a",): 0.0, ("a", "b"): 9.0, ("a", "c"): 4.0, ("b", "d"): 2.0, ("b", "e"): 3.0, ("c", "d"): 1.0}
    fits = {names: SimpleNamespace(bic=value) for names, value in bic.items()}
    assert _nearest_rivals(fits, ("a", "b")) == [("b", "d"), ("b", "e")]
    assert _nearest_rivals(fits, ("a",)) == []


@pytest.mark.parametrize(("names", "batch_sd", "rivals"), [
    (("a", "b"), BatchSd(0.007), True), (("a", "b"), BatchSd(0.0), False), (("a",), BatchSd(0.007), False),
])  # fmt: skip
def test_rivals_are_refitted_beside_several_effects_with_offsets_of_k_alone(monkeypatch, names, batch_sd, rivals):
    asked = []
    monkeypatch.setattr(
        sharing, "_improved", lambda _search, _fits, _names, others, *_: asked.append(list(others)) or {}
    )
    fits = {key: SimpleNamespace(bic=0.0) for key in (("a",), ("b",), ("a", "b"), ("a", "c"))}
    assert _improved_beside(SimpleNamespace(criteria=DEFAULT), fits, names, batch_sd) == {}
    assert (len(asked) > 1) == rivals
    assert not rivals or asked[1] == [("a", "b"), ("a", "c")]
