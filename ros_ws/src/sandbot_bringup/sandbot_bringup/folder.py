"""The campaign folder: its layout, and which trials are still to be run."""

import dataclasses
import fcntl
import os
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from sandbot_bringup.plan import Plan, PlannedTrial, read_plan, to_yaml, trials_of
from sandbot_common.errors import InputError
from sandbot_common.files import check_output, in_the_way, sync, write_text, writing
from sandbot_record.bags.reader import is_bag

PATIENCE_S = 3.0
PARTIAL = ".partial"
"""Inside trials/: where a live run records until its trial is complete. Never deleted."""


@dataclass(frozen=True)
class CampaignFolder:
    """``campaign.yaml``, ``trials/<trial_id>/`` (one bag each), ``trials.csv``, ``report.html``, ``truth/``."""

    path: Path

    @property
    def plan_file(self) -> Path:
        """The plan as it was run."""
        return self.path / "campaign.yaml"

    @property
    def trials(self) -> Path:
        """One bag per trial."""
        return self.path / "trials"

    @property
    def journal(self) -> Path:
        """Events of live runs, and the operator's changes."""
        return self.path / "journal.jsonl"

    @property
    def looks(self) -> Path:
        """The result of each look of a campaign until a verdict."""
        return self.path / "looks.jsonl"

    @property
    def truth(self) -> Path:
        """The virtual lab's sealed world; analysis never looks here."""
        return self.path / "truth" / "world.yaml"

    def bag(self, trial: PlannedTrial) -> Path:
        """Where the bag of ``trial`` goes."""
        return self.trials / trial.trial_id

    def partial(self, trial_id: str) -> Path:
        """Where the bag of an unfinished or failed trial is."""
        return self.trials / PARTIAL / trial_id

    def keep(self, trial: PlannedTrial) -> None:
        """Move the bag of a complete trial from .partial to its place, durably."""
        with writing(self.path):
            self.partial(trial.trial_id).rename(self.bag(trial))
            sync(self.trials)

    def partial_bag(self, trial_id: str) -> Path:
        """``partial``, for a new bag; an earlier one there is renamed and kept."""
        path = self.partial(trial_id)
        with writing(self.path):
            # Not the campaign's folder, too: one that was deleted would come back with half a campaign.
            for folder in (self.trials, path.parent):
                folder.mkdir(exist_ok=True)
            if path.exists():
                number = 1
                while (kept := path.with_name(f"{path.name}.interrupted{number}")).exists():
                    number += 1
                path.rename(kept)
        return path

    def set_aside(self, bags: Mapping[str, str]) -> None:
        """Move these bags, given with their statuses, to .partial, so that their trials are run again."""
        for name, status in bags.items():
            with writing(self.trials / name):
                (self.trials / name).rename(self.partial_bag(name))
            print(f"{name}: {status}: set aside, to be run again")

    def grown(self, plan: Plan) -> Plan:
        """The plan with the extra trials added to this folder since, if it is that plan's folder."""
        if not self.plan_file.exists():
            return plan
        present = read_plan(self.plan_file)
        begins = present.extra_trials[: len(plan.extra_trials)] == plan.extra_trials
        return dataclasses.replace(plan, extra_trials=present.extra_trials) if begins and _same(present, plan) else plan

    def check(self, plan: Plan) -> None:
        """Raise InputError if the folder holds anything but this campaign, or an earlier state of it.

        Its budget can't be lowered below the trials already planned; the operator may have added trials beyond it.
        """
        if self.plan_file.exists():
            present = read_plan(self.plan_file)
            grown = plan.extra_trials[: len(present.extra_trials)] == present.extra_trials
            if not (_same(present, plan) and grown):
                raise InputError(
                    f"{self.path}: holds campaign {present.name!r} with another plan ({_difference(present, plan)}); "
                    "give another --out, or resume it with its own campaign.yaml"
                )
            planned = len(trials_of(present))
            if plan.until and plan.max_trials < min(present.max_trials, planned):
                raise InputError(
                    f"{self.path}: budget: {plan.max_trials} trials are fewer than the {planned} planned already"
                )
        elif blocking := in_the_way(self.path):
            what = "is a file" if blocking == self.path else f"{blocking} is a file"
            raise InputError(f"{self.path}: {what}; give another --out")
        elif self.path.exists() and any(item != self.truth.parent for item in self.path.iterdir()):
            raise InputError(f"{self.path}: exists, is not empty and holds no campaign.yaml; give another --out")
        else:
            check_output(self.plan_file)

    def adopt(self, plan: Plan, files: Mapping[str, str]) -> None:
        """Write the plan and the robot's and cameras' files, or check the plan against the one already there.

        A campaign may grow by extra trials; anything else would mix two experiments in one folder (InputError).
        What has the name of a trial's bag and is none is set aside.
        """
        self.check(plan)
        self._keep(plan, files)

    def _keep(self, plan: Plan, files: Mapping[str, str]) -> None:
        # A trial that has been run could not be given its name.
        strangers = [trial.trial_id for trial in self.missing(trials_of(plan)) if self.bag(trial).exists()]
        self.set_aside(dict.fromkeys(strangers, "not a bag"))
        with writing(self.path):
            for name, text in files.items():
                write_text(self.path / name, text)
            write_text(self.plan_file, to_yaml(plan))

    @contextmanager
    def adopted(self, plan: Plan, files: Mapping[str, str], first: Callable[[], None] = lambda: None) -> Iterator[None]:
        """``adopt`` the plan and lock the folder meanwhile; if refused, nothing has been written.

        ``first`` runs before the plan is written, so that a kill can't leave the plan without its result.
        """
        self.check(plan)
        with writing(self.path):
            self.path.mkdir(parents=True, exist_ok=True)
        with self.locked():
            # Checked again: somebody else may have taken the folder meanwhile.
            self.check(plan)
            first()
            self._keep(plan, files)
            yield

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Context in which nobody else runs trials into this folder, whose bags each would delete or rename.

        Raises InputError if somebody does. The system releases the lock when the process and its workers have ended,
        however they end; the workers of a killed process get a moment to do so.
        """
        handle, until_s = os.open(self.path, os.O_RDONLY), time.monotonic() + PATIENCE_S
        try:
            while not _lock(handle):
                if time.monotonic() > until_s:
                    raise InputError(f"{self.path}: another campaign is running into it; wait for its end")
                time.sleep(0.05)
            yield
        finally:
            os.close(handle)

    def check_there(self) -> None:
        """Raise InputError if the campaign is not in its folder any more."""
        if not self.plan_file.exists():
            raise InputError(
                f"{self.path}: can't be written: its campaign.yaml is gone; was the folder renamed or deleted?"
            )

    def remove_unfinished(self) -> None:
        """Remove the unfinished bags of a killed batch run, which never got their final name, and nothing else."""
        for path in self.trials.glob(".phi*") if self.trials.is_dir() else ():
            if path.is_dir():
                shutil.rmtree(path)

    def missing(self, trials: Iterable[PlannedTrial]) -> list[PlannedTrial]:
        """The trials without a finished bag. A bag gets its name only when closed, so its existence is enough."""
        return [trial for trial in trials if not is_bag(self.bag(trial))]


def sample_trial(plan: Plan) -> PlannedTrial:
    """The trial whose frames are kept by default: the strongest ground at the middle frequency, first replicate.

    In a campaign until a verdict it is the first trial on that ground, whatever comes later.
    """
    omega = sorted(plan.omega_rad_s)[len(plan.omega_rad_s) // 2]
    trials = [trial for trial in trials_of(plan) if trial.phi == max(plan.phi)]
    return next((trial for trial in trials if trial.omega_rad_s == omega), trials[0]) if not plan.until else trials[0]


def frames_kept(plan: Plan, trial: PlannedTrial) -> str:
    """How a trial's frames are stored in its bag: none, jpeg, video or raw."""
    if plan.images != "one":
        return plan.images
    return "jpeg" if trial.trial_id == sample_trial(plan).trial_id else "none"


def lossless_s(plan: Plan, trial: PlannedTrial) -> float:
    """How long a trial's frames are stored lossless [s]; 0 if they are not."""
    lossless = frames_kept(plan, trial) in ("video", "raw")
    return plan.standing_s + plan.duration_s(trial.omega_rad_s) if lossless else 0.0


def _same(present: Plan, given: Plan) -> bool:
    """Whether two plans are of the same campaign, whose extra trials and budget may grow."""
    return dataclasses.replace(given, extra_trials=present.extra_trials, budget=present.budget) == present


def _difference(present: Plan, given: Plan) -> str:
    for field in dataclasses.fields(Plan):
        old, new = getattr(present, field.name), getattr(given, field.name)
        if old != new:
            return f"{field.name}: {old!r} there, {new!r} now"
    return "no difference"


def _lock(handle: int) -> bool:
    """Try to lock an open folder; returns whether that succeeded."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
