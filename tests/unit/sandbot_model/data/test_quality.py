"""What is odd about trials is said, what can't be is refused, and clean trials give no note."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sandbot_common.errors import InputError
from sandbot_common.robot import Robot
from sandbot_lab.direct import direct_trials
from sandbot_lab.week import Week
from sandbot_lab.world import World, draw_world, null_world
from sandbot_model.data import quality
from sandbot_model.data.clustering import conditions
from sandbot_model.data.quality import checked, trend
from sandbot_model.physics.observables import Observable
from sandbot_record.trials.table import Row, from_rows

PHI, OMEGA = np.linspace(0.58, 0.633, 5).tolist(), [6.0, 10.0, 14.0, 20.0]


def trials(world=None, seed=1, **how):
    how = {"order": "randomised", "batches": "replicate", **how}
    return from_rows([Row(**row) for row in direct_trials(world or null_world(), PHI, OMEGA, seed=seed, **how)])


CLEAN = trials()


def changed(column, rows, values):
    column_values = getattr(CLEAN, column).copy()
    column_values[rows] = values
    return replace(CLEAN, **{column: column_values})


@pytest.mark.parametrize("seed", range(6))
def test_clean_trials_give_no_note(seed):
    assert checked(trials(seed=seed)) == ()
    assert checked(trials(draw_world(seed), seed)) == ()


def test_where_no_trial_is_usable_that_is_said():
    """Of a table that is no file, too: read() refuses one that is."""
    with pytest.raises(InputError, match=r"^data: no usable trial among 60: .* has status 'good'"):
        checked(replace(CLEAN, status=np.full(len(CLEAN), "good")), "data")


def test_a_trial_without_a_speed_is_left_out_and_named_most_trials_are_not():
    some, most = np.arange(2), np.arange(len(CLEAN)) > 10
    (note,) = checked(changed("speed_m_s", some, np.nan))
    assert note == f"2 trials are left out, as no speed_m_s is given: {CLEAN.trial_id[0]}, {CLEAN.trial_id[1]}"
    with pytest.raises(InputError, match=r"^data: speed_m_s is not given in 49 of 60 trials: .* and 44 more; it is"):
        checked(changed("speed_m_s", most, np.nan), "data")
    failed = np.where(most, "failed", CLEAN.status)
    assert not any("speed_m_s is" in note for note in checked(replace(CLEAN, status=failed)))


def test_a_trial_far_out_is_named():
    (note,) = checked(changed("lift_m", 7, CLEAN.lift_m[7] + 0.005))
    assert note.startswith("lift_m far from every other replicate")
    assert CLEAN.trial_id[7] in note


def test_where_noise_grows_with_the_speed_a_fast_trial_is_not_far_out():
    """Nor is a slow one where it does not; both where it is far by either measure."""
    rng = np.random.default_rng(0)
    for noise in (0.01 * CLEAN.peak_speed_m_s, np.full(len(CLEAN), 0.002)):
        cell, _ = conditions(CLEAN.phi, CLEAN.gait, CLEAN.omega_rad_s)
        mean = np.array([CLEAN.peak_speed_m_s[cell == one].mean() for one in cell])
        even = mean + noise * np.tile([-1.0, 0.0, 1.0], len(CLEAN) // 3)[rng.permutation(len(CLEAN))]
        assert not any("far" in note for note in checked(changed("peak_speed_m_s", slice(None), even)))
        odd = even + np.where(np.arange(len(CLEAN)) == int(np.argmax(mean)), 0.3, 0.0)
        assert any(
            note.startswith("peak_speed_m_s far") for note in checked(changed("peak_speed_m_s", slice(None), odd))
        )


@pytest.mark.parametrize("every", [2, 3, 5])
def test_runs_there_and_back_are_refused(every):
    """They scatter by twice their speed, and any model held."""
    back = CLEAN.speed_m_s * np.where(np.arange(len(CLEAN)) % every, 1, -1)
    with pytest.raises(InputError, match=r"^day1.csv: speed_m_s is -.* runs backwards\? then multiply by -1"):
        checked(replace(CLEAN, speed_m_s=back), "day1.csv")


def test_a_few_below_0_and_swimmers_about_0_are_no_runs_back():
    """Control: trials that were lost by the tracker are outliers, and who hardly moves may be read as moving back."""
    checked(changed("speed_m_s", [3, 40], [-0.2, -0.2]))
    checked(changed("peak_speed_m_s", [9], [-0.2]).select(np.arange(6, 10)))
    checked(replace(CLEAN, speed_m_s=np.where(CLEAN.omega_rad_s > 15, -0.004, CLEAN.speed_m_s)))
    stuck = np.random.default_rng(1).normal(1e-3, 3e-3, len(CLEAN))
    checked(replace(CLEAN, speed_m_s=stuck, peak_speed_m_s=np.abs(CLEAN.peak_speed_m_s)))


def test_an_error_bar_of_0_is_named_where_it_would_be_used():
    means = replace(
        CLEAN, replicate=np.full(len(CLEAN), np.nan), speed_sd_m_s=np.where(np.arange(len(CLEAN)), 0.004, 0.0)
    )
    (note,) = checked(means)
    assert note == f"1 speed_sd_m_s is 0 and counts as not given: {CLEAN.trial_id[0]}"
    assert checked(replace(means, replicate=CLEAN.replicate)) == ()


def test_a_number_of_the_row_is_no_number_of_trials():
    numbered = replace(
        CLEAN,
        speed_sem_m_s=np.full(len(CLEAN), 0.004),
        n_trials=np.arange(len(CLEAN)) + 1.0,
        replicate=np.full(len(CLEAN), np.nan),
    )
    with pytest.raises(InputError, match="n_trials counts from 1 to 60, row by row"):
        checked(numbered)
    assert checked(replace(numbered, n_trials=np.full(len(CLEAN), 3.0))) == ()


def rounded(found, decimals=4):
    """The table as written by hand: set-points of φ, and values to so many decimals."""
    values = {o.column: np.round(getattr(found, o.column), decimals) for o in Observable}
    return replace(found, phi=np.round(found.phi, 2), **values)


def with_means(found, columns, decimals=4):
    """The table and a row of means of each condition, of these columns."""
    cell, _ = conditions(found.phi, found.gait, found.omega_rad_s)
    means = [replace(found.rows()[int(np.flatnonzero(cell == one)[0])], trial_id=f"m{one}") for one in np.unique(cell)]
    for one, row in enumerate(means):
        empty = {o.column: np.nan for o in Observable}
        own = {column: round(float(getattr(found, column)[cell == one].mean()), decimals) for column in columns}
        means[one] = replace(row, **{**empty, **own})
    return from_rows([*found.rows(), *means])


@pytest.mark.parametrize("columns", [["speed_m_s"], ["speed_m_s", "lift_m"]])
@pytest.mark.parametrize("decimals", [4, 16])
def test_a_mean_in_every_condition_is_no_trial(columns, decimals):
    """Read as trials, means made replicates scatter too little, and the true model failed."""
    table = rounded(trials(order="as_listed"))
    with pytest.raises(InputError, match="row that is the mean of its others: m0, m1, m2, m3, m4 and 15 more"):
        checked(with_means(table, columns, decimals))
    # Control: where one of the conditions has none, it may be a trial.
    mixed = with_means(table, columns, decimals)
    mixed.speed_m_s[-1] += 0.01
    checked(mixed)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("decimals", [2, 3, 4])
@pytest.mark.parametrize("conditions_kept", [1, 2, 20])
def test_trials_that_rounding_makes_equal_to_a_mean_are_trials(seed, decimals, conditions_kept):
    table = rounded(trials(seed=seed, order="as_listed"), decimals)
    checked(table.select(np.arange(3 * conditions_kept)))


def test_a_last_row_of_column_means_is_no_trial():
    table = rounded(trials(order="as_listed"))
    mean = {name: float(getattr(table, name).mean()) for name in ("phi", "omega_rad_s", "speed_m_s", "lift_m")}
    last = Row("last", gait=table.gait[0], batch=table.batch[0], run_order=61.0, **mean)
    with pytest.raises(InputError, match="last is the mean of all other rows in every column"):
        checked(from_rows([*table.rows(), last]))
    # Control: a condition in the middle of the design, of which only the speed is the mean, or nothing but the place.
    for other in (replace(last, lift_m=mean["lift_m"] + 0.002), replace(last, speed_m_s=mean["speed_m_s"] + 0.01)):
        checked(from_rows([*table.rows(), other]))


@pytest.mark.parametrize("column", ["speed_m_s", "lift_m", "first_step_m"])
def test_a_0_of_a_trial_that_walked_is_named(column):
    fast = CLEAN.speed_m_s > 0.15
    notes = checked(changed(column, np.flatnonzero(fast)[::3], 0.0))
    count = len(np.flatnonzero(fast)[::3])
    assert any(f"{count} of 60 {column} are exactly 0 though {count} of these trials walked" in note for note in notes)


def test_an_end_of_the_reading_that_many_walkers_share_is_named():
    """A ruler that ends at 7 mm, and one that shows no less than 4 mm."""
    for lift, value in (
        (np.minimum(CLEAN.lift_m, 0.007), "0.007, its largest"),
        (np.maximum(CLEAN.lift_m, 0.004), "0.004, its smallest"),
    ):
        notes = checked(replace(CLEAN, lift_m=lift))
        assert any(f"lift_m is {value} value, in" in note for note in notes)


def test_heights_of_the_axles_in_place_of_lifts_are_named():
    heights = replace(CLEAN, lift_m=CLEAN.lift_m + 0.025)
    assert any("is it the height of the axles, 0.025 at rest?" in note for note in checked(heights))
    # Controls: strong ground on which a body does rise so high, at the speed that belongs to it; and a lost step.
    strong = trials(World(k_knots_n_per_m=(700.0, 800.0, 900.0)))
    assert strong.lift_m.min() > 0.025
    assert checked(strong) == ()
    assert checked(replace(strong, speed_m_s=0.75 * strong.speed_m_s)) == ()


def test_rounding_is_no_end_of_the_reading():
    rounded = checked(replace(CLEAN, lift_m=np.round(CLEAN.lift_m, 3), speed_m_s=np.round(CLEAN.speed_m_s, 2)))
    assert not any("does the reading end there" in note for note in rounded)


def test_a_lift_of_0_of_a_swimmer_is_none_to_name():
    assert checked(changed("lift_m", CLEAN.speed_m_s < 0.03, 0.0)) == ()


def test_a_status_that_may_mean_ok_is_named():
    def of_status(word):
        return replace(CLEAN, status=np.where(np.arange(len(CLEAN)) < 2, word, CLEAN.status))

    assert checked(of_status("Good")) == ("2 trials are left out because of their status, Good: only ok is used",)
    assert checked(of_status("0"))[0].endswith("their status, 0: only ok is used")
    assert checked(of_status("slipped")) == ()


def test_trials_without_a_gait_among_others_are_named():
    (note,) = checked(changed("gait", slice(3), ""))
    assert note.startswith("3 trials name no gait")


def test_legs_of_no_such_robot_are_named():
    fast = replace(CLEAN, omega_rad_s=CLEAN.omega_rad_s * 30 / np.pi)
    assert any("is it in rpm" in note for note in checked(fast))


def test_a_peak_of_0_for_not_measured_is_named():
    assert any("1 peak_speed_m_s of trials that moved" in note for note in checked(changed("peak_speed_m_s", 7, 0.0)))


def test_trials_without_a_batch_among_others_are_named():
    (note,) = checked(changed("batch", [3, 4], ""))
    assert note.startswith("2 trials name no batch")
    assert CLEAN.trial_id[3] in note
    assert checked(changed("batch", slice(None), "")) == ()


def test_an_order_that_is_not_told_of_all_is_named():
    (note,) = checked(changed("run_order", [5], np.nan))
    assert note == f"the run order is not used, for 1 of {len(CLEAN)} trials have none: {CLEAN.trial_id[5]}"
    nobody = changed("run_order", slice(None), np.nan)
    assert checked(nobody) == ()
    told = replace(nobody, started=np.full(len(CLEAN), "at noon", dtype=object))
    (note,) = checked(told)
    assert note.startswith(f"started gives no order: 'at noon' in {CLEAN.trial_id[0]} is not like 2026-05-04T08:10")
    (note,) = checked(changed("run_order", slice(None), 1.0))
    assert note == "run_order (or started) is the same in all trials and gives no order"


def test_zeros_for_not_measured_are_named():
    assert any("first_step_m are exactly 0" in note for note in checked(changed("first_step_m", slice(0, 40), 0.0)))


def swimmers(lifts):
    """The table with these lifts, again and again, of the trials that swam."""
    swam = CLEAN.lift_m < 0.0015
    return replace(CLEAN, lift_m=np.where(swam, np.resize(lifts, len(CLEAN)), CLEAN.lift_m))


def test_lifts_of_swimmers_that_are_cut_off_at_0_are_named():
    """Controls: as read, some are negative; read to 1 mm, nearly all of them are 0."""
    cut = swimmers(np.maximum(1e-3 * np.random.default_rng(0).standard_normal(len(CLEAN)), 0.0))
    assert any("never below, as if negative readings were set to 0" in note for note in checked(cut))
    for lifts in (1e-3 * np.random.default_rng(0).standard_normal(len(CLEAN)), [0.0]):
        some = swimmers(lifts)
        some = replace(some, lift_m=np.round(some.lift_m, 3)) if len(lifts) == 1 else some
        assert not any("lift_m is exactly 0" in note or "are exactly 0" in note for note in checked(some))


@pytest.mark.parametrize("lift", [0.0711, 0.096])
def test_lifts_beyond_any_leg_are_judged_without_a_warning(lift):
    rows = [Row(f"t{i}", phi=0.6, omega_rad_s=4.0, speed_m_s=0.1, lift_m=at) for i, at in enumerate((lift, 0.04, 0.04))]
    assert not any("height of the axles" in note for note in checked(from_rows(rows)))


def test_coarse_rounding_is_named():
    assert any(
        "speed_m_s is rounded to 0.02" in note
        for note in checked(replace(CLEAN, speed_m_s=np.round(CLEAN.speed_m_s * 50) / 50))
    )
    assert checked(replace(CLEAN, speed_m_s=np.round(CLEAN.speed_m_s, 4))) == ()


def test_a_continuous_phi_is_named():
    rng = np.random.default_rng(0)
    phi = np.where(CLEAN.phi < 0.6, rng.uniform(0.575, 0.605, len(CLEAN)), CLEAN.phi)
    assert any("no clear levels" in note for note in checked(replace(CLEAN, phi=phi)))


def test_a_drift_is_named_and_none_is_seen_where_there_is_none():
    drifting = World(week=Week(k_drift=0.10))
    assert any("lift_m drifts along the run order" in note for note in checked(trials(drifting)))
    # Replicates in a row can't show it: the trend is then one of φ and ω.
    rng = np.random.default_rng(0)
    cell, order = np.repeat(np.arange(30), 3), rng.permutation(90).astype(float)
    p = [trend(rng.normal(size=90), order, cell)[1] for _ in range(400)]
    assert np.mean(np.array(p) < 0.05) == pytest.approx(0.05, abs=0.035)
    assert np.isnan(trend(rng.normal(size=30), order[:30], np.arange(30))[1])


@pytest.mark.parametrize(
    ("odd", "words"),
    [
        (replace(CLEAN, omega_rad_s=CLEAN.omega_rad_s / (2 * np.pi)), "is omega in Hz"),
        (replace(CLEAN, speed_m_s=CLEAN.speed_m_s * 100), "the speed in cm/s"),
        (
            replace(CLEAN, first_step_m=CLEAN.first_step_m * 100),
            r"reach 0.071 m at most \(2R\); is the first step in cm",
        ),
        (
            replace(CLEAN, lift_m=CLEAN.lift_m * 100),
            r"reach 0.046 m at most \(2R - h\); is the lift in cm \(divided by 100",
        ),
        (
            replace(CLEAN, peak_speed_m_s=CLEAN.peak_speed_m_s * 10),
            r"Rω at the fastest .* is omega .* the peak speed in",
        ),
        (replace(CLEAN, phi=1 - CLEAN.phi), "is it the porosity"),
        (changed("phi", 7, 0.058), f"phi is 0.058 in {CLEAN.trial_id[7]}.* 0.5 to 0.7 of the volume$"),
        (replace(CLEAN, peak_speed_m_s=0.5 * CLEAN.speed_m_s), "are the columns exchanged"),
        (replace(CLEAN, speed_sd_m_s=np.full(len(CLEAN), 0.5)), "speed_sd_m_s is 0.5 in .*, more than any speed"),
        (
            replace(CLEAN, speed_m_s=-CLEAN.speed_m_s),
            f"below 0 in {len(CLEAN)} of {len(CLEAN)}: does its axis point the way the robot walks",
        ),
        (replace(CLEAN, lift_m=-CLEAN.lift_m), "lift_m is -0.0.* does its axis point up"),
    ],
)
def test_what_cannot_be_is_refused(odd, words):
    with pytest.raises(InputError, match=words) as refusal:
        checked(odd)
    assert "\n" not in str(refusal.value)


def test_a_single_value_that_cannot_be_is_named_and_not_refused():
    (note, *_) = checked(changed("first_step_m", 7, 4.0))
    assert note.startswith(
        f"1 impossible first_step_m: first_step_m is 4 in {CLEAN.trial_id[7]}, where legs of 0.0355 m"
    )


def test_a_swimmer_that_rises_by_less_than_the_zero_is_off_is_no_mirror_image():
    notes = checked(replace(CLEAN, lift_m=np.minimum(CLEAN.lift_m, 2e-4) - 1e-3))
    assert not [note for note in notes if "axis" in note]


def test_a_body_that_coasts_beyond_its_step_is_possible():
    far = direct_trials(World(effects={"belly_coast": {"mu_b": 0.3}}), [0.633], [24.0, 30.0], replicates=3, seed=1)
    coasting = from_rows([Row(**row) for row in far])
    assert (coasting.speed_m_s > 1.25 * 2 * 0.0355 * coasting.omega_rad_s / np.pi).any()
    assert not [note for note in checked(coasting) if "impossible" in note]


def test_what_another_robot_can_do_is_named_and_not_refused():
    # Legs 1.5 times as long: the table is right, the robot is not the one it was taken to be.
    longer = {name: 1.5 * getattr(CLEAN, name) for name in ("lift_m", "speed_m_s", "peak_speed_m_s", "first_step_m")}
    notes = checked(replace(CLEAN, **longer))
    assert all("--robot FILE.yaml" in note for note in notes)
    assert notes
    assert checked(replace(CLEAN, robot=Robot(leg_radius_m=1.5 * 0.0355, axle_height_m=1.5 * 0.025), **longer)) == ()


numbers = st.floats(-1, 1) | st.just(np.nan)


@settings(max_examples=80, deadline=None)
@given(st.lists(st.tuples(st.floats(0.5, 0.7), st.floats(1, 40), numbers, numbers), min_size=1, max_size=12))
def test_any_table_gives_notes_or_one_line(rows):
    table = from_rows(
        [Row(f"t{i}", phi=a, omega_rad_s=b, speed_m_s=c, lift_m=d, run_order=i) for i, (a, b, c, d) in enumerate(rows)]
    )
    if table.usable.any():
        try:
            notes = checked(table)
        except InputError as error:
            notes = (str(error),)
        assert not any("\n" in note for note in notes)


def test_very_many_trials_of_a_cell_are_compared_in_little_memory():
    own = np.random.default_rng(2).normal(0.0, 1.0, 20_000)
    tracemalloc.start()
    gaps, nearest = quality._gaps(own), quality._nearest(np.append(own, 50.0))
    largest = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert largest < 100e6  # all pairs would be 200 million
    assert np.median(gaps) == pytest.approx(0.6745 * np.sqrt(2), rel=0.01)
    assert nearest.argmax() == len(own)
    few = own[:50]
    gap = np.abs(few[:, None] - few)
    assert sorted(quality._gaps(few)) == sorted(gap[np.triu_indices(50, 1)].tolist())
    np.fill_diagonal(gap, np.inf)
    assert (quality._nearest(few) == gap.min(axis=1)).all()
