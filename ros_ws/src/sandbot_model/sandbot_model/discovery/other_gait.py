"""Whether a verdict depends on a gait that the data do not give: its models fitted again with each other gait."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from sandbot_model.data.conditions import Cells, cells_of
from sandbot_model.data.penetrometer import Readings
from sandbot_model.discovery.batch_sd import batch_sd_of
from sandbot_model.discovery.criteria import Criteria
from sandbot_model.discovery.nuisances_about import nuisances_for
from sandbot_model.discovery.result import Discovery
from sandbot_model.discovery.verdict import leaves_nothing, p_in_words
from sandbot_model.fitting.fit import Fit, fit, refitted
from sandbot_model.physics.gait import ASSUMED, GAITS, clock_signal
from sandbot_record.trials.table import Trials


def tried_with_other_gaits(found: Discovery, trials: Trials, readings: Readings | None = None) -> Discovery:
    """The discovery, its reasons extended by each gait with which a model of the verdict would fail, or would hold; the
    same where the gait is given, or nothing was tested."""
    unknown = np.array([clock_signal(gait) is None for gait in trials.gait])
    if found.verdict.status == "untested" or not unknown.any():
        return found
    others = {name: replace(trials, gait=np.where(unknown, name, trials.gait)) for name in GAITS if name != ASSUMED}
    changed = [
        f"if the gait was {gait}, {change}"
        for gait, those in others.items()
        for change in _changes(found, cells_of(those, readings))
    ]
    if not changed:
        return found
    return replace(found, verdict=found.verdict.with_remarks(*changed, "a gait column would settle this"))


def _changes(found: Discovery, cells: Cells) -> Iterator[str]:
    """What becomes of the base model and of the one that the verdict names, where these cells judge otherwise."""
    for before in dict.fromkeys((found.steps[0], found.fit)):
        after = _fitted_to(cells, before, found.criteria)
        if leaves_nothing(after, found.criteria) != leaves_nothing(before, found.criteria):
            does = "holds" if leaves_nothing(after, found.criteria) else "fails"
            yield f"the {before.name} {does} {p_in_words(after)}"


def _fitted_to(cells: Cells, before: Fit, criteria: Criteria) -> Fit:
    """The same model fitted to other cells, with nuisances if it had them."""
    plain = fit(before.model, cells, before.warm_start)
    if before.nuisances is None:
        return plain
    return refitted(plain, nuisances_for(plain, criteria, batch_sd_of(before)))
