"""What a supplement opens with: where the trials come from, in so many words, and how they were analysed."""

from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

from sandbot_common import topics
from sandbot_common.errors import InputError
from sandbot_common.robot import SANDBOT, difference
from sandbot_model.data.conditions import Cells
from sandbot_model.discovery.criteria import DEFAULT, Criteria
from sandbot_model.report.page import Section, Table
from sandbot_model.report.view import Step, frequencies
from sandbot_record.bags.reader import Bag
from sandbot_record.trials.table import Trials

SIMULATED = "A virtual lab (trackway's simulation, in batch): no robot walked and no grains were moved."
LIVE_LAB = (
    "A virtual lab (trackway's simulation) behind live nodes, over DDS: no robot walked and no grains were moved."
)
LIVE = "Recorded live over DDS; no virtual lab is heard in the recordings."
UNKNOWN = "A table, which does not tell where its trials come from."


def origin(trials: Trials, cells: Cells, bags: Mapping[str, Path], command: str) -> Section:
    """Source, plan, robot, software, dates and command; what the data do not tell is left out."""
    opened = _ends(trials, bags)
    said = [bag.provenance.get("trial", {}) for bag in opened]
    rows = [
        ("source", " ".join(dict.fromkeys(map(_source, opened))) or UNKNOWN),
        ("plan", _plan(cells, [one.get("plan", "") for one in said])),
        ("gait", _listed(cells.gait)),
        ("robot", "SandBot" if cells.robot == SANDBOT else f"{difference(cells.robot, SANDBOT)} (SandBot's)"),
        ("recorded", " to ".join(dict.fromkeys(str(one["start"])[:16] for one in said if "start" in one))),
        ("recorded by", _listed(map(_software, said))),
        ("analysed by", f"sandbot_model {version('sandbot_model')}"),
        ("command", command),
    ]  # fmt: skip
    table = Table("", ("what", "as the data tell it"), [row for row in rows if row[1]], (True, True))
    return Section("origin", "Where these trials come from", tables=(table,))


def methods(steps: Sequence[Step], criteria: Criteria = DEFAULT) -> Section:
    """In the order of the work; what a claim takes is the verdict's own ``criteria``."""
    cells = steps[0].fit.cells
    observables = ", ".join(name.replace("_", " ") for name in cells.observables)
    said = (
        f"Trials of one volume fraction φ and leg frequency ω are replicates of a condition ({len(cells)} conditions); "
        f"their means of {observables} are fitted, their scatter is the pure error. The model is a chain from clock to "
        f"speed: legs of radius R = {100 * cells.robot.leg_radius_m:.3g} cm sink until the ground, whose resistance "
        "grows as kz, bears the weight and the push that brings the body to leg speed within Δt; the step is the chord "
        "of the leg's arc above that depth. One k for each φ and the shared parameters minimise the deviance of all "
        "observables at once, globally (a grid of starts, then descent). Lack of fit is an F test of what the means "
        "are missed by against pure error; errors out of sample leave out one condition at a time, with all others of "
        "its batch where that holds whole conditions."
    )
    claims = (
        f"An effect is claimed if it lowers the deviance by at least {criteria.claim:g}, and BIC tells its set from "
        f"every other of its size by at least {criteria.clearly:g}; beside it the zero of the lift, the scale along "
        "the track, differences between batches and a drift are free within their priors. Standard errors follow from "
        "the curvature of the deviance at its minimum, or from a sample where that is no parabola."
    )
    return Section("methods", "How they were analysed", text=(said, claims))


def _software(told: Mapping[str, str]) -> str:
    known = {"software_version", "commit"} <= told.keys()
    return f"trackway {told['software_version']}, commit {told['commit']}" if known else ""


def _ends(trials: Trials, bags: Mapping[str, Path]) -> list[Bag]:
    """The first and the last trial's recordings, as far as they can be read."""
    named = [str(name) for name in trials.trial_id[np.argsort(trials.run_order, kind="stable")] if str(name) in bags]
    opened = []
    for name in dict.fromkeys(_ends_of(named)):
        try:
            opened.append(Bag.open(bags[name]))
        except InputError:
            continue  # listed among what was lost
    return opened


def _ends_of(names: Sequence[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys((names[0], names[-1]))) if names else ()


def _source(bag: Bag) -> str:
    clock = bag.provenance.get("trial", {}).get("clock")
    if clock == "simulated":
        return SIMULATED
    if clock != "live":
        return ""
    heard = bag.messages([topics.DIAGNOSTICS.name]) if topics.DIAGNOSTICS.name in bag.topics else ()
    return LIVE_LAB if any(one.name == "lab" for message in heard for one in message.decode().status) else LIVE


def _plan(cells: Cells, names: Sequence[str]) -> str:
    omegas, _ = frequencies(cells)
    grid = (
        f"{cells.trials} trials: φ {', '.join(f'{phi:.3f}' for phi in cells.level_phi)}; "
        f"ω {', '.join(f'{omega:.4g}' for omega in omegas)} rad/s"
    )
    return f"{_listed(names)}: {grid}" if any(names) else grid


def _listed(values: Iterable[object]) -> str:
    return ", ".join(dict.fromkeys(str(value) for value in values if value))
