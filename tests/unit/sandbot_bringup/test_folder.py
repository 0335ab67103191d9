import dataclasses
import os
import shutil
from pathlib import Path

import bags
import pytest

from sandbot_bringup import folder as folders
from sandbot_bringup.batch import Setup, run_trial, seal
from sandbot_bringup.config import files_of
from sandbot_bringup.folder import CampaignFolder, frames_kept, lossless_s, sample_trial
from sandbot_bringup.plan import Plan, read_plan, trials_of
from sandbot_bringup.tools import campaign
from sandbot_bringup.tools.campaign import main
from sandbot_bringup.trial_bag import TrialBag
from sandbot_common import topics
from sandbot_common.errors import InputError
from sandbot_common.parameters import specs
from sandbot_lab.world import null_world
from sandbot_record.trials import from_bags

PLAN = Plan(name="tiny", phi=(0.6, 0.62), omega_rad_s=(8.0, 16.0), replicates=2)
EXTRA = {"phi": 0.61, "omega_rad_s": 12.0, "replicates": 1}


def test_adopted_plan_is_read_back_and_adopted_again(tmp_path: Path) -> None:
    folder = CampaignFolder(tmp_path / "run")
    folder.adopt(PLAN, {})
    folder.adopt(PLAN, {})
    assert read_plan(folder.plan_file) == PLAN


def test_plan_may_grow_by_extra_trials_but_not_shrink(tmp_path: Path) -> None:
    folder = CampaignFolder(tmp_path)
    folder.adopt(PLAN, {})
    grown = dataclasses.replace(PLAN, extra_trials=(EXTRA,))
    folder.adopt(grown, {})
    with pytest.raises(InputError, match="extra_trials"):
        folder.adopt(PLAN, {})
    assert read_plan(folder.plan_file) == grown


def test_a_budget_is_not_lowered_below_what_is_planned(tmp_path: Path) -> None:
    """Lowered to that, or unchanged and exceeded by an operator's trial, it is adopted."""
    folder = CampaignFolder(tmp_path)
    of_four = dataclasses.replace(PLAN, until="verdict", budget=6, extra_trials=({**EXTRA, "replicates": 4},))
    folder.adopt(of_four, {})
    with pytest.raises(InputError, match="budget: 3 trials are fewer than the 4 planned already"):
        folder.adopt(dataclasses.replace(of_four, budget=3), {})
    exceeded = dataclasses.replace(of_four, budget=4, extra_trials=(*of_four.extra_trials, EXTRA))
    folder.adopt(exceeded, {})
    folder.adopt(exceeded, {})
    assert read_plan(folder.plan_file) == exceeded


def test_another_plan_is_refused_and_nothing_changes(tmp_path: Path) -> None:
    folder = CampaignFolder(tmp_path)
    folder.adopt(PLAN, {})
    before = folder.plan_file.read_bytes()
    with pytest.raises(InputError, match="seed: 1 there, 2 now"):
        folder.adopt(dataclasses.replace(PLAN, seed=2), {})
    assert folder.plan_file.read_bytes() == before


def test_folder_with_other_things_in_it_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(InputError, match=r"holds no campaign\.yaml"):
        CampaignFolder(tmp_path).adopt(PLAN, {})
    assert [one.name for one in tmp_path.iterdir()] == ["thesis.txt"]


def test_one_campaign_at_a_time_runs_into_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(folders, "PATIENCE_S", 0.1)
    folder, other = CampaignFolder(tmp_path), CampaignFolder(tmp_path / "other")
    other.adopt(PLAN, {})
    with (
        folder.locked(),
        other.locked(),
        pytest.raises(InputError, match="another campaign is running"),
        folder.locked(),
    ):
        pass
    with folder.locked():
        pass


def test_who_is_refused_has_written_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(folders, "PATIENCE_S", 0.1)
    folder, grown = CampaignFolder(tmp_path / "new" / "run"), dataclasses.replace(PLAN, extra_trials=(EXTRA,))
    with folder.adopted(PLAN, {}), pytest.raises(InputError, match="is running"), folder.adopted(grown, {}):
        pass
    assert read_plan(folder.plan_file) == PLAN
    with folder.adopted(grown, {}):
        assert read_plan(folder.plan_file) == grown


def test_what_comes_first_is_there_before_the_plan(tmp_path: Path) -> None:
    """A truth that is sealed after it could be missing for ever, and the campaign go on in another world."""
    folder = CampaignFolder(tmp_path / "run")

    def killed() -> None:
        folder.truth.parent.mkdir()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), folder.adopted(PLAN, {}, killed):
        pass
    assert not folder.plan_file.exists()
    with folder.adopted(PLAN, {}):
        assert read_plan(folder.plan_file) == PLAN


def test_only_bags_that_never_got_their_name_are_cleared(tmp_path: Path) -> None:
    folder = CampaignFolder(tmp_path)
    torn = folder.trials / ".phi0.6000_w08.000_r01.x1y2"
    kept = [folder.trials / ".ipynb_checkpoints", folder.trials / ".partial", folder.trials / ".DS_Store"]
    for one in (torn, *kept[:2]):
        one.mkdir(parents=True)
    kept[2].touch()
    folder.remove_unfinished()
    assert not torn.exists()
    assert all(one.exists() for one in kept)


def test_a_bag_is_set_aside_where_nothing_has_been_before(tmp_path: Path) -> None:
    assert CampaignFolder(tmp_path).partial_bag("phi0.6000_w08.000_r01").parent.is_dir()


def test_missing_counts_only_closed_bags(tmp_path: Path) -> None:
    folder, trials = CampaignFolder(tmp_path), trials_of(PLAN)
    for trial in trials[:2]:
        folder.bag(trial).mkdir(parents=True)
    (folder.bag(trials[0]) / "metadata.yaml").touch()
    assert folder.missing(trials) == trials[1:]


def test_a_bag_that_lost_its_metadata_is_finished_and_what_is_no_bag_makes_way(tmp_path, capsys):
    """As the table and info have it; else its trial is run again, and the new bag can't be given its name."""
    folder, trials = CampaignFolder(tmp_path), trials_of(PLAN)
    folder.adopt(PLAN, files_of(PLAN, tmp_path, folder.path))
    (bag,) = with_bags(folder, "ok")
    (bag / "metadata.yaml").unlink()
    for trial in trials[1:3]:
        folder.bag(trial).mkdir(parents=True)
    assert folder.missing(trials) == trials[1:]
    grown = dataclasses.replace(PLAN, extra_trials=(EXTRA,))
    folder.bag(trials_of(grown)[-1]).touch()
    folder.adopt(PLAN, {})
    assert bag.is_dir()
    gone = [trial.trial_id for trial in trials[1:3]]
    assert capsys.readouterr().out == "".join(f"{name}: not a bag: set aside, to be run again\n" for name in gone)
    assert sorted(one.name for one in (folder.trials / ".partial").iterdir()) == sorted(gone)
    # Control: a plan that does not grow leaves what is not its own.
    assert folder.bag(trials_of(grown)[-1]).exists()
    folder.adopt(grown, {})
    assert not folder.bag(trials_of(grown)[-1]).exists()


def test_sample_is_the_strongest_ground_at_the_middle_frequency() -> None:
    sample = sample_trial(PLAN)
    assert (sample.phi, sample.omega_rad_s, sample.replicate) == (0.62, 16.0, 1)


@pytest.mark.parametrize(
    ("images", "of_sample", "of_others"),
    [("one", "jpeg", "none"), ("none", "none", "none"), ("jpeg", "jpeg", "jpeg"), ("raw", "raw", "raw")],
)
def test_frames_are_kept_as_the_plan_says(images: str, of_sample: str, of_others: str) -> None:
    plan = dataclasses.replace(PLAN, images=images)
    sample = sample_trial(plan)
    assert frames_kept(plan, sample) == of_sample
    assert {frames_kept(plan, one) for one in trials_of(plan) if one != sample} == {of_others}


@pytest.mark.parametrize(("images", "stored"), [("video", True), ("raw", True), ("jpeg", False), ("one", False)])
def test_only_lossless_frames_need_room_of_their_own(images: str, stored: bool) -> None:
    plan = dataclasses.replace(PLAN, images=images, standing_s=1.0, min_duration_s=5.0, periods=3.0)
    assert lossless_s(plan, sample_trial(plan)) == 6.0 * stored


def test_campaign_without_a_plan_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_campaign_whose_folder_was_deleted_does_not_make_it_anew(tmp_path: Path) -> None:
    folder = CampaignFolder(tmp_path / "run")
    with folder.adopted(PLAN, {}):
        assert folder.partial_bag("one").parent.is_dir()  # it is there
        shutil.rmtree(folder.path)
        with pytest.raises(InputError, match="run: can't be written: No such file"):
            folder.partial_bag("one")
    assert not folder.path.exists()


def test_what_failed_is_set_aside_only_by_who_can_run_it_again(tmp_path, monkeypatch, capsys):
    folder = CampaignFolder(tmp_path / "run")
    folder.adopt(PLAN, files_of(PLAN, tmp_path, folder.path))
    seal(folder, null_world())
    bag = folder.bag(trials_of(PLAN)[0])
    bag.mkdir(parents=True)
    monkeypatch.setattr(campaign, "_not_ok", lambda _: {bag.name: "no markers"})
    assert main([str(folder.path), "--batch", "--redo", "failed", "--dask", "tcp://127.0.0.1:1"]) == 2
    assert "--dask" in capsys.readouterr().err
    assert bag.is_dir()
    # Control: who can.
    folder.set_aside({bag.name: "no markers"})
    assert not bag.exists()
    assert (folder.trials / ".partial" / bag.name).is_dir()


def test_what_is_run_again_is_chosen_by_who_has_the_folder(tmp_path, monkeypatch, capsys):
    alone = []

    def not_ok(folder):
        handle = os.open(folder.path, os.O_RDONLY)
        alone.append(not folders._lock(handle))
        os.close(handle)
        return {"phi0.6": "gone meanwhile"}

    monkeypatch.setattr(campaign, "_not_ok", not_ok)
    folder = CampaignFolder(tmp_path / "run")
    folder.adopt(PLAN, files_of(PLAN, tmp_path, folder.path))
    seal(folder, null_world())
    assert main([str(folder.path), "--batch", "--redo", "failed"]) == 2
    assert "phi0.6: can't be written: No such file" in capsys.readouterr().err
    assert alone == [False, True]


def with_bags(folder: CampaignFolder, *statuses: str) -> list[Path]:
    """A bag each of the plan's first trials; one that is ``lost`` was cut by a power cut."""
    found = []
    for trial, status in zip(trials_of(PLAN), statuses, strict=False):
        plan = bags.PLAN | {"trial_id": trial.trial_id}
        bag = bags.trial_bag(folder.bag(trial), plan=plan, exit_status=status)
        if status == "lost":
            (file,) = bag.glob("*.mcap")
            file.write_bytes(file.read_bytes()[:-50])
        found.append(bag)
    return found


def test_a_bag_that_gives_no_row_is_no_finished_trial(tmp_path, capsys):
    folder = CampaignFolder(tmp_path)
    good, lost = with_bags(folder, "ok", "lost")
    assert campaign._finish(folder, trials_of(PLAN), []) == 1
    printed = capsys.readouterr().out
    assert f"skipped: {lost}: " in printed
    assert "1 of 8 trials" in printed
    assert [*campaign._not_ok(folder)] == [lost.name]
    # Control: all are whole; and none is.
    shutil.rmtree(lost)
    assert campaign._finish(folder, trials_of(PLAN), []) == 0
    shutil.rmtree(good)
    names = [bag.name for bag in with_bags(folder, "lost", "lost")]
    assert [*campaign._not_ok(folder)] == names


def test_what_is_not_ok_is_told_by_the_name_of_its_bag(tmp_path):
    folder = CampaignFolder(tmp_path)
    _, failed = with_bags(folder, "ok", "legs stalled")
    failed.rename(folder.trials / "wet")
    for _ in range(2):  # of the bags, then of the table
        assert campaign._not_ok(folder) == {"wet": "legs stalled"}
        from_bags.make(folder.path)
    path = folder.path / from_bags.TRIALS_CSV
    path.write_text(path.read_text().replace(failed.name, "of no bag"))
    assert campaign._not_ok(folder) == {}


@pytest.mark.parametrize(
    ("bed", "words", "said"),
    [
        ("{phi_close: 0.59}", "", "target_phi 0.6 can't be reached"),
        ("{pulse_on_s: 0.01, pulse_min_s: 0.01}", "--batch", "pulse_on_s 0.01 s is shorter than a step"),
        ("{}", "--batch --ros-args -r __ns:=/x", "--ros-args: --batch runs without ROS"),
        ("{}", "--ros-args -p silence:=9.0", "-p silence: campaign is set by options of its own (see --help)"),
        ("{}", "--out /proc/x/y", "no file can be made in /proc"),
    ],
)
def test_a_dry_run_refuses_what_the_run_would(tmp_path, capsys, bed, words, said):
    plan = tmp_path / "plan.yaml"
    plan.write_text(f"name: tiny\nphi: [0.6]\nomega_rad_s: [8]\nbed: {bed}\n")
    assert main([str(plan), "--dry-run", *words.split()]) == 2
    assert said in capsys.readouterr().err


def test_a_disk_that_takes_no_bag_is_one_line(tmp_path):
    folder = CampaignFolder(tmp_path)
    folder.trials.touch()
    with pytest.raises(InputError, match=f"{tmp_path}: can't be written: "):
        folder.partial_bag("one")
    with pytest.raises(InputError, match=f"{tmp_path}: can't be written: "):
        folder.set_aside({"one": "failed"})


@pytest.mark.parametrize(("words", "budget"), [(["--budget", "9"], 9), ([], 0)])
def test_a_budget_of_the_command_line_is_taken(words, budget):
    """In a plan's file 0 stays what it is documented to be: the whole grid."""
    plan = dataclasses.replace(PLAN, until="verdict", budget=0)
    assert campaign._until(plan, campaign._parser().parse_args(words)).budget == budget


@pytest.mark.parametrize("given", ["0", "-1"])
def test_a_budget_of_nothing_is_not_the_whole_grid(given):
    with pytest.raises(InputError, match=f"--budget {given}: 1 or more trials are needed; leave it out"):
        campaign.command(["plan.yaml", "--until", "verdict", "--budget", given])


@pytest.mark.parametrize("key", ["alpha", "model", "bed_scatter", "bed_drift"])
def test_an_option_of_the_verdict_says_what_its_key_of_a_plan_does(key):
    action = {one.dest: one for one in campaign._parser()._actions}[key]
    spec = {one.name: one for one in specs(Plan)}[key]
    assert (action.type, action.default) == (spec.type, None)
    assert action.help == f"{spec.doc} (--until; default: {getattr(PLAN, key)})"


def test_a_campaign_whose_folder_was_renamed_makes_no_new_one(tmp_path):
    """It wrote on into a folder of the old name, without plan and seal."""
    folder = CampaignFolder(tmp_path / "run")
    folder.adopt(PLAN, {})
    trial = trials_of(PLAN)[0]
    folder.path.rename(tmp_path / "monday")
    with pytest.raises(InputError, match=r"run: can't be written: its campaign.yaml is gone; was the folder renamed"):
        run_trial(Setup(PLAN, null_world(), folder, {}), trial, 0)
    with pytest.raises(FileNotFoundError):  # a moment later
        TrialBag(0, topics.LEGS).write(folder.bag(trial), {}, {})
    assert not folder.path.exists()
    # Control: it is there, and its first bag makes trials/.
    back = CampaignFolder(tmp_path / "monday")
    back.check_there()
    TrialBag(0, topics.LEGS).write(back.bag(trial), {}, {})
    assert back.bag(trial).is_dir()


@pytest.mark.parametrize(("is_batch", "said"), [(True, "run --batch; "), (False, "run; ")])
def test_who_interrupts_a_campaign_is_told_how_to_go_on(tmp_path, capsys, is_batch, said):
    def interrupted(folder):
        with pytest.raises(KeyboardInterrupt), campaign._interruptible(folder):
            raise KeyboardInterrupt
        return capsys.readouterr().out

    folder = CampaignFolder(tmp_path / "run")
    assert interrupted(folder) == ""  # nothing has begun
    folder.adopt(PLAN, {})
    if is_batch:
        seal(folder, null_world())
    assert interrupted(folder).startswith(f"to go on: trackway campaign {tmp_path / said}")
