"""``campaign --until verdict``: after every block look at what there is, and plan the next one or stop.

The plan's grid says where trials may be run. A campaign starts with conditions spread over it, twice each; then a block
is planned at each look (``sandbot_model.design``). What a look found stands in ``looks.jsonl``, one line a look, with
how many trials were planned and finished by then: whoever resumes takes the same decisions without looking again.
``discovery.json`` is the last one's.
"""

from collections.abc import Collection, Mapping
from dataclasses import replace
from statistics import median
from typing import Any

import numpy as np

from sandbot_bringup.folder import CampaignFolder
from sandbot_bringup.journal import end_torn_line
from sandbot_bringup.plan import ExtraTrials, Plan, trials_of, with_block
from sandbot_common.crew import Crew, Processes
from sandbot_common.errors import InputError
from sandbot_common.files import append_line, parse_json, read_text, write_json
from sandbot_common.parameters import from_mapping
from sandbot_common.suggest import did_you_mean
from sandbot_record.bags import metadata

START = "the start: spread over the plan"
REPLICATES = 2
"""Trials of each condition of the start: pure error comes from them."""

ALONE = Processes(1)

Entry = Mapping[str, Any]
"""A look as a line of ``looks.jsonl``: ``look`` 1, 2, ..., trials ``planned`` and ``finished`` by then, and what
``Look.to_dict`` has."""


def begun(plan: Plan) -> Plan:
    """The plan with its start; what was in it already is run first. Unchanged where it has begun.

    Raises InputError where the base model is not known, or the grid has no room for a verdict.
    """
    # Here, because all that fits comes with it, and most campaigns need none of that.
    from sandbot_model.design.start import start
    from sandbot_model.physics.walking import BASES

    if plan.model not in BASES:
        raise InputError(f"{plan.name}: model: {plan.model!r} is no base model{did_you_mean(plan.model, BASES)}")
    if any(extra.get("because") == START for extra in plan.extra_trials):
        return plan
    conditions = start(plan.phi, plan.omega_rad_s)
    grown = with_block(
        plan,
        [{"phi": phi, "omega_rad_s": omega, "replicates": REPLICATES, "because": START} for phi, omega in conditions],
    )
    if plan.most < (least := len(trials_of(grown))):
        raise InputError(f"{plan.name}: budget: {plan.most} trials are fewer than the {least} that it starts with")
    return grown


def decided(plan: Plan, folder: CampaignFolder, vetoed: Collection[str] = (), crew: Crew = ALONE) -> tuple[Plan, Entry]:
    """The plan with the next block, or as it was where the campaign is over, and the look that says why.

    Conditions of trials that the operator has skipped, ``vetoed``, are not asked for again.
    """
    trials = trials_of(plan)
    known = {"planned": len(trials), "finished": len(trials) - len(folder.missing(trials)), "ok": _ok(folder, crew)}
    entries = looks_of(folder)
    entry = next((one for one in reversed(entries) if _says_of(known, one) and not _may_go_on(one, plan)), None)
    if entry is None:
        entry = {"look": len(entries) + 1, **known, **_look(plan, folder, vetoed, len(entries) + 1, crew)}
        end_torn_line(folder.looks)
        append_line(folder.looks, entry)
    return with_block(plan, entry["next"]) if entry["next"] else plan, entry


def _ok(folder: CampaignFolder, crew: Crew) -> int:
    """How many trials are ok now; a failed one may have been run again since."""
    from sandbot_record.trials import from_bags
    from sandbot_record.trials.table import OK

    try:
        return int((from_bags.campaign(folder.path, crew).trials.status == OK).sum())
    except InputError:
        return 0  # of no trial that can be used the look says more


def _says_of(known: Mapping[str, int], entry: Entry) -> bool:
    """Whether a look saw just these trials; those of earlier versions do not say how many were ok."""
    return all(entry.get(key, value) == value for key, value in known.items())


def _used_up(budget: int) -> str:
    return f"the budget of {budget} trials is used up"


def _may_go_on(entry: Entry, plan: Plan) -> bool:
    """Whether a look stopped for a budget that is larger now."""
    stop = str(entry.get("stop", ""))
    return stop.startswith(_used_up(0).partition("0")[0]) and stop != _used_up(plan.most)


def looks_of(folder: CampaignFolder) -> list[Entry]:
    """Every look so far. InputError with the line that is none."""
    if not folder.looks.exists():
        return []
    # What a kill left of the last line is looked at again.
    lines = read_text(folder.looks, "looks").split("\n")[:-1]
    return [_entry(line, f"{folder.looks}: line {number}") for number, line in enumerate(lines, start=1)]


def _entry(line: str, where: str) -> Entry:
    found = parse_json(line, where)
    kinds = {"look": int, "planned": int, "finished": int, "text": str, "next": list}
    if not isinstance(found, dict) or not all(isinstance(found.get(key), kind) for key, kind in kinds.items()):
        raise InputError(f"{where}: no look of a campaign: {line[:80]!r}")
    for index, one in enumerate(found["next"]):
        from_mapping(ExtraTrials, one, f"{where}: next[{index}]")
    return found


def _look(plan: Plan, folder: CampaignFolder, vetoed: Collection[str], number: int, crew: Crew) -> Entry:
    from sandbot_model.data.conditions import cells_of
    from sandbot_model.design import look as design
    from sandbot_model.discovery.criteria import of_bed
    from sandbot_model.physics.catalogue import catalogue
    from sandbot_record.trials import from_bags

    trials = trials_of(plan)
    refused = {(one.phi, one.omega_rad_s) for one in trials if one.trial_id in vetoed}
    grid = [(phi, omega) for phi in plan.phi for omega in plan.omega_rad_s if (phi, omega) not in refused]
    if not grid:
        raise InputError(f"{plan.name}: every condition of the plan has been skipped: there is nothing left to run")
    offered = design.Plan(grid, seconds(plan, folder), plan.replicates, plan.gait_name)
    cells = cells_of(from_bags.campaign(folder.path, crew).trials)
    with crew.map() as fit_all:
        found = design.look(
            cells, catalogue(), offered, number=number, base=plan.model, alpha=plan.alpha,
            criteria=of_bed(plan.bed_scatter, plan.bed_drift), fit_all=fit_all,
        )  # fmt: skip
    write_json(folder.path / "discovery.json", found.found.to_dict())
    left = plan.most - len(trials)
    if not found.stop and left <= 0:
        found = replace(found, stop=_used_up(plan.most), block=())
    found = replace(found, block=found.block[: max(left, 0)])
    return {**found.to_dict(), "text": str(found)}


def seconds(plan: Plan, folder: CampaignFolder) -> Any:
    """What a trial at (φ, ω) costs [s]: its walk, and the bed's preparation as it took so far at the nearest φ."""
    beds: dict[float, list[float]] = {}
    for trial in trials_of(plan):
        if not folder.missing([trial]) and (info := metadata.read(folder.bag(trial))) is not None:
            begun_ns, ended_ns = min(one.start_ns for one in info.files), max(one.end_ns for one in info.files)
            walk_s = plan.duration_s(trial.omega_rad_s) + plan.standing_s
            beds.setdefault(trial.phi, []).append(1e-9 * (ended_ns - begun_ns) - walk_s)
    levels = sorted(beds)
    bed_s = [max(median(beds[phi]), 0.0) for phi in levels]

    def cost(condition: tuple[float, float]) -> float:
        phi, omega = condition
        return float(np.interp(phi, levels or [phi], bed_s or [0.0])) + plan.standing_s + plan.duration_s(omega)

    return cost
