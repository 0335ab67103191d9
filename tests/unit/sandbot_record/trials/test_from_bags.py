import math
import os
import shutil
from dataclasses import replace

import bags
import pytest

from sandbot_common import topics
from sandbot_common.errors import InputError
from sandbot_common.parallel import Processes
from sandbot_common.robot import Robot, to_mapping
from sandbot_record.bags.writer import BagWriter
from sandbot_record.tools import info as info_tool
from sandbot_record.tools import table as table_tool
from sandbot_record.trials import cache
from sandbot_record.trials import from_bags as table
from sandbot_record.trials.csv_table import read_csv
from sandbot_record.trials.read import read


def test_a_bag_becomes_a_row(tmp_path):
    row = table.row_from_bag(bags.trial_bag(tmp_path / "b", speed=0.2))
    assert row.trial_id == "t0001"
    nameless = bags.trial_bag(tmp_path / "phi0.62.r01", plan={**bags.PLAN, "trial_id": ""})
    assert table.row_from_bag(nameless).trial_id == "phi0.62.r01"
    assert (row.phi, row.phi_sd) == (0.6213, 0.0015)
    assert (row.omega_rad_s, row.gait, row.replicate) == (8.0, "UNIFORM", 2)
    assert row.status == "ok"
    assert row.speed_m_s == pytest.approx(0.2, rel=1e-3)
    assert row.first_step_m == pytest.approx(0.2 * math.pi / 8, rel=0.02)
    assert row.lift_m == pytest.approx(0.010, rel=0.05)


def test_order_and_time_come_from_the_plan(tmp_path):
    row = table.row_from_bag(bags.trial_bag(tmp_path / "b", plan=bags.PLAN | {"batch": "block2", "run_order": 17}))
    assert (row.batch, row.run_order, row.started) == ("block2", 17, bags.PLAN["start"])
    plain = table.row_from_bag(bags.trial_bag(tmp_path / "c"))
    assert plain.batch == ""
    assert math.isnan(plain.run_order)


@pytest.mark.parametrize(
    ("start", "started"),
    [
        ("1970-01-01T00:01:02.345+00:00", ""),  # a board without a battery, before NTP
        ("2000-01-01T00:00:00+00:00", "2000-01-01T00:00:00+00:00"),
        ("Monday", "Monday"),
    ],
)
def test_the_time_of_a_clock_that_nobody_had_set_is_not_known(tmp_path, start, started):
    """It would put this trial before all others."""
    row = table.row_from_bag(bags.trial_bag(tmp_path / "b", plan=bags.PLAN | {"start": start}))
    assert (row.started, row.status) == (started, "ok")


def test_the_speed_follows_the_landmarks(tmp_path):
    """Negative control of the above: another speed in the bag is another speed in the row."""
    assert table.row_from_bag(bags.trial_bag(tmp_path / "b", speed=0.1)).speed_m_s == pytest.approx(0.1, rel=1e-3)


@pytest.mark.parametrize(
    ("missing", "status"),
    [
        ("/sync_led", "no /sync_led edge"),
        ("/landmarks/com", "no topic /landmarks/com"),
        ("/leg_states", "no topic /leg_states"),
        ("/bed/volume_fraction", "phi not measured"),
    ],
)
def test_what_is_missing_is_said_in_the_status(tmp_path, missing, status):
    row = table.row_from_bag(bags.trial_bag(tmp_path / "b", without=(missing,)))
    assert status in row.status
    assert row.omega_rad_s == 8.0


def test_the_leg_mount_of_the_robot_is_minded(tmp_path):
    """Shaft angles half a radian behind the legs: this body, which never rests, has that much less time to a step."""
    bag = bags.trial_bag(tmp_path / "b", speed=0.2, plan=bags.PLAN | {"leg_mount_rad": 0.5})
    assert table.row_from_bag(bag).first_step_m == pytest.approx(0.2 * (math.pi - 0.5) / 8, rel=0.02)


def test_legs_are_found_by_name_in_whatever_order_they_were_recorded(tmp_path):
    own = table.row_from_bag(bags.trial_bag(tmp_path / "own"))
    order = [3, 0, 4, 1, 5, 2]
    shuffled = bags.trial_bag(tmp_path / "shuffled", legs={leg: topics.LEGS[leg] for leg in order})
    assert replace(table.row_from_bag(shuffled), trial_id=own.trial_id) == own
    # Taken as they come, legs of both tripods would count as one.
    wrong = bags.trial_bag(tmp_path / "wrong", legs={leg: name for leg, name in zip(order, topics.LEGS, strict=True)})
    assert replace(table.row_from_bag(wrong), trial_id=own.trial_id) != own


def test_legs_have_the_names_that_the_robot_gives_them(tmp_path):
    named = {leg: f"joint_{leg}" for leg in range(6)}
    unknown = table.row_from_bag(bags.trial_bag(tmp_path / "a", legs=named))
    assert "/leg_states: no leg 'front_left' (leg_order of the robot) among joint_0, " in unknown.status
    plan = bags.PLAN | {"robot": to_mapping(Robot(leg_order=tuple(named.values())))}
    assert table.row_from_bag(bags.trial_bag(tmp_path / "b", legs=named, plan=plan)).status == "ok"
    # A robot of four legs: what else has a name there is no leg.
    four = {"legs_per_tripod": 2, "leg_order": ("joint_0", "joint_1", "joint_3", "joint_4")}
    plan = bags.PLAN | {"robot": to_mapping(Robot(**four))}
    fewer = table.row_from_bag(bags.trial_bag(tmp_path / "c", legs=named, plan=plan))
    assert fewer.first_step_m == pytest.approx(table.row_from_bag(tmp_path / "b").first_step_m)


@pytest.mark.parametrize("value", ["east", None, [1]])
def test_a_leg_mount_that_is_no_angle_is_said_in_the_status(tmp_path, value):
    row = table.row_from_bag(bags.trial_bag(tmp_path / "b", plan=bags.PLAN | {"leg_mount_rad": value}))
    assert row.status == f"/trial: leg_mount_rad: {value!r} is not an angle [rad]"
    assert math.isnan(row.speed_m_s)


def test_a_trial_that_failed_keeps_its_reason(tmp_path):
    assert table.row_from_bag(bags.trial_bag(tmp_path / "b", exit_status="legs stalled")).status == "legs stalled"


def test_refuses(tmp_path):
    with BagWriter(tmp_path / "empty") as writer:
        writer.add_topic(topics.TRIAL.name, topics.TRIAL.type)
    with pytest.raises(InputError, match="empty bag"):
        table.row_from_bag(tmp_path / "empty")
    with pytest.raises(InputError, match="which trial is it"):
        table.row_from_bag(bags.legs_bag(tmp_path / "legs"))
    with pytest.raises(InputError, match="expected a JSON object"):
        table.row_from_bag(bags.trial_bag(tmp_path / "list", plan=[1]))


def campaign(tmp_path, count=3):
    for index in range(count):
        plan = bags.PLAN | {"trial_id": f"t{index}", "replicate": index}
        bags.trial_bag(tmp_path / "c" / "trials" / f"t{index}", speed=0.1 + index / 100, plan=plan)
    return tmp_path / "c"


@pytest.mark.slow
def test_a_campaign_in_the_same_order_in_one_process_and_in_two(tmp_path, monkeypatch):
    folder = campaign(tmp_path)
    first = table.campaign(folder, Processes(1))
    (folder / table.CACHE).unlink()
    monkeypatch.setattr(table, "_PARALLEL_FROM", 2)
    second = table.campaign(folder, Processes(2))
    assert first.trials.rows() == pytest.approx(second.trials.rows(), nan_ok=True) or repr(first) == repr(second)
    assert first.trials.trial_id.tolist() == ["t0", "t1", "t2"]


def test_bags_are_read_once(tmp_path, monkeypatch):
    folder = campaign(tmp_path)
    first = table.campaign(folder)
    assert first.cached == 0
    read_bags = []
    monkeypatch.setattr(table, "_row_or_reason", lambda bag: read_bags.append(bag) or pytest.fail("read again"))
    second = table.campaign(folder)
    assert (second.cached, read_bags) == (3, [])
    assert repr(second.trials) == repr(first.trials)


def test_bags_nobody_has_touched_are_not_even_hashed(tmp_path, monkeypatch):
    folder = campaign(tmp_path)
    first = table.campaign(folder)
    kept, hashed, hash_of = (folder / table.CACHE).read_bytes(), [], cache.content_hash
    monkeypatch.setattr(cache, "content_hash", lambda bag: hashed.append(bag.name) or hash_of(bag))
    assert table.campaign(folder).cached == 3
    assert (hashed, (folder / table.CACHE).read_bytes()) == ([], kept)
    (folder / "trials" / "t1").rename(folder / "trials" / "t9")
    again = table.campaign(folder)
    assert (again.cached, hashed) == (3, ["t9"])  # known by its content
    assert repr(again.trials) == repr(first.trials)


def test_a_bag_changed_behind_its_size_and_time_is_read_again(tmp_path):
    folder = campaign(tmp_path, 2)
    table.campaign(folder)
    file = folder / "trials" / "t1" / "t1_0.mcap"
    times = file.stat().st_atime_ns, file.stat().st_mtime_ns
    file.write_bytes(file.read_bytes()[:-1] + b"x")
    os.utime(file, ns=times)
    report = table.campaign(folder)
    assert report.cached == 1
    assert len(report.skipped) == 1


@pytest.mark.parametrize("change", [lambda kept: "{", lambda kept: kept.replace('"recipe": "', '"recipe": "0')])
def test_what_is_kept_of_another_recipe_or_torn_is_not_taken(tmp_path, change):
    folder = campaign(tmp_path, 2)
    first, path = table.campaign(folder), folder / table.CACHE
    path.write_text(change(path.read_text()))
    again = table.campaign(folder)
    assert again.cached == 0
    assert repr(again.trials) == repr(first.trials)


def test_a_table_that_is_interrupted_goes_on_from_what_was_kept(tmp_path, monkeypatch):
    folder = campaign(tmp_path)
    monkeypatch.setattr(table, "_CACHE_EVERY", 1)
    read_bag = table._row_or_reason

    def interrupted(bag):
        if bag.name == "t2":
            raise KeyboardInterrupt
        return read_bag(bag)

    monkeypatch.setattr(table, "_row_or_reason", interrupted)
    with pytest.raises(KeyboardInterrupt):
        table.campaign(folder)
    monkeypatch.setattr(table, "_row_or_reason", read_bag)
    assert table.campaign(folder).cached == 2


def files_of_trials(folder, *names):
    """Trials recorded into a file each, without metadata.yaml."""
    folder.mkdir(parents=True)
    for index, name in enumerate(names):
        bag = bags.trial_bag(folder.parent / "own", speed=0.2 - 0.02 * index, plan=bags.PLAN | {"trial_id": name})
        shutil.move(bag / "own_0.mcap", folder / f"{name}.mcap")
        shutil.rmtree(bag)
    return folder


def test_a_folder_of_files_is_a_trial_each(tmp_path):
    folder = files_of_trials(tmp_path / "days", "monday", "tuesday", "trial_1")
    table = read(folder)
    assert dict(zip(table.trial_id, table.speed_m_s.round(3), strict=True)) == {
        "monday": 0.2, "tuesday": 0.18, "trial_1": 0.16
    }  # fmt: skip
    assert table_tool.main([str(folder)]) == 0
    assert len(read_csv(folder / "trials.csv")) == 3
    # Control: a single one in its folder is a bag.
    single = files_of_trials(tmp_path / "single", "monday")
    assert read(single).trial_id.tolist() == ["monday"]


def test_files_that_are_no_one_bag_are_told_where_a_campaign_has_them(tmp_path):
    folder = campaign(tmp_path)
    files_of_trials(folder / "trials" / "t9", "monday", "tuesday")
    (line,) = table.campaign(folder).skipped.values()
    assert "t9: not one bag but a folder of several" in line


def test_a_changed_bag_is_read_again(tmp_path):
    folder = campaign(tmp_path)
    table.make(folder)
    shutil.rmtree(folder / "trials" / "t1")
    bags.trial_bag(folder / "trials" / "t1", speed=0.3, plan=bags.PLAN | {"trial_id": "t1"})
    report = table.campaign(folder)
    assert report.cached == 2
    assert report.trials.speed_m_s[1] == pytest.approx(0.3, rel=1e-3)


def test_a_table_newer_than_the_bags_is_taken_as_it_is(tmp_path):
    folder = campaign(tmp_path)
    edited(folder)
    assert read(folder).status.tolist() == ["camera knocked", "ok", "ok"]


def edited(folder):
    table.make(folder)
    path = folder / table.TRIALS_CSV
    path.write_text(path.read_text().replace(",ok\n", ",camera knocked\n", 1))


def test_what_a_person_says_of_trials_outlives_trials_that_come(tmp_path):
    edited(folder := campaign(tmp_path))
    bags.trial_bag(folder / "trials" / "t9", plan=bags.PLAN | {"trial_id": "t9"})
    for made in (table.campaign, table.make, table.campaign):
        assert made(folder).trials.status.tolist() == ["camera knocked", "ok", "ok", "ok"]
    (folder / "trials" / "t9").rename(tmp_path / "t9")
    report = table.make(folder)
    assert report.trials.status.tolist() == ["camera knocked", "ok", "ok"]
    assert report.trials.unread == ("trials.csv differs from the bags of t0, and is used",)


@pytest.mark.parametrize("as_old", [False, True])
def test_a_trial_that_was_run_again_counts_whatever_the_table_says_of_the_old_one(tmp_path, as_old):
    """Even where the clock was set back: by its times, the table is newer."""
    edited(folder := campaign(tmp_path))
    shutil.rmtree(folder / "trials" / "t0")
    again = bags.trial_bag(folder / "trials" / "t0", speed=0.3, plan=bags.PLAN | {"trial_id": "t0"})
    for file in again.iterdir():
        os.utime(file, (1, 1) if as_old else None)
    report = table.campaign(folder)
    assert report.trials.speed_m_s[0] == pytest.approx(0.3, rel=1e-3)
    assert report.trials.status.tolist() == ["ok", "ok", "ok"]


def test_a_table_that_nobody_has_edited_is_read_anew_with_the_trials_that_come(tmp_path, monkeypatch):
    """Else rows of an earlier version would stand beside those of this one."""
    folder = campaign(tmp_path)
    with monkeypatch.context() as earlier:
        earlier.setattr(cache, "RECIPE", "0")
        earlier.setattr(table.judge, "fault", lambda *_: "of an earlier judge")
        table.make(folder)
    assert table.campaign(folder).trials.excluded == 3
    bags.trial_bag(folder / "trials" / "t9", plan=bags.PLAN | {"trial_id": "t9"})
    assert table.campaign(folder).trials.excluded == 0


def test_without_what_was_kept_the_times_tell_which_rows_are_of_which_bags(tmp_path):
    edited(folder := campaign(tmp_path))
    (folder / table.CACHE).unlink()
    for file in bags.trial_bag(folder / "trials" / "t9", plan=bags.PLAN | {"trial_id": "t9"}).iterdir():
        os.utime(file, (2e9, 2e9))
    assert table.campaign(folder).trials.status.tolist() == ["camera knocked", "ok", "ok", "ok"]


def test_columns_of_ones_own_are_not_written_over(tmp_path, capsys):
    folder = campaign(tmp_path)
    table.make(folder)
    path = folder / table.TRIALS_CSV
    first, *rest = path.read_text().splitlines()
    path.write_text("\n".join([f"{first},note", *(f"{line},wet" for line in rest)]))
    written = path.read_text()
    out = tmp_path / "out.csv"
    for given in ([folder], [folder / "trials" / "t0", "--out", path]):
        assert table_tool.main([str(word) for word in given]) == 2
        assert "trials.csv: has columns that a trials table has no place for (note)" in capsys.readouterr().err
    with pytest.raises(InputError, match="would lose them"):
        table.make(folder)
    assert path.read_text() == written
    # Control: into another file they are left out, which is said; that one may be written over.
    for _ in range(2):
        assert table_tool.main([str(folder), "--out", str(out)]) == 0
        assert "note: columns that are not read: note\n" in capsys.readouterr().out
    assert out.read_text().splitlines()[0] == first


def test_what_is_printed_is_a_table_and_nothing_else(tmp_path, capsys):
    (tmp_path / "own.csv").write_text("phi,omega_rad_s,speed_m_s,status,note\n.6,8,.2,ok,wet\n.6,9,,stuck,dry\n")
    assert table_tool.main([str(tmp_path / "own.csv")]) == 0
    printed = capsys.readouterr()
    (tmp_path / "kept.csv").write_text(printed.out)
    assert len(read(tmp_path / "kept.csv")) == 2
    assert printed.err.splitlines() == ["note: columns that are not read: note", "not usable: row3: stuck"]


def test_bags_that_give_no_row_are_named(tmp_path, capsys):
    folder = campaign(tmp_path)
    file = folder / "trials" / "t1" / "t1_0.mcap"
    assert table_tool.main([str(folder)]) == 0
    file.write_bytes(file.read_bytes()[:-50])
    assert table_tool.main([str(folder)]) == 1
    printed = capsys.readouterr().out
    assert "skipped: " in printed
    assert "recover" in printed
    (note,) = read(folder).unread
    assert note.startswith(f"skipped: {folder}/trials/t1: t1_0.mcap is unfinished")


def damage(bag):
    (file,) = bag.glob("*.mcap")
    file.write_bytes(file.read_bytes()[:-50])


def empty(bag):
    for file in bag.iterdir():
        file.unlink()


@pytest.mark.parametrize("damage", [damage, empty])
def test_the_row_of_a_bag_damaged_since_is_excluded_but_kept(tmp_path, damage):
    folder = campaign(tmp_path)
    whole = table.make(folder).trials.speed_m_s.tolist()
    shutil.copytree(folder / "trials" / "t1", tmp_path / "copy")
    damage(folder / "trials" / "t1")
    for made in (table.make, table.campaign, table.make):
        trials = made(folder).trials
        assert trials.speed_m_s.tolist() == whole
        assert trials.status.tolist() == ["ok", table.UNREADABLE, "ok"]
    assert list(table.campaign(folder).skipped) == [folder / "trials" / "t1"]
    # Brought back from a copy, the bag counts again; a bag that is gone has no row.
    shutil.rmtree(folder / "trials" / "t1")
    (tmp_path / "copy").rename(folder / "trials" / "t1")
    assert table.make(folder).trials.excluded == 0
    shutil.rmtree(folder / "trials" / "t1")
    assert table.make(folder).trials.trial_id.tolist() == ["t0", "t2"]


@pytest.mark.parametrize("cached", [True, False])
@pytest.mark.parametrize("lost", [["t0"], ["t0", "t1", "t2"]])
def test_a_table_brought_back_over_damaged_bags_stops_nothing(tmp_path, lost, cached):
    folder = campaign(tmp_path)
    table.make(folder)
    kept = (folder / table.TRIALS_CSV).read_bytes()
    for name in lost:
        damage(folder / "trials" / name)
    table.make(folder)
    (folder / table.TRIALS_CSV).write_bytes(kept)
    if not cached:
        (folder / table.CACHE).unlink()
    report = table.make(folder)
    assert [bag.name for bag in report.skipped] == lost
    assert report.trials.excluded == len(lost)


@pytest.mark.parametrize("others", [0, 1])
def test_a_row_is_back_with_its_bag(tmp_path, others):
    """As after a network's disk was away, with which all bags are."""
    for number in range(1 + others):
        name = f"t{number:04}"
        bags.trial_bag(tmp_path / "trials" / name, plan=bags.PLAN | {"trial_id": name})
    table.make(tmp_path)
    file, away = tmp_path / "trials/t0000/t0000_0.mcap", tmp_path / "away"
    file.rename(away)
    assert table.make(tmp_path).trials.status[0] == table.UNREADABLE
    assert table.make(tmp_path).trials.status[0] == table.UNREADABLE
    away.rename(file)
    assert list(table.make(tmp_path).trials.status) == ["ok"] * (1 + others)


@pytest.mark.parametrize("what", ["hash", "bag"])
def test_a_bag_that_may_not_be_read_is_skipped_and_not_the_campaign(tmp_path, monkeypatch, what):
    for name in ("a", "b"):
        bags.trial_bag(tmp_path / "trials" / name, plan=bags.PLAN | {"trial_id": name})

    def denying(real):
        def read(path):
            if path.name == "b":
                raise PermissionError(13, "Permission denied", str(path / "metadata.yaml"))
            return real(path)

        return read

    with monkeypatch.context() as patch:
        if what == "hash":
            patch.setattr(cache, "content_hash", denying(cache.content_hash))
        patch.setattr(table, "_measured", denying(table._measured))
        report = table.make(tmp_path)
        assert list(report.trials.trial_id) == ["a"]
        (why,) = report.skipped.values()
        assert why == f"{tmp_path / 'trials/b/metadata.yaml'}: Permission denied"
    assert list(table.make(tmp_path).trials.trial_id) == ["a", "b"]


def test_what_could_not_be_hashed_is_of_no_row_that_is_kept(tmp_path, monkeypatch):
    bags.trial_bag(tmp_path / "trials" / "a", plan=bags.PLAN | {"trial_id": "a"})

    def lost(_):
        raise OSError(5, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr(cache, "content_hash", lost)
        with pytest.raises(InputError, match="its files could not be read a moment ago"):
            table.make(tmp_path)
    assert list(table.make(tmp_path).trials.status) == ["ok"]


def test_a_bag_copied_under_another_name_costs_no_other_trial_its_row(tmp_path):
    folder = campaign(tmp_path)
    first = table.make(folder).trials
    # Sorted before the original, which has the name of its trial.
    shutil.copytree(folder / "trials" / "t1", folder / "trials" / "a copy")
    for made in (table.campaign, table.make, table.campaign):
        report = made(folder)
        assert repr(report.trials.rows()) == repr(first.rows())
        ((bag, why),) = report.skipped.items()
        assert (bag.name, report.bags["t1"].name) == ("a copy", "t1")
        assert why == f"{bag}: trial id 't1' is also that of t1, which is used; move one of them away"


def test_what_was_not_measured_of_a_good_trial_is_told(tmp_path, capsys):
    """The table says how often, info on the bag says why; of a whole trial, of a table and of another bag neither."""
    bag = bags.trial_bag(
        tmp_path / "run" / "trials" / "hidden",
        kept=lambda topic, t_s: t_s < 0.7 or topic not in (topics.FRONT_AXLE, topics.REAR_AXLE),
    )
    whole = bags.trial_bag(bag.parent / "whole", plan=bags.PLAN | {"trial_id": "whole"})
    assert table_tool.main([str(tmp_path / "run")]) == 0
    said = "not measured: lift_m in 1 of 2 usable trials, at 8 rad/s (info on a bag says why)"
    assert capsys.readouterr().out.splitlines()[1:] == [said]
    assert info_tool.main([str(bag)]) == 0
    why = "lift: 0 frames in steady steps, at least 32 are needed"
    assert capsys.readouterr().out.splitlines()[-1] == f"Not measured:      {why}"
    assert table_tool.main([str(tmp_path / "run" / "trials.csv")]) == 0
    for other in (whole, bags.legs_bag(tmp_path / "legs")):
        assert info_tool.main([str(other)]) == 0
    printed = capsys.readouterr()
    assert "not measured" not in (printed.out + printed.err).lower()


def test_the_command_line_refuses_in_one_line(tmp_path, capsys):
    (tmp_path / "b").mkdir()
    assert table_tool.main([str(tmp_path / "b"), "--out", str(tmp_path / "t.csv")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "t.csv").exists()


def test_info_gives_times_to_the_nanosecond():
    assert info_tool._time(1796022482530332686).endswith(":02.530332686 UTC (1796022482.530332686)")


def test_info(tmp_path, capsys):
    bag = bags.trial_bag(tmp_path / "b")
    assert info_tool.main([str(bag)]) == 0
    printed = capsys.readouterr().out
    assert "Topic: /leg_states | Type: sensor_msgs/msg/JointState | Count: 860" in printed
    assert "State:             complete" in printed
    assert "exit_status: ok" in printed
    file = bag / "b_0.mcap"
    file.write_bytes(file.read_bytes()[:-50])
    assert info_tool.main([str(bag)]) == 1
    assert "unfinished" in capsys.readouterr().out
