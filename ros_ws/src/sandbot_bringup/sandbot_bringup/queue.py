"""A campaign's queue: trials done, under way and to come, and the operator's changes to it. Pure.

Measurements are kept: a finished trial is neither skipped nor replaced; repeating it adds a replicate.
"""

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from statistics import median
from typing import Any

from sandbot_bringup.journal import Event
from sandbot_bringup.plan import Plan, PlannedTrial, trials_of, with_condition
from sandbot_common.errors import InputError


class State(StrEnum):
    """State of a trial."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    SKIPPED = "skipped"


@dataclass
class Entry:
    """One trial in the queue; ``turn`` is its position among those that wait."""

    trial: PlannedTrial
    turn: int
    state: State = State.WAITING
    reason: str = ""
    """Why it failed, was stopped or is skipped; kept until it is under way or repeated."""
    seconds: float = math.nan
    """How long it took, including the bed's preparation."""
    measured: Mapping[str, Any] = field(default_factory=dict)
    """phi, speed_m_s and lift_m of a finished trial, as far as they were measured."""


class Queue:
    """The trials of a plan in the order they are run. An impossible change by the operator raises InputError.

    ``finished``: the trials that have a bag. ``events``: those of a journal; when a campaign is resumed, skipped trials
    stay skipped and failed ones are run again.
    """

    def __init__(self, plan: Plan, finished: Collection[str], events: Iterable[Event] = ()) -> None:
        self.plan = plan
        self.entries: dict[str, Entry] = {}
        self.grow(plan)
        for event in events:
            if (entry := self.entries.get(str(event.get("trial_id")))) is not None:
                self._recall(entry, event)
        for entry in self.entries.values():
            entry.state = State.DONE if entry.trial.trial_id in finished else entry.state
            if entry.state is State.DONE and entry.trial.trial_id not in finished:
                entry.state, entry.measured = State.WAITING, {}

    def grow(self, plan: Plan) -> list[str]:
        """Append the trials that have been added to a plan; returns their names."""
        new = [trial for trial in trials_of(plan) if trial.trial_id not in self.entries]
        first = self._last_turn + 1
        for turn, trial in enumerate(sorted(new, key=lambda trial: trial.run_order), start=first):
            self.entries[trial.trial_id] = Entry(trial, turn)
        self.plan = plan
        return [trial.trial_id for trial in new]

    def take(self, other: "Queue") -> None:
        """Take over the state of a changed copy."""
        self.plan, self.entries = other.plan, other.entries

    @property
    def _last_turn(self) -> int:
        return max((entry.turn for entry in self.entries.values()), default=0)

    def _recall(self, entry: Entry, event: Event) -> None:
        match event["do"]:
            case "skip":
                entry.state, entry.reason = State.SKIPPED, "skipped by the operator"
            case "repeat":
                entry.state, entry.reason = State.WAITING, ""
            case "failed" | "stopped":
                entry.reason = str(event.get("reason", ""))
            case "done":
                entry.state, entry.reason = State.DONE, ""
                entry.seconds = float(event.get("seconds", math.nan))
                entry.measured = event.get("measured", {})

    def next(self) -> PlannedTrial | None:
        """The trial whose turn it is; None if nothing waits."""
        waiting = [entry for entry in self.entries.values() if entry.state is State.WAITING]
        return min(waiting, key=lambda entry: entry.turn).trial if waiting else None

    @property
    def waiting(self) -> int:
        """How many trials wait."""
        return sum(entry.state is State.WAITING for entry in self.entries.values())

    def begin(self, trial_id: str) -> None:
        """A trial is under way."""
        self.entries[trial_id].state, self.entries[trial_id].reason = State.RUNNING, ""

    def finish(self, trial_id: str, seconds: float, measured: Mapping[str, Any]) -> None:
        """The trial is done; its bag is closed."""
        entry = self.entries[trial_id]
        entry.state, entry.reason, entry.seconds, entry.measured = State.DONE, "", seconds, measured

    def fail(self, trial_id: str, reason: str) -> None:
        """The trial failed."""
        self.entries[trial_id].state, self.entries[trial_id].reason = State.FAILED, reason

    def put_back(self, trial_id: str, reason: str) -> None:
        """The trial was stopped by hand, and is still next."""
        self.entries[trial_id].state, self.entries[trial_id].reason = State.WAITING, reason

    def skip(self, trial_id: str) -> str:
        """Skip a trial that waits or failed; returns a message."""
        entry = self._entry(trial_id)
        if entry.state in (State.RUNNING, State.DONE):
            raise InputError(f"{trial_id} is {entry.state}; only a trial that waits or failed can be skipped")
        entry.state, entry.reason = State.SKIPPED, "skipped by the operator"
        return f"{trial_id} is skipped"

    def repeat(self, trial_id: str) -> str:
        """Run a failed or skipped trial at the end of the queue, or add a replicate of a finished one."""
        entry = self._entry(trial_id)
        trial = entry.trial
        if entry.state is State.DONE:
            condition = {"phi": trial.phi, "omega_rad_s": trial.omega_rad_s, "replicates": 1, "gait": trial.gait}
            return self.add(condition)
        if entry.state not in (State.FAILED, State.SKIPPED):
            raise InputError(f"{trial_id} is {entry.state}; only a trial that is over can be repeated")
        entry.state, entry.reason, entry.turn = State.WAITING, "", self._last_turn + 1
        return f"{trial_id} is run again, at the end"

    def add(self, condition: Mapping[str, Any]) -> str:
        """Trials of one more condition (phi, omega_rad_s, replicates, gait) at the end of the queue."""
        new = self.grow(with_condition(self.plan, condition, "add"))
        return f"{', '.join(new)} added, at the end"

    def _entry(self, trial_id: str) -> Entry:
        if trial_id not in self.entries:
            raise InputError(f"there is no trial {trial_id!r} in this campaign")
        return self.entries[trial_id]

    @property
    def measured(self) -> bool:
        """Whether any trial is done."""
        return any(entry.state is State.DONE for entry in self.entries.values())

    @property
    def skipped(self) -> list[str]:
        """Names of the trials the operator has skipped."""
        return [name for name, entry in self.entries.items() if entry.state is State.SKIPPED]

    @property
    def failed(self) -> dict[str, str]:
        """Reasons of the failed trials, by name."""
        return {name: entry.reason for name, entry in self.entries.items() if entry.state is State.FAILED}

    def left_s(self) -> float:
        """Estimated seconds until nothing waits; NaN before the first trial is done.

        The time of a trial besides its walk (bed, recorder, standing) is taken as the median over finished trials.
        """
        done = [entry for entry in self.entries.values() if math.isfinite(entry.seconds)]
        if not done:
            return math.nan
        besides_s = median(entry.seconds - self._walk_s(entry) for entry in done)
        to_come = [entry for entry in self.entries.values() if entry.state in (State.WAITING, State.RUNNING)]
        return sum(self._walk_s(entry) + besides_s for entry in to_come)

    def _walk_s(self, entry: Entry) -> float:
        return self.plan.duration_s(entry.trial.omega_rad_s)

    def rows(self) -> list[dict[str, Any]]:
        """The queue as plain values for JSON, in order of turn."""
        return [_row(entry) for entry in sorted(self.entries.values(), key=lambda entry: entry.turn)]


def _row(entry: Entry) -> dict[str, Any]:
    trial = entry.trial
    return {
        "trial_id": trial.trial_id,
        "phi": trial.phi,
        "omega_rad_s": trial.omega_rad_s,
        "gait": trial.gait,
        "replicate": trial.replicate,
        "state": entry.state.value,
        "reason": entry.reason,
        "because": trial.because,
        "seconds": round(entry.seconds, 1) if math.isfinite(entry.seconds) else None,
        "measured": dict(entry.measured),
    }
