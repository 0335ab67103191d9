"""In which order trials were run: as numbered, else as the clock tells."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_record.trials.order import ordered_by_start
from sandbot_record.trials.read import read
from sandbot_record.trials.table import Row


def rows(*started, **more):
    return [Row(trial_id=f"t{index}", started=text, **more) for index, text in enumerate(started)]


def orders(some):
    return [row.run_order for row in some]


@given(st.permutations(range(8)))
def test_the_clock_tells_the_order_that_nobody_has_numbered(places):
    some = rows(*(f"2026-11-25T10:{place:02d}:00+00:00" for place in places))
    assert orders(ordered_by_start(some, joined=False)) == [place + 1 for place in places]


def test_zones_are_minded():
    some = rows("2026-11-25T12:30:00+02:00", "2026-11-25T11:00:00Z", "2026-11-25T10:00:00+00:00")
    assert orders(ordered_by_start(some, joined=False)) == [2, 3, 1]


@given(st.permutations([4, 4, 5, 5, 5, 6]))
def test_trials_of_a_day_whose_hour_nobody_tells_share_their_place(days):
    """In the order of a table's rows they would drift with whatever it is sorted by."""
    place = {4: 1.5, 5: 4.0, 6: 6.0}
    assert orders(ordered_by_start(rows(*(f"2026-05-0{day}" for day in days)), joined=False)) == [
        place[day] for day in days
    ]


@pytest.mark.parametrize(
    "started",
    [
        ("03.05.2024 09:00", "03.05.2024 09:07", "01.06.2024 08:00"),
        ("2024/05/03 09:00:00", "2024/05/03 09:07:00", "2024/06/01 08:00:00"),
        ("5/1/24 9:00 AM", "5/1/24 1:00 PM", "5/13/24 8:00 AM"),
        ("13/05/2024", "14/05/2024", "01/06/2024"),
        ("05/03/2024 09:00", "05/03/2024 09:07", "05/04/2024 08:00"),
        ("03 May 2024 09:00", "03 May 2024 09:07", "01 Jun 2024 08:00"),
        ("45415.375", "45415.38", "45444.3"),
        ("1714726800", "1714727220", "1717228800"),
    ],
)
def test_dates_of_spreadsheets_tell_the_order(started):
    assert orders(ordered_by_start(rows(*started), joined=False)) == [1, 2, 3]
    assert orders(ordered_by_start(rows(*reversed(started)), joined=False)) == [3, 2, 1]


def test_a_date_that_may_be_in_either_of_two_months_tells_no_order():
    assert ordered_by_start(rows("05/03/2024", "04/06/2024"), joined=False) is None
    assert ordered_by_start(rows("13/05/2024", "05/13/2024"), joined=False) is None


def test_numbers_stand_unless_several_tables_count_alike():
    some = rows("2026-11-25T10:02:00", "2026-11-25T10:01:00", run_order=5.0)
    assert ordered_by_start(some, joined=False) is None
    assert orders(ordered_by_start(some, joined=True)) == [2, 1]


@pytest.mark.parametrize(
    "started",
    [("", ""), ("2026-11-25T10:00:00", ""), ("2026-11-25T10:00:00", "noon"), ("2026-11-25T10:00", "2026-11-25T11:00Z")],
)
def test_a_clock_that_does_not_tell_all_changes_nothing(started):
    assert ordered_by_start(rows(*started), joined=True) is None


def test_a_trial_that_failed_needs_no_time():
    some = [*rows("2026-11-25T10:02:00", "2026-11-25T10:01:00"), Row(trial_id="lost", status="no markers")]
    assert orders(ordered_by_start(some, joined=False))[:2] == [2, 1]
    assert math.isnan(ordered_by_start(some, joined=False)[2].run_order)


def test_days_in_tables_of_their_own_follow_each_other(tmp_path):
    for day, hour in (("first", 9), ("second", 8)):
        date = 24 if day == "first" else 25
        lines = [f"{day}{i},0.6,{8 + i},0.1,{i + 1},2026-11-{date}T0{hour}:0{i}:00" for i in range(3)]
        (tmp_path / f"{day}.csv").write_text(
            "\n".join(["trial_id,phi,omega_rad_s,speed_m_s,run_order,started", *lines])
        )
    found = read([tmp_path / "second.csv", tmp_path / "first.csv"])
    assert dict(zip(found.trial_id.tolist(), found.run_order.tolist(), strict=True)) == {
        **{f"first{i}": i + 1 for i in range(3)},
        **{f"second{i}": i + 4 for i in range(3)},
    }


def days(tmp_path, *numbers, more=""):
    """Tables of trials of these numbers, what is read of them all, and what is said of their order."""
    paths = [tmp_path / f"day{day}.csv" for day in range(len(numbers))]
    for day, (path, own) in enumerate(zip(paths, numbers, strict=True)):
        lines = [f"{day}:{number},0.6,{8 + number},0.1,{number}{more.format(day)}" for number in own]
        head = "trial_id,phi,omega_rad_s,speed_m_s,run_order" + (",started" if more else "")
        path.write_text("\n".join([head, *lines]))
    found = read(paths)
    return paths, found, [clause for clause in found.unread if "run_order" in clause]


def test_days_that_each_begin_with_1_follow_each_other_as_they_were_given_and_that_is_said(tmp_path):
    paths, found, said = days(tmp_path, (1, 2, 3), (1, 2), (2, 1))
    assert found.run_order.tolist() == [1, 2, 3, 4, 5, 7, 6]
    assert [clause.split(",")[0] for clause in said] == [f"run_order starts again in {path}" for path in paths[1:]]


def test_numbers_that_tables_share_among_them_stand(tmp_path):
    """Control: trials of one campaign sorted into tables, and days of which the clock tells the order."""
    _, found, said = days(tmp_path, (2, 5), (1, 3, 4))
    assert (found.run_order.tolist(), said) == ([2, 5, 1, 3, 4], [])
    _, found, said = days(tmp_path, (1,), (1,), more=",2026-11-2{}")
    assert (found.run_order.tolist(), said) == ([1, 2], [])
