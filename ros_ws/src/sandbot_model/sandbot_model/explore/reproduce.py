"""The numbers of a selection, from the beginning: what the explorer saves and ``compare`` prints are both these."""

from collections.abc import Mapping

from sandbot_model.cells import Cells
from sandbot_model.chain import Effect
from sandbot_model.compare import compare
from sandbot_model.explore.selection import Selection
from sandbot_model.explore.session import point_of
from sandbot_model.fit import Fit, fitted_at
from sandbot_model.model import model_of


def steps_of(selection: Selection, cells: Cells, effects: Mapping[str, Effect]) -> tuple[Fit, ...]:
    """The ladder of ``compare``; where values are held by hand one step more, with them and k(φ) as fitted.

    Raises InputError for an effect or a parameter that is not known.
    """
    steps = compare(cells, effects, selection.effects, base=selection.model)
    if not selection.by_hand:
        return steps
    model = model_of(selection.model, selection.effects, effects)
    return (*steps, fitted_at(model, cells, point_of(steps[-1], dict(selection.by_hand))))
