"""The result of a discovery, or its progress, as parts of the page."""

import math
from typing import Any

from dash import html

from sandbot_model.discovery.result import Discovery
from sandbot_model.discovery.selection import Selection
from sandbot_model.explore.blocks import table
from sandbot_model.report import text
from sandbot_model.report.view import observable_label, readable


def suggestion(found: Discovery, why: str = "/why") -> list[Any]:
    """Verdict, candidates and next trials of a discovery; ``why`` is the address of its argument."""
    verdict = found.verdict
    named = " + ".join(map(readable, verdict.effects))
    if verdict.status == "ambiguous":
        named = f"one of {len(verdict.alternatives)} sets of effects, these data can't tell which"
    because = verdict.because[:1].upper() + verdict.because[1:]
    parts: list[Any] = [
        html.H2(f"Suggestion for the {found.model} model"),
        html.P([html.Strong(f"{verdict.status.capitalize()}{f': {named}' if named else ''}. "), f"{because}."]),
        html.P(html.A("Why: the argument, the rivals and the plan of the next trials", href=why)),
        table(
            "Best single effects",
            ("effect", "ΔBIC", "out of sample", "cells scored"),
            [
                (readable(c.effect), text.number(c.delta_bic), text.cm_s(c.cv_rmse_m_s), str(c.cv_cells))
                for c in found.candidates[:5]
            ],
        ),
    ]
    if found.residual is not None:
        residual = found.residual
        parts.append(
            html.P([f"Residual: {residual.sentence}. To try as your own effect: ", html.Code(residual.formula)])
        )
    if found.next_trials:
        rows = [(t.where, observable_label(t.observable), _gap(t.expected_gap_sd)) for t in found.next_trials]
        parts.append(table("Next trials", ("at", "watch", "expected gap"), rows))
    if found.controls:
        controls = [(readable(name), control) for name, control in found.controls.items()]
        parts.append(table("Experiments of another kind", ("effect", "control"), controls))
    return parts


def progress(stage: str, done: int, total: int, before: Selection | None = None) -> list[Any]:
    """Progress of a discovery; ``before`` is a selection queued ahead of it by another page."""
    first = "" if before is None else f"Trying the {before.model} model first{_with_formulas(before)}. "
    label = html.Label(f"{first}Trying {stage}: {done} of {total}")
    return [label, html.Progress(value=str(done), max=str(max(total, 1)))]


def _with_formulas(selection: Selection) -> str:
    """The number of user formulas, by which two discoveries of one base model differ."""
    count = len(selection.formulas)
    return f", with {text.counted(count, 'formula')}" if count else ""


def _gap(expected_sd: float) -> str:
    """The expected gap; where the trial is to measure the scatter itself there is none."""
    return f"{expected_sd:.1f} s.d." if math.isfinite(expected_sd) else "scatter"
