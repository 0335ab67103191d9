"""What a control does to the selection: pure, so that it can be tested without a page."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from sandbot_model.data.conditions import Cells
from sandbot_model.discovery.choice import Selection, cell_of_text, cell_text, with_formula
from sandbot_model.discovery.discover import Discovery
from sandbot_model.explore.condition import condition_of, option_of
from sandbot_model.physics.variants import Variant
from sandbot_model.report.residual_map import map_cells

CONTROLS = ("model", "effects", "view", "observable", "cell")
"""The controls that have a value; the others are buttons and sliders."""


def act(selection: Selection, control: str, value: Any) -> Selection:
    """The selection after ``control`` was set to ``value``. Raises InputError for a formula that is none."""
    match control:
        case "model" | "view" | "observable":
            changed = replace(selection, **{control: value})
            return replace(changed, by_hand=()) if control == "model" else changed
        case "effects":
            return selection.toggled(value)
        case "formula":
            return with_formula(selection, value)
        case "release":
            return replace(selection, by_hand=())
        case "cell":
            return replace(selection, cell=None if value is None else cell_of_text(value))
        case "pin":
            return selection.pin()
        case "unpin":
            return replace(selection, against="")
    return selection


def can_adopt(found: Discovery) -> bool:
    """Whether there is something to switch on: not where several sets explain the data alike."""
    return found.verdict.status != "ambiguous" and bool(found.verdict.effects or found.residual)


def with_verdict(selection: Selection, found: Discovery) -> Selection:
    """With the verdict's effects switched on, or, where it names none, with the formula of the residual.

    One that holds under another convention than the catalogue's is switched on as a formula.
    """
    residual = found.residual
    if residual and not found.verdict.effects:
        effects, formulas = residual.effects, [residual.formula]
    else:
        others = {one.identifier: one.as_formula for one in found.fit.model.effects if isinstance(one, Variant)}
        effects = tuple(name for name in found.verdict.effects if name not in others)
        formulas = [others[name] for name in found.verdict.effects if name in others]
    changed = replace(selection.toggled(effects), by_hand=())
    for formula in formulas:
        changed = with_formula(changed, formula)
    return changed


def values_of(selection: Selection, cells: Cells) -> dict[str, Any]:
    """Values of the controls when ``selection`` is displayed; of a condition, what the list of ``cells`` calls it."""
    plain = {name: getattr(selection, name) for name in CONTROLS}
    return plain | {"effects": list(selection.effects), "cell": option_of(cells, selection.cell)}


def with_controls(selection: Selection, reported: Mapping[str, Any], values: Mapping[str, Any]) -> Selection:
    """``selection`` with the controls changed whose ``values`` differ from those that were ``told`` last.

    Only differences count: what was selected since in another way and is not displayed yet is kept. Not what is
    displayed is compared: figures take a while, and what was switched on and off before they come would equal it.
    """
    for control, before in reported.items():
        value = values[control]
        if value == before:
            continue
        if control == "effects":
            wanted = [name for name in selection.effects if name in value or name not in before]
            value = [*wanted, *(name for name in value if name not in before)]
        selection = act(selection, control, value)
    return selection


def slider_value(value: float) -> float:
    """As many digits as fit beside a slider."""
    return float(f"{value:.5g}")


def with_sliders(selection: Selection, shown: Mapping[str, float], sliders: Mapping[str, float]) -> Selection:
    """With the parameters held whose slider was moved away from where it stood for the value shown."""
    for name, value in sliders.items():
        if name in shown and not math.isclose(value, slider_value(shown[name]), rel_tol=1e-9):
            selection = selection.held(name, value)
    return selection


def clicked_option(click: Mapping[str, Any] | None, cells: Cells) -> str | None:
    """The condition under a click, as the list of conditions calls it."""
    index = clicked_cell(click, cells)
    return None if index is None else cell_text(condition_of(cells, index))


def clicked_cell(click: Mapping[str, Any] | None, cells: Cells) -> int | None:
    """The cell under a click on any figure: by the end of the point's ``customdata``, which Dash leaves out on a map,
    or by the row and column of the map.
    """
    points = (click or {}).get("points") or [{}]
    data = points[0].get("customdata")
    if isinstance(data, list) and len(data) == 2:
        return None if data[-1] is None else int(data[-1])
    return map_cells(cells).get((points[0].get("x"), points[0].get("y")))
