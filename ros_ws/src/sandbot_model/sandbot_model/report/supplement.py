"""Opening sections of a supplement: the origin of the trials, and the methods of the analysis."""

import math
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

from sandbot_common import topics
from sandbot_common.errors import InputError
from sandbot_common.robot import SANDBOT, Robot, difference
from sandbot_model.data.conditions import Cells
from sandbot_model.discovery.assumed import assumed
from sandbot_model.discovery.criteria import Criteria
from sandbot_model.discovery.verdict import claim_on_replicates, claim_threshold, overdispersion
from sandbot_model.report import text
from sandbot_model.report.page import Section, Table
from sandbot_model.report.view import Step, frequencies, readable
from sandbot_record.bags.reader import Bag
from sandbot_record.trials.table import Trials

SIMULATED = "A virtual lab (trackway's simulation, in batch): no robot walked and no grains were moved."
LIVE_LAB = (
    "A virtual lab (trackway's simulation) behind live nodes, over DDS: no robot walked and no grains were moved."
)
LIVE = "Recorded live over DDS; no virtual lab appears in the recordings."
UNKNOWN = "A table that does not state where its trials come from."


def origin(
    trials: Trials, cells: Cells, bags: Mapping[str, Path], command: str, criteria: Criteria | None = None
) -> Section:
    """Source, plan, robot, software, dates and command, as far as the data state them, and what is assumed instead;
    ``criteria`` are those of a verdict."""
    opened = _first_and_last_bag(trials, bags)
    metadata = [bag.provenance.get("trial", {}) for bag in opened]
    rows = [
        ("source", " ".join(dict.fromkeys(map(_source, opened))) or UNKNOWN),
        ("plan", _plan(cells, [trial.get("plan", "") for trial in metadata])),
        ("gait", _joined(cells.gait)),
        ("robot", _robot(trials.robot)),
        ("assumed", "; ".join(assumed(trials, cells, criteria))),
        ("recorded", " to ".join(dict.fromkeys(str(trial["start"])[:16] for trial in metadata if "start" in trial))),
        ("recorded by", _joined(map(_software, metadata))),
        ("analysed by", f"sandbot_model {version('sandbot_model')}"),
        ("command", command),
    ]  # fmt: skip
    table = Table("", ("item", "as stated by the data or the command"), [row for row in rows if row[1]], (True, True))
    return Section("origin", "Where these trials come from", tables=(table,))


def methods(steps: Sequence[Step], criteria: Criteria | None = None) -> Section:
    """The methods in order of the analysis; with a verdict, what a claim took by its own ``criteria``."""
    cells = steps[0].fit.cells
    observables = ", ".join(map(readable, cells.observables))
    source = (
        f"Rows are means of {observables}, one for each of {text.counted(len(cells), 'condition')}; they are fitted, "
        "and the error bars given are the pure error."
        if cells.error_bars
        else f"Trials of one volume fraction φ and leg frequency ω are replicates of a condition "
        f"({text.counted(len(cells), 'condition')}); their means of {observables} are fitted, their scatter is "
        "the pure error."
    )
    analysis = (
        f"{source} The model is a chain from clock to "
        f"speed: legs of radius R = {100 * cells.robot.leg_radius_m:.3g} cm sink until the ground, whose resistance "
        "grows as kz, bears the weight and the push that brings the body to leg speed within Δt; the step is the chord "
        "of the leg's arc above that depth. One k for each φ and the shared parameters minimise the deviance of all "
        "observables at once, globally (a grid of starts, then descent). Lack of fit is an F test of the residuals of "
        "the means against pure error; errors out of sample leave out one condition at a time, together with all "
        "others of its batch where batches hold whole conditions."
    )
    if criteria is None:
        return Section("methods", "How they were analysed", text=(analysis,))
    claims = (
        f"An effect is claimed if it lowers the deviance {_claim(steps[-1], criteria)}, and the BIC of every other "
        f"set of its size is higher by at least {criteria.clearly:g}; nuisance parameters (the zero of the lift, the "
        "scale along the track, differences between batches, a drift) are free within their priors. Standard errors "
        "follow from the curvature of the deviance at its minimum, or from a sample of the posterior where it is no "
        "parabola."
    )
    return Section("methods", "How they were analysed", text=(analysis, claims))


def _claim(step: Step, criteria: Criteria) -> str:
    """The gain that a claim takes in these data, with its two factors where they count."""
    fit, needed = step.fit, claim_on_replicates(step.fit.cells, criteria)
    if not math.isfinite(needed):
        return f"by at least {criteria.claim:g}, more where replicates are few (here are none: nothing is claimed)"
    words = f"by at least {claim_threshold(fit, criteria):.0f}"
    if (spread := overdispersion(fit)) > 1.0:
        words += (
            f" = {needed:.3g} × {spread:.3g}, the χ² per degree of freedom about the {step.whole_label} (another set "
            "has another)"
        )
    source = fit.cells.pure_error_from
    return f"{words}, where {criteria.claim:g} would do if the pure error were known exactly and not from {source}"


def _robot(robot: Robot | None) -> str:
    """What differs from SandBot, with SandBot's values; a robot that is not stated is assumed to be SandBot."""
    if robot is None:
        return "not stated; SandBot is assumed"
    return difference(robot, SANDBOT, "{} {} (SandBot's {})") or "SandBot"


def _software(metadata: Mapping[str, str]) -> str:
    known = {"software_version", "commit"} <= metadata.keys()
    return f"trackway {metadata['software_version']}, commit {metadata['commit']}" if known else ""


def _first_and_last_bag(trials: Trials, bags: Mapping[str, Path]) -> list[Bag]:
    """The recordings of the first and the last trial in run order, as far as they can be read."""
    named = [str(name) for name in trials.trial_id[np.argsort(trials.run_order, kind="stable")] if str(name) in bags]
    opened = []
    for name in dict.fromkeys((*named[:1], *named[-1:])):
        try:
            opened.append(Bag.open(bags[name]))
        except InputError:
            continue  # listed among the excluded trials
    return opened


def _source(bag: Bag) -> str:
    clock = bag.provenance.get("trial", {}).get("clock")
    if clock == "simulated":
        return SIMULATED
    if clock != "live":
        return ""
    diagnostics = bag.messages([topics.DIAGNOSTICS.name]) if topics.DIAGNOSTICS.name in bag.topics else ()
    return (
        LIVE_LAB if any(status.name == "lab" for message in diagnostics for status in message.decode().status) else LIVE
    )


def _plan(cells: Cells, names: Sequence[str]) -> str:
    omegas, _ = frequencies(cells)
    grid = (
        f"{text.counted(cells.trials, 'trial')}: φ {', '.join(f'{phi:.3f}' for phi in cells.level_phi)}; "
        f"ω {', '.join(f'{omega:.4g}' for omega in omegas)} rad/s"
    )
    return f"{_joined(names)}: {grid}" if any(names) else grid


def _joined(values: Iterable[object]) -> str:
    """The distinct values that are not empty, separated by commas."""
    return ", ".join(dict.fromkeys(str(value) for value in values if value))
