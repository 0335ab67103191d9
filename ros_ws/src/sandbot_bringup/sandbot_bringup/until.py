"""``campaign --until verdict``: after every block look at the trials so far, and plan the next block or stop.

The plan's grid says where trials may be run. A campaign starts with conditions spread over it, twice each; then a block
is planned at each look (``sandbot_model.design``). The result of a look is a line of ``looks.jsonl``, with the number
of trials planned and finished by then, so that a resumed campaign takes the same decisions without looking again.
``discovery.json`` is that of the last look.
"""

from collections import Counter
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from statistics import median
from typing import Any

import numpy as np

from sandbot_bringup.folder import CampaignFolder
from sandbot_bringup.journal import remove_torn_line
from sandbot_bringup.plan import ExtraTrials, Plan, trials_of, with_block
from sandbot_common.errors import InputError
from sandbot_common.files import append_line, parse_json, read_text, write_json
from sandbot_common.parallel import Processes, Workers
from sandbot_common.parameters import from_mapping
from sandbot_common.suggest import did_you_mean
from sandbot_record.bags import metadata

START = "the start: spread over the plan"
REPLICATES = 2
"""Trials of each condition of the start, which give the pure error."""

ALONE = Processes(1)

Entry = Mapping[str, Any]
"""A look as a line of ``looks.jsonl``: ``look`` 1, 2, ..., trials ``planned`` and ``finished`` by then, ``text``,
what ``Look.to_dict`` has, and the ``budget`` of trials if the look stops because it is used up."""


def with_start(plan: Plan, where: str = "plan") -> Plan:
    """The plan with its starting conditions, after any extra trials it already has; unchanged if they are planned.

    Raises InputError, opened by ``where``, if the base model is unknown, or the budget too small for the start.
    """
    # Imported here, because it loads all of the fitting code, which most campaigns don't need.
    from sandbot_model.design.start import start
    from sandbot_model.physics.walking import BASES

    if plan.model not in BASES:
        raise InputError(f"{where}: model: {plan.model!r} is not a base model{did_you_mean(plan.model, BASES)}")
    conditions = start(plan.phi, plan.omega_rad_s)
    planned = Counter((trial.phi, trial.omega_rad_s) for trial in trials_of(plan) if not trial.gait)
    if all(planned[condition] >= REPLICATES for condition in conditions):
        return plan
    grown = with_block(
        plan,
        [{"phi": phi, "omega_rad_s": omega, "replicates": REPLICATES, "because": START} for phi, omega in conditions],
    )
    if plan.max_trials < (least := len(trials_of(grown))):
        raise InputError(f"{where}: budget: {plan.max_trials} trials are fewer than the {least} it starts with")
    return grown


def decide(
    plan: Plan, folder: CampaignFolder, vetoed: Collection[str] = (), workers: Workers = ALONE
) -> tuple[Plan, Entry]:
    """The plan with the next block, or unchanged if the campaign is over, and the look that says why.

    Conditions of trials that the operator has skipped, ``vetoed``, are not planned again.
    """
    trials = trials_of(plan)
    done = len(trials) - len(folder.missing(trials))
    known = {"planned": len(trials), "finished": done, "ok": _count_ok(folder, workers)}
    entries = looks_of(folder)
    entry = next((e for e in reversed(entries) if _is_current(e, known) and not _budget_has_changed(e, plan)), None)
    if entry is None:
        entry = {"look": len(entries) + 1, **known, **_look(plan, folder, vetoed, len(entries) + 1, workers)}
        remove_torn_line(folder.looks)
        append_line(folder.looks, entry)
    return with_block(plan, entry["next"]) if entry["next"] else plan, entry


def _count_ok(folder: CampaignFolder, workers: Workers) -> int:
    """The number of trials that are ok now; a failed one may have been run again since the last look."""
    from sandbot_record.trials import from_bags
    from sandbot_record.trials.table import OK

    try:
        return int((from_bags.campaign(folder.path, workers).trials.status == OK).sum())
    except InputError:
        return 0  # no usable trial; the look explains it


def _is_current(entry: Entry, known: Mapping[str, int]) -> bool:
    """Whether a look saw exactly these trials."""
    return all(entry.get(key) == value for key, value in known.items())


def _budget_has_changed(entry: Entry, plan: Plan) -> bool:
    """Whether a look stopped because of a budget that is another one now."""
    return "budget" in entry and bool(entry["budget"] != plan.max_trials)


def looks_of(folder: CampaignFolder) -> list[Entry]:
    """Every look so far. Raises InputError with the first invalid line."""
    if not folder.looks.exists():
        return []
    # An incomplete last line, left by a kill, is dropped; that look is repeated.
    lines = read_text(folder.looks, "looks").split("\n")[:-1]
    return [_entry(line, f"{folder.looks}: line {number}") for number, line in enumerate(lines, start=1)]


def _entry(line: str, where: str) -> Entry:
    found = parse_json(line, where)
    kinds = {"look": int, "planned": int, "finished": int, "text": str, "next": list}
    if not isinstance(found, dict) or not all(isinstance(found.get(key), kind) for key, kind in kinds.items()):
        raise InputError(f"{where}: not a look of a campaign: {line[:80]!r}")
    for index, condition in enumerate(found["next"]):
        from_mapping(ExtraTrials, condition, f"{where}: next[{index}]")
    return found


def _look(plan: Plan, folder: CampaignFolder, vetoed: Collection[str], number: int, workers: Workers) -> Entry:
    from sandbot_model.data.conditions import cells_of
    from sandbot_model.design import look as design
    from sandbot_model.discovery.criteria import of_bed
    from sandbot_model.physics.catalogue import catalogue
    from sandbot_record.trials import from_bags

    trials = trials_of(plan)
    refused = {(trial.phi, trial.omega_rad_s) for trial in trials if trial.trial_id in vetoed}
    grid = [(phi, omega) for phi in plan.phi for omega in plan.omega_rad_s if (phi, omega) not in refused]
    if not grid:
        raise InputError(f"{plan.name}: every condition of the plan has been skipped: there is nothing left to run")
    offered = design.Plan(grid, trial_cost(plan, folder), plan.replicates, plan.gait_name)
    cells = cells_of(from_bags.campaign(folder.path, workers).trials)
    with workers.map() as fit_all:
        found = design.look(
            cells, catalogue(), offered, number=number, base=plan.model, alpha=plan.alpha,
            criteria=of_bed(plan.bed_scatter, plan.bed_drift), fit_all=fit_all,
        )  # fmt: skip
    write_json(folder.path / "discovery.json", found.found.to_dict())
    remaining = max(plan.max_trials - len(trials), 0)
    spent = {} if found.stop or remaining else {"budget": plan.max_trials}
    stop = f"the budget of {plan.max_trials} trials is used up" if spent else found.stop
    found = replace(found, stop=stop, block=found.block[:remaining])
    return {**found.to_dict(), "text": str(found), **spent}


def trial_cost(plan: Plan, folder: CampaignFolder) -> Callable[[tuple[float, float]], float]:
    """The time that a trial at (φ, ω) takes [s]: its walk, and the bed's preparation.

    The bed's time is interpolated over φ between medians of past trials.
    """
    beds: dict[float, list[float]] = {}
    for trial in trials_of(plan):
        if not folder.missing([trial]) and (info := metadata.read(folder.bag(trial))) is not None:
            begun_ns, ended_ns = min(file.start_ns for file in info.files), max(file.end_ns for file in info.files)
            walk_s = plan.duration_s(trial.omega_rad_s) + plan.standing_s
            beds.setdefault(trial.phi, []).append(1e-9 * (ended_ns - begun_ns) - walk_s)
    levels = sorted(beds)
    bed_s = [max(median(beds[phi]), 0.0) for phi in levels]

    def cost(condition: tuple[float, float]) -> float:
        phi, omega = condition
        return float(np.interp(phi, levels or [phi], bed_s or [0.0])) + plan.standing_s + plan.duration_s(omega)

    return cost
