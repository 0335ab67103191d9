"""A trial that is there twice is one trial; replicates that rounding makes alike are not."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sandbot_record.trials.copies import mark_copies
from sandbot_record.trials.csv_table import to_csv
from sandbot_record.trials.frame import from_frame
from sandbot_record.trials.read import read
from sandbot_record.trials.same_trials import Table, same_trials
from sandbot_record.trials.table import Row, from_rows


def table(seed=1, *, phi=(0.6, 0.62), decimals=9, replicates=3, scatter=0.005, missed=0.0):
    """Trials of these set-points of φ, met within ``missed``, at two frequencies; the speed as it was rounded."""
    random = np.random.default_rng(seed)
    return [
        Row(trial_id=f"{level}_{omega}_{number}", phi=level + round(random.normal(0, missed), 6), omega_rad_s=omega,
            speed_m_s=round(0.02 * omega + random.normal(0, scatter), decimals))
        for level in phi
        for omega in (8.0, 12.0)
        for number in range(replicates)
    ]  # fmt: skip


def pasted(rows, times=2):
    """The same below each other, with names that nobody has twice."""
    return [replace(row, trial_id=f"{row.trial_id}_{time}") for time in range(times) for row in rows]


def copies(rows):
    return [row.trial_id for row in mark_copies(rows)[0] if row.status.startswith("a copy of ")]


@pytest.mark.parametrize("times", [2, 3])
@pytest.mark.parametrize("how", [{}, {"decimals": 3}, {"decimals": 2, "replicates": 1, "missed": 1e-3}])
def test_of_a_table_that_was_pasted_several_times_each_trial_counts_once(how, times):
    rows = table(**how)
    found, said = mark_copies(pasted(rows, times))
    counted = [replace(row, trial_id=row.trial_id[:-2]) for row in found if row.status == "ok"]
    assert sorted(counted, key=str) == sorted(rows, key=str)
    assert said[0].startswith(f"{(times - 1) * len(rows)} trials are exact copies of others and counted once: ")


def test_a_single_copy_is_known_by_its_many_digits_whatever_else_is_said_of_it():
    rows = table()
    rows = [replace(row, lift_m=row.speed_m_s / 7) for row in rows]
    again = replace(rows[2], trial_id="again", replicate=4.0, batch="Tue", peak_speed_m_s=float("nan"))
    found, said = mark_copies([*rows, again])
    assert found[:-1] == rows
    assert found[-1].status == f"a copy of {rows[2].trial_id}"
    assert said == [f"1 trial is an exact copy of another and counted once: again = {rows[2].trial_id}"]


def test_a_metre_by_the_stopwatch_has_many_digits_and_is_no_copy():
    rows = [replace(row, speed_m_s=1 / round(1 / row.speed_m_s, 1), lift_m=0.012) for row in table(replicates=9)]
    assert len({row.speed_m_s for row in rows}) < len(rows)
    assert copies(rows) == []


@settings(max_examples=50)
@given(st.integers(0, 10**6), st.integers(2, 4), st.sampled_from([1e-3, 5e-3]))
def test_replicates_that_rounding_makes_alike_are_replicates(seed, decimals, scatter):
    assert copies(table(seed, decimals=decimals, replicates=5, scatter=scatter)) == []


def test_where_rounding_hides_all_scatter_nobody_knows():
    """Each set-point has one row, twice: pasted, or replicates that agree."""
    assert copies(pasted(table(decimals=2, replicates=1))) == []


SIX_PHI = (0.58, 0.59, 0.6, 0.61, 0.62, 0.63)


@pytest.mark.parametrize("missed", [0.0, 4e-4])
@pytest.mark.parametrize("seed", range(5))
def test_of_a_few_rows_pasted_again_each_counts_once_although_rounded(seed, missed):
    rows = [replace(row, phi=round(row.phi, 4)) for row in table(seed, phi=SIX_PHI, decimals=4, missed=missed)]
    again = [replace(row, trial_id=f"again{n}") for n, row in enumerate(rows[3:18])]
    assert copies([*rows, *again]) == [row.trial_id for row in again]


def test_of_rows_in_which_little_is_measured_those_in_between_are_copies_too():
    """A robot that does not lift itself has a lift of 0 in each replicate, and hardly moves."""
    stuck = table(phi=(0.57,), decimals=2, scatter=0.0, replicates=3)
    rows = [*table(phi=SIX_PHI[:3], decimals=4), *stuck, *table(phi=SIX_PHI[3:], decimals=4)]
    again = [replace(row, trial_id=f"again{n}") for n, row in enumerate(rows[6:30])]
    assert copies([*rows, *again]) == [row.trial_id for row in again]
    assert copies([*rows, *(replace(row, trial_id=f"again{row.trial_id}") for row in stuck)]) == []


@pytest.mark.parametrize("scatter", [0.0, 3e-4])
@pytest.mark.parametrize("replicates", [2, 3, 6])
def test_days_on_one_plan_of_which_many_rows_agree_are_no_copies(replicates, scatter):
    """A robot that repeats itself better than the speeds are rounded: each day is as a copy of the day before."""
    days = [table(day, phi=SIX_PHI, decimals=3, replicates=1, scatter=scatter) for day in range(replicates)]
    changed = replace(days[0][0], trial_id="first", speed_m_s=0.123)
    assert copies([changed, *(row for day in days for row in day)]) == []


def test_rows_of_different_conditions_are_copies_only_by_their_many_digits():
    rows = [replace(row, lift_m=0.0) for row in table(phi=SIX_PHI, decimals=4)]
    elsewhere = [replace(row, trial_id=f"else{n}", phi=row.phi + 0.005) for n, row in enumerate(rows[3:18])]
    assert copies([*rows, *elsewhere]) == []
    rows = [replace(row, lift_m=row.speed_m_s / 7) for row in table()]
    assert copies([*rows, replace(rows[4], trial_id="else", omega_rad_s=20.0)]) == ["else"]


def test_trials_that_failed_alike_are_no_copies():
    rows = [replace(row, speed_m_s=math.nan, status="no markers") for row in pasted(table())]
    assert mark_copies(rows) == (rows, [])


def also_in(rows, other):
    return same_trials(Table(rows), Table(other))


def shuffled(rows, seed=0):
    order = np.random.default_rng(seed).permutation(len(rows))
    return [replace(rows[at], trial_id=f"again{n}", batch="Tue") for n, at in enumerate(order)]


@pytest.mark.parametrize(
    "how", [{}, {"decimals": 4}, {"decimals": 4, "replicates": 1}, {"decimals": 3, "missed": 1e-3}]
)
def test_a_table_in_another_row_order_or_a_part_of_it_is_in_the_table(how):
    rows = table(phi=SIX_PHI, **how)
    again = shuffled(rows)
    for part in (again, again[:8]):
        assert set(also_in(part, rows)) == {row.trial_id for row in part}
        assert len(also_in(rows, part)) == len(part)
    # Control: neither contains the other.
    changed = replace(again[0], speed_m_s=0.1234)
    assert also_in([changed, *again[1:]], rows) == {}
    assert also_in([*again[1:], again[1]], rows) == {}


@pytest.mark.parametrize(("decimals", "scatter"), [(2, 5e-3), (3, 5e-4)])
def test_a_day_all_of_whose_rounded_values_another_day_has_too_is_a_day(decimals, scatter):
    rows = table(decimals=decimals, scatter=scatter, replicates=40)
    day = table(2, decimals=decimals, scatter=scatter, replicates=3)
    assert {(row.phi, row.omega_rad_s, row.speed_m_s) for row in day} <= {
        (row.phi, row.omega_rad_s, row.speed_m_s) for row in rows
    }
    assert also_in(day, rows) == {}
    single = table(decimals=3)
    assert also_in([replace(single[2], trial_id="again")], single) == {}


def test_a_table_given_again_in_another_row_order_counts_once(tmp_path):
    pandas = pytest.importorskip("pandas")
    rows = table(phi=SIX_PHI, decimals=4)
    for name, some in (("a.csv", rows), ("b.csv", shuffled(rows)), ("c.csv", table(2, phi=SIX_PHI, decimals=4))):
        columns = [{"phi": r.phi, "omega_rad_s": r.omega_rad_s, "speed_m_s": r.speed_m_s} for r in some]
        pandas.DataFrame(columns).to_csv(tmp_path / name, index=False)
    once, twice = read(tmp_path / "a.csv"), read([tmp_path / "a.csv", tmp_path / "b.csv"])
    assert [str(row) for row in twice.rows()] == [str(row) for row in once.rows()]
    assert twice.unread == (
        f"{len(rows)} trials of {tmp_path / 'b.csv'} are also in the data before it and are counted once",
    )
    assert len(read([tmp_path / "a.csv", tmp_path / "c.csv"])) == 2 * len(rows)


def campaign(seed=1):
    """Trials of which all is measured, in full digits."""
    random = np.random.default_rng(seed)
    return [
        replace(row, phi=random.normal(row.phi, 1e-3), lift_m=random.normal(0.01, 1e-3),
                first_step_m=random.normal(0.04, 1e-3))
        for row in table(seed, phi=SIX_PHI, decimals=17)
    ]  # fmt: skip


def rounded(rows, decimals):
    values = ("phi", "speed_m_s", "lift_m", "first_step_m")
    return [replace(row, **{name: round(getattr(row, name), decimals) for name in values}) for row in rows]


def bare(rows):
    return [replace(row, lift_m=math.nan, first_step_m=math.nan) for row in rows]


def days(tmp_path, *tables, names=True):
    """Each table as a CSV."""
    for number, rows in enumerate(tables):
        rows = rows if names else [replace(row, trial_id="") for row in rows]
        (tmp_path / f"{number}.csv").write_text(to_csv(from_rows(rows)))
    return [tmp_path / f"{number}.csv" for number in range(len(tables))]


@pytest.mark.parametrize("names", [True, False])
@pytest.mark.parametrize("fewer", [bare, lambda rows: rounded(rows, 4), lambda rows: bare(rounded(rows, 4))])
def test_a_trial_given_twice_once_with_fewer_columns_or_digits_counts_once_and_in_full(tmp_path, names, fewer):
    rows = campaign()
    once = read(days(tmp_path, rows, names=names))
    for first, second in ((rows, fewer(rows)), (fewer(rows), rows), (rows, fewer(rows)[5:20])):
        found = read(days(tmp_path, first, second, names=names))
        assert [str(row) for row in found.rows()] == [str(row) for row in once.rows()]
        assert found.unread[0].startswith(f"{len(second)} trials of {tmp_path / '1.csv'} are also in the data")
    # Control: another day of the same plan, with the same names.
    other = read(days(tmp_path, rows, fewer(campaign(2)), names=names))
    assert (int(other.usable.sum()), len(other.unread)) == (2 * len(rows), 1)


def test_of_trials_with_an_exact_and_a_bare_row_in_one_table_the_fuller_counts():
    rows = campaign()
    again = [replace(row, trial_id=f"bare{row.trial_id}") for row in bare(rows[:5])]
    found, _ = mark_copies([*again, *rows])
    assert [row.trial_id for row in found if row.status != "ok"] == [row.trial_id for row in again]
    # Control: φ of a set-point says nothing, and one long value may be a ratio.
    rows = table(phi=SIX_PHI, decimals=17)
    assert copies([*rows, *(replace(row, trial_id=f"else{row.trial_id}") for row in rows[::7])]) == []


def test_a_value_that_one_of_both_rows_contradicts_makes_two_trials(tmp_path):
    rows = campaign()
    other = [replace(row, lift_m=row.lift_m + 2e-4) for row in rounded(rows, 4)]
    assert int(read(days(tmp_path, rows, other)).usable.sum()) == 2 * len(rows)


def test_tables_that_share_rounded_trials_in_part_are_told_of(tmp_path):
    rows, others = campaign(), campaign(2)
    both = read(days(tmp_path, rows, [*rounded(others, 4)[:20], *rounded(rows, 4)[20:]], names=False))
    assert len(both) == 72
    assert [note for note in both.unread if note.startswith("16 trials of ") and "as far as both give digits" in note]
    both = read(days(tmp_path, rows, rounded(others, 4), names=False))
    assert not [note for note in both.unread if "as far as" in note]


def test_by_csv_and_by_data_frame(tmp_path):
    pandas = pytest.importorskip("pandas")
    rows = pasted(table(decimals=4))
    frame = pandas.DataFrame([{"phi": r.phi, "omega_rad_s": r.omega_rad_s, "speed_m_s": r.speed_m_s} for r in rows])
    frame.to_csv(tmp_path / "t.csv", index=False)
    for trials in (read(tmp_path / "t.csv"), from_frame(frame)):
        assert (len(trials), int(trials.usable.sum())) == (24, 12)
        assert trials.unread[0].startswith("12 trials are exact copies of others and counted once: row14 = row2, ")
        assert trials.status[12] == "a copy of row2"
