"""The effect of each control on the selection, as pure functions that can be tested without a page."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from sandbot_model.data.conditions import Cells
from sandbot_model.discovery.result import Discovery
from sandbot_model.discovery.selection import Selection, cell_of_text, cell_text, with_formula
from sandbot_model.explore.condition import condition_of, option_of
from sandbot_model.physics.variants import Variant
from sandbot_model.report.residual_map import map_cells

CONTROLS = ("model", "effects", "view", "observable", "cell")
"""The controls with a value; all others are buttons and sliders."""


def act(selection: Selection, control: str, value: Any) -> Selection:
    """The selection after ``control`` was set to ``value``. Raises InputError for an invalid formula."""
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
    """Whether the verdict can be switched on; not if several sets of effects explain the data equally well."""
    return found.verdict.status != "ambiguous" and bool(found.verdict.effects or found.residual)


def with_verdict(selection: Selection, found: Discovery) -> Selection:
    """The selection with the verdict's effects switched on, or, if it names none, with the formula of the residual.

    An effect under another convention than the catalogue's is switched on as a formula.
    """
    residual = found.residual
    if residual and not found.verdict.effects:
        effects, formulas = residual.effects, [residual.formula]
    else:
        variants = {e.identifier: e.as_formula for e in found.fit.model.effects if isinstance(e, Variant)}
        effects = tuple(name for name in found.verdict.effects if name not in variants)
        formulas = [variants[name] for name in found.verdict.effects if name in variants]
    changed = replace(selection.toggled(effects), by_hand=())
    for formula in formulas:
        changed = with_formula(changed, formula)
    return changed


def values_of(selection: Selection, cells: Cells) -> dict[str, Any]:
    """Values of the controls when ``selection`` is displayed; the chosen cell as its option in the list."""
    plain = {name: getattr(selection, name) for name in CONTROLS}
    return plain | {"effects": list(selection.effects), "cell": option_of(cells, selection.cell)}


def with_controls(selection: Selection, reported: Mapping[str, Any], values: Mapping[str, Any]) -> Selection:
    """``selection`` updated with the controls whose ``values`` differ from those last ``reported``.

    Only differences are applied, so that changes made otherwise and not yet displayed are kept. The comparison is not
    with the displayed state: an effect switched on and off again before its figures arrive would go unnoticed.
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
    """A value rounded to the digits that fit beside a slider."""
    return float(f"{value:.5g}")


def with_sliders(selection: Selection, shown: Mapping[str, float], sliders: Mapping[str, float]) -> Selection:
    """The selection with those parameters held whose slider was moved from the value shown."""
    for name, value in sliders.items():
        if name in shown and not math.isclose(value, slider_value(shown[name]), rel_tol=1e-9):
            selection = selection.held(name, value)
    return selection


def clicked_option(click: Mapping[str, Any] | None, cells: Cells) -> str | None:
    """The condition under a click, as its option in the list of conditions."""
    index = clicked_cell(click, cells)
    return None if index is None else cell_text(condition_of(cells, index))


def clicked_cell(click: Mapping[str, Any] | None, cells: Cells) -> int | None:
    """The cell under a click: from the end of the point's ``customdata``, or, on a map, where Dash omits that, from
    the row and column.
    """
    points = (click or {}).get("points") or [{}]
    data = points[0].get("customdata")
    if isinstance(data, list) and len(data) == 2:
        return None if data[-1] is None else int(data[-1])
    return map_cells(cells).get((points[0].get("x"), points[0].get("y")))
