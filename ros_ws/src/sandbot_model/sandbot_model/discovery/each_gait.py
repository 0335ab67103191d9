"""Where one model explains no trials of several gaits together: what is found in those of each gait by itself."""

from collections.abc import Mapping
from dataclasses import replace

from sandbot_model.data.conditions import cells_of
from sandbot_model.data.penetrometer import Readings
from sandbot_model.discovery.discover import discover
from sandbot_model.discovery.result import Discovery
from sandbot_model.discovery.verdict import EXPLAINS_ALL, INCOMPLETE, either
from sandbot_model.fitting.parallel import Map
from sandbot_model.physics.effect import Effect
from sandbot_record.trials.table import Trials


def judged_by_gait(
    found: Discovery,
    trials: Trials,
    effects: Mapping[str, Effect],
    readings: Readings | None = None,
    *,
    max_effects: int = 1,
    fit_all: Map = map,
) -> Discovery:
    """The discovery, its reasons extended by the verdicts on the trials of each gait, if there are several and all are
    explained by at most one effect, or none; the same elsewhere. An effect may act in one gait and not in another."""
    gaits = sorted(set(found.cells.gait))
    if found.verdict.status not in INCOMPLETE or len(gaits) < 2 or len(found.fits) == 1:
        return found
    alone = {
        gait: discover(
            cells_of(trials.select(trials.gait == gait), readings), effects, base=found.model,
            max_effects=min(max_effects, 1), criteria=found.criteria, fit_all=fit_all,
        )
        for gait in gaits
    }  # fmt: skip
    if not all(one.verdict.status in ("adequate", *EXPLAINS_ALL) for one in alone.values()):
        return found
    each = ", ".join(f"{gait} by {either(one.verdict.alternatives) or 'the base model'}" for gait, one in alone.items())
    remark = f"the trials of each gait by themselves are explained ({each}): give discover one gait at a time"
    return replace(found, verdict=found.verdict.with_remarks(remark))
