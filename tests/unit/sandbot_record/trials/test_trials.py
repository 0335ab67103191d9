import csv
import math
import os
import subprocess

import bags
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sandbot_common.errors import InputError
from sandbot_record.trials.csv_table import read_csv, write_csv
from sandbot_record.trials.read import read
from sandbot_record.trials.table import COLUMNS, Row, from_rows

GOOD = "phi,omega_rad_s,speed_m_s\n0.60,8,0.21\n0.62,8,0.25\n"
LIFT = "phi,omega_rad_s,speed_m_s,{}\n.6,8,.2,.005\n"
DAYS = "no batch is given: each table is treated as the trials of one day"


def write(tmp_path, text, name="t.csv"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def test_three_columns_are_enough(tmp_path):
    table = read(write(tmp_path, GOOD))
    assert table.phi.tolist() == [0.60, 0.62]
    assert table.omega_rad_s.tolist() == [8, 8]
    assert table.speed_m_s.tolist() == [0.21, 0.25]
    assert np.isnan(table.lift_m).all()
    assert table.trial_id.tolist() == ["row2", "row3"]
    assert table.usable.all()


def test_foreign_columns_blank_lines_and_a_mark_at_the_start_do_no_harm(tmp_path):
    text = "\ufeff" + GOOD.replace("speed_m_s", "speed_m_s,remark").replace("0.21", "0.21,x").replace(
        "0.25", "0.25,\n,,,"
    )
    assert read(write(tmp_path, text)).speed_m_s.tolist() == [0.21, 0.25]


def test_rows_with_another_status_are_kept_but_not_usable(tmp_path):
    path = write(tmp_path, "phi,omega_rad_s,speed_m_s,status\n0.6,8,0.2,ok\n0.6,8,,robot fell\n0.6,8,0.2,\n")
    table = read(path)
    assert table.usable.tolist() == [True, False, True]
    assert table.excluded == 1
    assert math.isnan(table.speed_m_s[1])


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "empty; a header with phi, omega_rad_s, speed_m_s"),
        ("phi,omega_rad_s,speed_m_s\n", "no trials"),
        ("phi,speed_m_s\n0.6,0.2\n", "row 1: column omega_rad_s is missing; there are: phi, speed_m_s"),
        ("phi,omega_rads,speed_m_s\n0.6,8,0.2\n", "row 1: column omega_rad_s is missing; is 'omega_rads' meant?"),
        (
            "phi,omega_rad_s,speed [km/h]\n0.6,8,0.2\n",
            r"speed_m_s is missing; 'speed \[km/h\]' has a unit that is not known; m/s, cm/s",
        ),
        (
            "phi,ω,speed_m_s\n.6,8,.2\n",
            r"column omega_rad_s is missing; ω needs its unit, ω \[rad/s\], \[hz\], \[rpm\]",
        ),
        (
            "phi,omega_rad_s,speed_m_s,lift [cm],lift_mm\n.6,8,.2,1,10\n",
            r"row 1: columns 'lift \[cm\]' and 'lift_mm' are both lift_m; leave one out",
        ),
        # A second row of units is none where a name says another, or where there are numbers in it.
        ("phi,omega_rad_s,speed_m_s\n1,rad/s,cm/s\n.6,8,20\n", "row 2, column phi: 1 is out of range"),
        ("phi,omega,speed\n.6,rad/s,cm/s\n.6,8,20\n", r"omega_rad_s is missing; omega needs its unit"),
        ("phi;omega_rad_s;speed_m_s\n0,6;8;0,2\n0,6;8\n", "row 3: 2 values for 3 columns"),
        ("phi;omega_rad_s;speed_m_s\n0,6,1;8;0,2\n", "row 2, column phi: '0,6,1' is not a number"),
        ("phi,phi,omega_rad_s,speed_m_s\n", "row 1: column phi is there twice"),
        ("phi,.6,.61\nomega [Hz],1,2\nspeed_m_s,.1,.2\n", "row 1: column omega_rad_s is missing; there are numbers in"),
        ("0.6,8,0.2\n0.6,12,0.3\n", "column phi is missing; there are numbers in that row: names of the columns are"),
        (
            "phi omega [rad/s] speed_m_s\n0.6 8 .2\n",
            "column phi is missing; columns are separated by commas, tabs or semicolons, or by spaces where no name or",
        ),
        (
            "phi|omega_rad_s|speed_m_s\n.6|8|.2\n",
            r"column phi is missing; columns are separated by commas, semicolons, tabs or spaces, not by '\|'",
        ),
        ("phi,omega_rad_s,s/R\n.6,8,.9\n", "column speed_m_s is missing; of a step s, as in 's/R', mean speed is sω/π"),
        ("phi,omega_rad_s,force\n.6,8,.9\n", "column speed_m_s is missing; there are: phi, omega_rad_s, force"),
        (
            "trial_id,phi,omega_rad_s,speed_m_s\nMean,.6,8,.2\n",
            "row 2, column trial_id: 'Mean' is a summary, not a trial",
        ),
        ("SandBot, sand, 2026\nphy,omga,spd\n.6,8,.2\n", "row 1: column phi is missing"),
        ("phi,omega [1/s],speed_m_s\n.6,8,.2\n", r"'omega \[1/s\]' may be in rad/s or in Hz: write which"),
        ("phi,omega [s^-1],speed_m_s\n.6,8,.2\n", r"'omega \[s\^-1\]' may be in rad/s or in Hz: write which"),
        (
            "phi_target,phi_measured,omega_rad_s,speed_m_s\n.6,.61,8,.2\n",
            "column phi is missing; of 'phi_target' and 'phi_measured' call the one that was measured phi",
        ),
        *(
            (f"{header}\n.6,8,.2,.2,.2\n", f"column {name} is missing; one row per trial is needed: of several columns")
            for header, name in (
                ("phi,omega_rad_s,v1,v2,v3", "speed_m_s"),
                ("phi,omega_rad_s,speed_1 [m/s],speed_2 [m/s],speed_3 [m/s]", "speed_m_s"),
                ("x,omega_rad_s,phi=0.580,phi=0.600,phi=0.633", "phi"),
            )
        ),
        (GOOD + ",,0.2\n", "row 4, column phi: empty; .*; a cell merged over several rows has to be filled down"),
        ("phi,omega [radians],speed_m_s\n.6,8,.2\n", "has a unit that is not known"),
        (GOOD + "0.6,8,20%\n", "row 4, column speed_m_s: '20%' is not a number"),
        (GOOD + "60.0.1%,8,0.2\n", "row 4, column phi: '60.0.1' is not a number"),
        (GOOD + "0.6,8\n", "row 4: 2 values for 3 columns"),
        (GOOD + "0.6,,0.2\n", "row 4, column omega_rad_s: empty"),
        (GOOD + "nan,8,0.2\n", "row 4, column phi: nan; a value is needed here"),
        (GOOD + "--,8,0.2\n", "row 4, column phi: --; a value is needed here"),
        (GOOD + "0.6,8,inf\n", "row 4, column speed_m_s: inf is not a finite number"),
        ("# title\n" + GOOD.replace("0.62,8", "0.62,fast"), "row 4, column omega_rad_s: 'fast'"),
        (GOOD + "0.6,fast,0.2\n", "row 4, column omega_rad_s: 'fast' is not a number; a value is needed here"),
        (GOOD + '"0,6",8,0.2\n', "row 4, column phi: '0,6' is not a number; write decimals with a point"),
        (GOOD + "60,8,0.2\n", "row 4, column phi: 60 is out of range: .* divide percent by 100"),
        (GOOD + ".6,8,20\n", "column speed_m_s: 20 is out of range: a speed in m/s is needed; divide cm/s by 100$"),
        (GOOD + ".6,8,2000\n", "column speed_m_s: 2000 is out of range: a speed in m/s is needed$"),
        (
            "phi [%],omega_rad_s,speed_m_s\n105,8,0.2\n",
            "phi: 105 × 0.01 = 1.05 is out of range: a volume fraction between 0 and 1, both excluded is needed$",
        ),
        ("phi,omega [Hz],speed_m_s\n.6,-2,0.2\n", "omega_rad_s: -2 × 6.283 = -12.57 is out of range: a leg freq"),
        (GOOD + "0.6_0,8,0.2\n", "row 4, column phi: '0.6_0' is not a number"),
        (GOOD + "6_0%,8,0.2\n", "row 4, column phi: '6_0' is not a number"),
        *(
            (
                f"phi,omega_rad_s,speed_m_s,n_trials\n0.6,8,0.2,{n}\n",
                f"row 2, column n_trials: {n} is out of range: a whole number",
            )
            for n in ("0", "-0.5", "2.5")
        ),
        (GOOD + "0,8,0.2\n", "row 4, column phi: 0 is out of range"),
        (GOOD + "0.6,0,0.2\n", "row 4, column omega_rad_s: 0 is out of range"),
        (GOOD + "0.6,-8,0.2\n", "row 4, column omega_rad_s: -8 is out of range"),
        (GOOD + "0.6,8,21\n", "row 4, column speed_m_s: 21 is out of range"),
        ("phi,phi_sd,omega_rad_s,speed_m_s\n0.6,-0.1,8,0.2\n", "row 2, column phi_sd: -0.1 is out of range"),
        (
            "trial_id,phi,omega_rad_s,speed_m_s\na,.6,8,.2\na,.6,8,.2\n",
            "row 3, column trial_id: trial id 'a' is there twice",
        ),
        (
            "phi,omega_rad_s,speed_m_s,status\n0.6,8,,failed\n",
            "no usable trial among 1: row2 has status 'failed', and only ok is",
        ),
        ('phi,omega_rad_s,speed_m_s\n"0.6,8,0.2\n', "not a CSV"),
    ],
)
def test_one_line_says_which_row_and_column(tmp_path, text, complaint):
    with pytest.raises(InputError, match=complaint) as error:
        read(write(tmp_path, text))
    assert "\n" not in str(error.value)
    assert "t.csv" in str(error.value)


@pytest.mark.parametrize(
    ("header", "omega"),
    [
        ("φ (–),ω/(rad/s),v/(m/s)", 8),
        ("φ/%,f/Hz,v / (m s⁻¹)", 16 * np.pi),
        ("phi,omega_rad_per_s,speed_m_per_s", 8),
        ("phi,omega in rad/s,speed in m/s", 8),
        ('phi,"omega, rad/s","v, m/s"', 8),
    ],
)
def test_a_unit_is_read_as_standards_and_people_write_it(tmp_path, header, omega):
    table = read(write(tmp_path, f"{header}\n{60 if '%' in header else 0.6},8,0.2\n"))
    assert table.omega_rad_s == pytest.approx([omega])
    assert (*table.phi, *table.speed_m_s) == (pytest.approx(0.6), 0.2)
    assert table.unread == ()


def test_a_batch_called_x_is_one(tmp_path):
    assert read(write(tmp_path, "phi,omega_rad_s,speed_m_s,day\n.6,8,.2,x\n.6,8,.21,y\n")).batch.tolist() == ["x", "y"]


def test_a_trial_without_a_speed_is_read_and_not_used(tmp_path):
    assert read(write(tmp_path, GOOD + "0.6,8,\n")).usable.tolist() == [True, True, False]


@pytest.mark.parametrize(
    "word", ["", "-", "--", "—", "n/a", "NA", "NaN", "none", "#N/V", "#DIV/0!", "n.a.", "x", "\u2212", "\u2011"]
)
def test_what_people_write_for_not_measured_is_not_measured(tmp_path, word):
    given = "phi,omega_rad_s,speed_m_s,lift_m\n.6,8,.2,.01\n.6,8,.2,{}\n"
    assert np.isnan(read(write(tmp_path, given.format(word))).lift_m).tolist() == [False, True]
    with pytest.raises(InputError, match="row 3, column lift_m: 'lost' is not a number; leave empty what"):
        read(write(tmp_path, given.format("lost")))


@pytest.mark.parametrize(
    ("column", "told"),
    [
        ("lift_m", ()),
        (
            "lift [ft]",
            (r"column lift [ft] is not read; 'lift [ft]' has a unit that is not known; m, cm, mm, μm, um are",),
        ),
        ("lift_mm", ()),
        ("lift", ("column lift is not read; lift needs its unit, lift [m], [cm], [mm], [μm], [um]",)),
        ("speed_cm_s", ("columns that are not read: speed_cm_s",)),
        ("phi_1", ("column phi_1 is not read, did you mean 'phi_sd'?",)),
        ("lft_m", ("column lft_m is not read, did you mean 'lift_m'?",)),
        ("operator", ("columns that are not read: operator",)),
        ("note,note", ("columns that are not read: note, note",)),
        (
            "Exclude",
            (
                "Exclude is not read: to exclude a trial, give it a status other than ok",
                "columns that are not read: Exclude",
            ),
        ),
        *(
            (
                column,
                (
                    f"{column} is not read: an error bar of the speed is called speed_sd (standard deviation) or "
                    "speed_sem (standard error; 95 % are ± 1.96 of it), with its unit",
                ),
            )
            for column in ("SD [cm/s]", "± [cm/s]", "error (m/s)", "speed_ci95_m_s", "upper")
        ),
        ("v_sd [cm/s]", ()),
        ("v_sem_m_s", ()),
        ("force [N]", ("columns that are not read: force [N]",)),
        *(
            (column, (f"{said}: when a trial was run is given in one column, started, as 2026-05-04 08:10",))
            for column, said in (("Date", "Date is not read"), ("date,Time", "date and Time are not read"))
        ),
        ("time", ("columns that are not read: time",)),
        # What the table has under its own name, another column is not.
        ("f [N],v [V]", ("columns that are not read: f [N], v [V]",)),
    ],
)
def test_a_column_that_is_not_read_is_told(tmp_path, column, told):
    more = ",1" * column.count(",")
    assert read(write(tmp_path, f"phi,omega_rad_s,speed_m_s,{column}\n.6,8,.2,.01{more}\n")).unread == told


@pytest.mark.parametrize(
    ("columns", "sem_m_s", "trials"),
    [
        ("speed_sem_m_s,n_trials", 0.4, 3),
        ("speed_se_m_s,n", 0.4, 3),
        ("speed_stderr_cm_s,replicates", 0.004, 3),
        ("speed standard error [mm/s],Number of trials", 0.0004, 3),
        # Control: a standard deviation, and the number of a trial.
        ("speed_sd_m_s,replicate", math.nan, math.nan),
    ],
)
def test_the_standard_error_of_a_mean_and_the_number_of_its_trials_are_read(tmp_path, columns, sem_m_s, trials):
    found = read(write(tmp_path, f"phi,omega_rad_s,speed_m_s,{columns}\n0.6,8,0.2,0.4,3\n"))
    assert (found.speed_sem_m_s[0], found.n_trials[0]) == pytest.approx((sem_m_s, trials), nan_ok=True)
    assert found.unread == ()


def test_what_is_no_table(tmp_path):
    with pytest.raises(InputError, match="-: no such file or folder; standard input is /dev/stdin"):
        read("-")
    with pytest.raises(InputError, match="no such file"):
        read(tmp_path / "none.csv")
    (tmp_path / "x.csv").write_bytes(b"\xff\xfe\0")
    with pytest.raises(InputError, match="not a text file"):
        read(tmp_path / "x.csv")
    with pytest.raises(InputError, match="neither a campaign"):
        read(tmp_path)
    with pytest.raises(InputError, match="no data given"):
        read([])


def test_text_in_the_encoding_of_windows_is_read_and_that_is_said(tmp_path):
    path = tmp_path / "old.csv"
    path.write_text("phi,omega_rad_s,speed_m_s,lift [µm]\n.6,8,.2,5400\n", encoding="cp1252")
    table = read(path)
    assert table.lift_m.tolist() == pytest.approx([5.4e-3])
    assert table.unread == (f"{path}: not UTF-8, read as Windows-1252: check letters beyond ASCII in names",)
    path.write_text(path.read_text(encoding="cp1252"), encoding="utf-8")
    assert read(path).unread == ()


@pytest.mark.parametrize("strange", [b"\x81", b"\xfc\x07"], ids=["no letter of Windows-1252", "control characters"])
def test_of_text_in_no_such_encoding_the_line_is_named(tmp_path, strange):
    path = tmp_path / "old.csv"
    path.write_bytes(b"phi,omega_rad_s,speed_m_s,note\n.6,8,.2,dry\n.62,8,.2," + strange + b"\n")
    with pytest.raises(InputError, match=r"old.csv: not a text file \(UTF-8\); line 3 is not: save it as UTF-8"):
        read(path)


@pytest.mark.parametrize(
    ("column", "value"),
    [("Δz (mm)", 5.4), ("∆z (mm)", 5.4), ("lift (mm)", 5.4), ("lift [\u00b5m]", 5400), ("lift [\u03bcm]", 5400)],
)
def test_lift_is_read_by_the_symbol_of_the_pages_and_in_micrometres_however_typed(tmp_path, column, value):
    table = read(write(tmp_path, f"phi,omega_rad_s,speed_m_s,{column}\n.6,8,.2,{value}\n"))
    assert table.lift_m.tolist() == pytest.approx([5.4e-3])


def test_several_inputs_are_joined(tmp_path):
    bag = bags.trial_bag(tmp_path / "b")
    table = read([bag, write(tmp_path, GOOD)])
    assert table.trial_id.tolist() == ["t0001", "row2", "row3"]
    assert read([bag, bag]).trial_id.tolist() == ["t0001"]


def test_rows_of_two_days_are_replicates_however_alike_and_a_table_given_twice_is_there_once(tmp_path):
    """Speeds rounded to cm/s: in two of three rows the second day has the first day's number."""
    header = "phi,omega_rad_s,speed [cm/s]\n"
    first = write(tmp_path, header + "0.6,8,12\n0.6,12,16\n0.62,8,14\n", "first.csv")
    second = write(tmp_path, header + "0.6,8,12\n0.6,12,17\n0.62,8,14\n", "second.csv")
    both = read([first, second])
    assert (len(both), both.unread) == (6, (DAYS,))
    again = read([first, second, first])
    assert len(again) == 6
    assert again.unread == (f"3 trials of {first} are also in the data before it and are counted once", DAYS)


def test_trials_that_are_numbered_anew_each_day_are_replicates_too(tmp_path):
    header = "trial_id,phi,omega_rad_s,speed [cm/s]\n"
    first = write(tmp_path, header + "1,0.6,8,7\n2,0.6,12,16\n", "first.csv")
    second = write(tmp_path, header + "1,0.6,8,7\n2,0.6,12,17\n", "second.csv")
    assert read([first, second]).trial_id.tolist() == ["1", "2", f"{second}/1", f"{second}/2"]


def test_trials_of_a_campaign_are_known_by_name_and_digits_where_one_was_run_again(tmp_path):
    header = "trial_id,phi,omega_rad_s,speed_m_s,lift_m\n"
    old = write(tmp_path, header + "a,0.6,8,0.123456789,0.0123\nb,0.6,12,0.2345678,0.0145\n", "old.csv")
    new = write(tmp_path, header + "a,0.6,8,0.123456789,0.0123\nb,0.6,12,0.2388888,0.0145\n", "new.csv")
    assert read([old, new]).trial_id.tolist() == ["a", "b", f"{new}/b"]


def test_two_days_on_one_plan_are_two_sets_of_trials(tmp_path):
    """They name their trials alike; a copy of one day is no third."""
    head = "trial_id,phi,omega_rad_s,speed_m_s\n"
    days = [tmp_path / "monday.csv", tmp_path / "tuesday.csv", tmp_path / "copy.csv"]
    for day, speed in zip(days, (0.2, 0.21, 0.2), strict=True):
        day.write_text(f"{head}a,0.6,8,{speed}\nb,0.6,12,0.3\n")
    table = read(days)
    assert table.trial_id.tolist() == ["a", "b", f"{days[1]}/a", f"{days[1]}/b"]
    assert table.speed_m_s.tolist() == [0.2, 0.3, 0.21, 0.3]
    assert read([*days, days[1]]).trial_id.tolist() == table.trial_id.tolist()
    days[2].write_text(f"{head}c,0.6,8,0.2\nc,0.6,12,0.3\n")
    with pytest.raises(InputError, match=r"copy\.csv.*trial id 'c' is there twice"):
        read(days)


def test_blocks_of_two_campaigns_are_not_the_same_batch(tmp_path):
    """Each numbers its own from 1; a day is one in whichever table it stands."""
    head = "trial_id,phi,omega_rad_s,speed_m_s,batch\n"
    tables = [tmp_path / name / "trials.csv" for name in ("first", "second")]
    for name, table in zip("ab", tables, strict=True):
        table.parent.mkdir()
        table.write_text(f"{head}{name}1,0.6,8,0.2,block1\n{name}2,0.6,8,0.2,block2\n{name}3,0.6,8,0.2,Monday\n")
    second = tmp_path / "second"
    own = ["block1", "block2", "Monday"]
    assert read(tables).batch.tolist() == [*own, f"{second}/block1", f"{second}/block2", "Monday"]
    # Control: one campaign, given as bags and as a table of some more of its trials, has its blocks once.
    plans = [
        {"trial_id": f"t{i}", "phi": 0.6, "omega_rad_s": 12.0, "gait": "UNIFORM", "batch": "block1"} for i in (1, 2)
    ]
    given = [bags.trial_bag(second / "trials" / plan["trial_id"], plan=bags.PLAN | plan) for plan in plans]
    assert set(read([*given, tables[1]]).batch.tolist()) == {"block1", "block2", "Monday"}


number = st.floats(0.01, 0.99)
rows = st.builds(
    Row,
    trial_id=st.uuids().map(str),
    phi=number,
    phi_sd=number | st.just(math.nan),
    omega_rad_s=st.floats(0.1, 100),
    gait=st.text("abc ,\"'é", max_size=5).map(str.strip),
    replicate=st.integers(0, 9).map(float) | st.just(math.nan),
    speed_m_s=st.floats(-1, 1),
    lift_m=st.floats(-0.5, 0.5) | st.just(math.nan),
    status=st.just("ok"),
)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(rows, min_size=1, max_size=5, unique_by=lambda row: row.trial_id))
def test_written_and_read_back_is_equal(tmp_path, table):
    path = tmp_path / "t.csv"
    write_csv(from_rows(table), path)
    again = read_csv(path)
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(again, name), getattr(from_rows(table), name))


def test_not_measured_is_an_empty_cell(tmp_path):
    write_csv(from_rows([Row("a", 0.6, omega_rad_s=8, speed_m_s=0.2, replicate=1)]), tmp_path / "t.csv")
    (row,) = csv.DictReader((tmp_path / "t.csv").open())
    assert row["lift_m"] == ""
    assert row["replicate"] == "1"


@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=200) | st.text('phi,omega_rd.speed\n"0123456789-;\r\t e', max_size=200).map(str.encode))
def test_any_file_is_a_table_or_one_line(tmp_path, content):
    path = tmp_path / "t.csv"
    path.write_bytes(content)
    complaint = ""
    try:
        read(path)
    except InputError as error:
        complaint = str(error)
    assert "\n" not in complaint


@pytest.mark.parametrize("name", ["batch", "day", "preparation"])
def test_order_and_time_are_read_and_written(tmp_path, name):
    text = f"{name},phi,omega_rad_s,speed_m_s,run_order,started\nmonday,.6,8,.2,2,2026-05-04T09:30\n,.6,8,.2,,\n"
    table = read(write(tmp_path, text))
    assert table.batch.tolist() == ["monday", ""]
    assert table.run_order[0] == 2
    assert table.started.tolist() == ["2026-05-04T09:30", ""]
    write_csv(table, tmp_path / "again.csv")
    again = read_csv(tmp_path / "again.csv")
    assert again.batch.tolist() == table.batch.tolist()
    assert (tmp_path / "again.csv").read_text().splitlines()[0].endswith("batch,run_order,started,status")


def test_a_table_without_order_and_time_is_written_as_before(tmp_path):
    write_csv(read(write(tmp_path, GOOD)), tmp_path / "again.csv")
    assert not {"batch", "run_order", "started"} & set((tmp_path / "again.csv").read_text().splitlines()[0].split(","))


def test_a_batch_of_its_own_name_goes_before_its_synonyms(tmp_path):
    table = read(write(tmp_path, "Day,batch,phi,omega_rad_s,speed_m_s\nmonday,b7,.6,8,.2\n"))
    assert table.batch.tolist() == ["b7"]


def test_a_failed_trial_on_top_is_no_row_of_units(tmp_path):
    table = read(write(tmp_path, "trial_id,phi,omega_rad_s,speed_m_s,status\na,,,,failed\nb,.6,8,.2,ok\n"))
    assert table.trial_id.tolist() == ["a", "b"]


def test_gait_and_status_are_known_however_they_are_written(tmp_path):
    text = "phi,omega_rad_s,speed_m_s,gait,status\n.6,8,.2,sgcs,OK\n.6,8,.2,Uniform,Ok\n.6,8,.2,trot,Fell\n"
    table = read(write(tmp_path, text))
    assert table.gait.tolist() == ["SGCS", "UNIFORM", "trot"]
    assert table.status.tolist() == ["ok", "ok", "Fell"]


@pytest.mark.parametrize(
    "text",
    [
        "phi\tomega_rad_s\tspeed_m_s\n0.60\t8\t0.21\n0.62\t8\t0.25\n",
        "phi;omega_rad_s;speed_m_s\n0.60;8;0.21\n0.62;8;0.25\n",
        "Day 3, by hand\nphi;omega_rad_s;speed_m_s\n0,60;8;0,21\n,62;8,0;2,5e-1\n",
        "phi\tomega_rad_s\tspeed_m_s\n0,60\t8\t0,21\n0,62\t8\t0,25\n",
        "phi,omega_rad_s,speed_m_s,notes\n0.60,8,0.21,slow; wet\n0.62,8,0.25,dry; level\n",
        "Li09 figure 3\n" + GOOD,
        "# taken on Monday, by hand\n#\n" + GOOD,
        "phi [1],omega [rad/s],speed [cm/s]\n0.60,8,21\n0.62,8,25\n",
        "phi (%),omega (rpm),v (mm/s)\n60,76.39437268,210\n62,76.39437268,250\n",
        "volume fraction [-],frequency [Hz],mean speed [m/s]\n.6,1.2732395447,.21\n.62,1.2732395447,.25\n",
        "packing fraction,leg frequency (Hz),velocity (cm/s)\n.6,1.2732395447,21\n.62,1.2732395447,25\n",
        "φ,omega_rpm,speed_cm_s\n.6,76.39437268,21\n.62,76.39437268,25\n",
        "ϕ,frequency_Hz,Mean_speed_mm_s\n.6,1.2732395447,210\n.62,1.2732395447,250\n",
        "phi_percent,ω (rad s^-1),speed [cm·s⁻¹]\n60,8,21\n62,8,25\n",
        "phi,omega,speed,note\n[%],(rad/sec),cm/s,-\n60,8,21,wet\n62,8,25,dry\n",
        "phi,omega_rad_s,speed_m_s\n,rad/s,m/s\n.60,8,.21\n.62,8,.25\n",
        # As spreadsheets and numpy write them.
        "phi;omega_rad_s;speed_m_s;lift_m\n0,600;8,000;0,210;\N{MINUS SIGN}0,001\n0,620;8,000;0,250;0,001\n",
        "phi,omega_rad_s,speed_m_s,gait,batch\n.6,8,.21,NA,-\n.62,8,.25,-,n/a\n",
        "sep=;\nphi;omega_rad_s;speed_m_s\n0,60;8;0,21\n0,62;8;0,25\n",
        'phi;omega_rad_s;speed_m_s;note\n0,60;8;0,21;"slow; wet"\n0,62;8;0,25;dry\n',
        'phi;omega_rad_s;speed_m_s;"note, who"\n0,60;8;0,21;a\n0,62;8;0,25;b\n',
        'phi;"omega\n[rad/s]";speed_m_s\n0,60;8;0,21\n0,62;8;0,25\n',
        "# phi,omega_rad_s,speed_m_s\n0.60,8,0.21\n0.62,8,0.25\n",
        "# made on Monday, by hand\n# phi; omega_rad_s; speed_m_s\n0,60;8;0,21\n0,62;8;0,25\n",
        "# made on Monday, by hand\n# phi omega_rad_s speed_m_s\n0.60 8 0.21\n6.2e-1 8 0.25\n",
        '"phi" "omega_rad_s" "speed_m_s"\n"1" 0.6 8 0.21\n"2" 0.62 8 0.25\n',
        "phi,omega_rad_s,speed_m_s\n1,0.6,8,0.21\n2,0.62,8,0.25\n",
        # Titles with separators, groups of columns above their names, cells formatted as percent.
        "SandBot poppy seeds, March 2026,,,\n,,,\nphi,omega_rad_s,speed_m_s,note\n.6,8,.21,a\n.62,8,.25,b\n",
        "SandBot, 2026\nphi,omega_rad_s,speed_m_s\n.6,8,.21\n.62,8,.25\n",
        "Ground,Robot,Result,\nphi,omega,speed,lift\n1,rad/s,m/s,mm\n.60,8,.21,3\n.62,8,.25,4\n",
        "phi,omega [deg/s],speed_m_s\n60.0%,458.3662361,.21\n62 %,458.3662361,.25\n",
        "phi [%],omega_deg_s,speed_m_s\n60%,458.3662361,.21\n62%,458.3662361,.25\n",
        "   phi   omega_rad_s  speed_m_s \n  0,60            8       0,21\n  0,62           8\t    0,25  \n",
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_common_forms_are_read_in_si_units(tmp_path, text, encoding):
    (tmp_path / "t.csv").write_text(text, encoding=encoding)
    table = read(tmp_path / "t.csv")
    np.testing.assert_allclose(table.phi, [0.60, 0.62])
    np.testing.assert_allclose(table.omega_rad_s, [8, 8])
    np.testing.assert_allclose(table.speed_m_s, [0.21, 0.25])
    assert set(table.gait) | set(table.batch) == {""}


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (
            "phi;omega [Hz];speed [mm/s]\n0.61;2;1,200\n0.62;2;900\n",
            r"row 2, column speed \[mm/s\]: '1,200' has a comma, but row 2, column phi: '0.61' has a point: write the",
        ),
        (
            "phi;omega [Hz];speed [mm/s]\n0,61;2;800\n0,62;2;1.200\n",
            r"row 2, column phi: '0,61' has a comma, but row 3, column speed \[mm/s\]: '1.200' has a point",
        ),
        ("phi\tomega [rpm]\tspeed_m_s\n0.61\t1,200\t.2\n", r"column omega \[rpm\]: '1,200' has a comma"),
        # 1.1 µm or 1100: nothing else in the table has a decimal.
        ("phi [%];omega [Hz];speed [mm/s];lift [µm]\n61;2;19;1,100\n", r"'1,100' may be a decimal number or thousands"),
        ("phi [%];omega [Hz];speed [mm/s];lift [µm]\n61;2;19;1.100\n", r"'1.100' may be a decimal number or thousands"),
    ],
)
def test_thousands_are_not_taken_for_decimals(tmp_path, text, complaint):
    with pytest.raises(InputError, match=complaint) as error:
        read(write(tmp_path, text))
    assert "\n" not in str(error.value)


def test_a_minus_sign_is_read_in_any_unit(tmp_path):
    table = read(write(tmp_path, "phi,omega_rad_s,speed_m_s,lift [mm]\n.6,8,.2,-0.5\n.6,8,\u22120.2,\u22120.5\n"))
    assert table.lift_m.tolist() == pytest.approx([-5e-4, -5e-4])
    assert table.speed_m_s.tolist() == [0.2, -0.2]


def test_a_day_is_one_however_a_spreadsheet_writes_its_number(tmp_path):
    header = "phi,omega_rad_s,speed_m_s,day\n"
    first = write(tmp_path, header + "0.6,8,0.1,1\n0.6,12,0.2,10\n", "first.csv")
    second = write(tmp_path, header + "0.6,8,0.11,1.0\n0.6,12,0.21,10.0\n", "second.csv")
    found = read([first, second])
    assert (found.batch.tolist(), found.unread) == (["1", "10", "1", "10"], ())


def test_days_of_almost_one_name_are_two_and_that_is_said(tmp_path):
    table = read(write(tmp_path, "phi,omega_rad_s,speed_m_s,day\n0.6,8,0.1,Mon\n0.6,8,0.11,mon\n0.6,8,0.1,Tue\n"))
    assert table.batch.tolist() == ["Mon", "mon", "Tue"]
    assert table.unread == ("batches Mon and mon are treated as 2 batches",)


def test_what_a_command_writes_into_a_pipe_is_a_table(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with subprocess.Popen(["sh", "-c", f"printf '%s' '{GOOD}' > {pipe}"]):
        assert read(pipe).trial_id.tolist() == ["row2", "row3"]


def test_tables_put_behind_each_other_are_one(tmp_path):
    """As `cat monday.csv tuesday.csv` does."""
    assert read(write(tmp_path, GOOD + GOOD.replace("21", "22"))).trial_id.tolist() == ["row2", "row3", "row5", "row6"]


def test_tables_that_tell_no_batch_are_days(tmp_path):
    first, second = (write(tmp_path, GOOD.replace("21", speed), f"{speed}.csv") for speed in ("21", "22"))
    both = read([first, second])
    assert both.batch.tolist() == [str(first)] * 2 + [str(second)] * 2
    assert both.unread == (DAYS,)
    assert read(first).batch.tolist() == ["", ""]


def test_what_is_told_of_batches_stands_and_a_single_trial_is_no_day(tmp_path):
    told = write(tmp_path, "phi,omega_rad_s,speed_m_s,day\n0.6,8,0.21,Mon\n0.62,8,0.25,\n", "told.csv")
    single = write(tmp_path, "phi,omega_rad_s,speed_m_s\n0.6,8,0.22\n", "single.csv")
    table = read([told, single])
    assert (table.batch.tolist(), table.unread) == (["Mon", "", ""], ())


def test_a_table_in_other_units_or_with_fewer_digits_is_the_same_table(tmp_path):
    head = "trial_id,phi,omega_rad_s,{},started\n"
    rows = [(f"t{i}", 0.58 + i / 300, 8, 0.1 + i / 70, f"2026-05-04T10:{i:02d}:01") for i in range(9)]
    table = "\n".join(",".join(map(str, row)) for row in rows)
    full = write(tmp_path, head.format("speed_m_s") + table, "full.csv")
    per_cm = "\n".join(",".join(map(str, (*row[:3], 100 * row[3], row[4]))) for row in rows)
    short = "\n".join(f"{name},{phi:.3f},{omega},{speed:.3f},{started}" for name, phi, omega, speed, started in rows)
    for other in (
        write(tmp_path, head.format("speed [cm/s]") + per_cm, "cm.csv"),
        write(tmp_path, head.format("speed_m_s") + short, "short.csv"),
    ):
        both = read([full, other])
        assert len(both) == 9
        assert both.unread[0] == f"9 trials of {other} are also in the data before it and are counted once"


@pytest.mark.parametrize(("decimals", "usable"), [(9, 3), (3, 4)])
def test_nameless_trials_of_two_tables_are_one_if_they_agree_in_many_digits(tmp_path, decimals, usable):
    """Neither table contains the other; control: rounded values, which agree by chance."""
    first, shared, second = (
        f"0.6,{omega},{speed:.{decimals}f},{speed / 9:.{decimals}f}"
        for omega, speed in ((8, 0.201234567), (9, 0.211234567), (10, 0.221234567))
    )
    for name, rows in (("a.csv", (first, shared)), ("b.csv", (shared, second))):
        (tmp_path / name).write_text("\n".join(["phi,omega_rad_s,speed_m_s,lift_m", *rows]))
    assert int(read([tmp_path / "a.csv", tmp_path / "b.csv"]).usable.sum()) == usable


def test_trials_of_one_name_and_day_are_two_where_no_time_is_told(tmp_path):
    """Control: the first trial of the morning, and of the afternoon."""
    head = "trial_id,phi,omega_rad_s,speed_m_s,started\n"
    morning, afternoon = (write(tmp_path, f"{head}1,0.6,8,{v},2026-05-04\n", f"{v}.csv") for v in (0.123, 0.124))
    assert len(read([morning, afternoon])) == 2


def test_names_of_columns_are_known_in_capitals(tmp_path):
    table = read(write(tmp_path, "Phi,OMEGA_RAD_S,Speed_m_s,Lift_m,Status\n0.6,8,0.21,0.005,OK\n0.6,8,0.2,0.004,bad\n"))
    assert (table.lift_m.tolist(), table.usable.tolist(), table.unread) == ([0.005, 0.004], [True, False], ())


def test_files_with_a_mark_of_their_encoding_may_be_put_behind_each_other(tmp_path):
    assert len(read(write(tmp_path, 2 * ("\ufeff" + GOOD)))) == 4
