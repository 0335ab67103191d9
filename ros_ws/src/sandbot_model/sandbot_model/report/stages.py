"""The stage of the chain at which the base model fails: the conditions that miss each stage test."""

from collections.abc import Sequence

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.data.conditions import Cells
from sandbot_model.fitting.diagnose import StageTest
from sandbot_model.report import text
from sandbot_model.report.figures import as_json, axis_key, grid_of_panels, in_panel, legend_entry
from sandbot_model.report.page import Table
from sandbot_model.report.theme import Spec, Theme, axis

COLUMNS = 4


def stage_map(stages: Sequence[StageTest], cells: Cells, alpha: float, theme: Theme) -> Spec:
    """A panel for each stage: all conditions, with those marked that its test misses. A stage fails below p = alpha."""
    titles = [f"<b>{stage.stage}</b>: {_outcome(stage, alpha)}" for stage in stages]
    spec = grid_of_panels(titles, theme, COLUMNS, height=210)
    for i, stage in enumerate(stages):
        key = axis_key(i)
        first = i % COLUMNS == 0
        spec["layout"][f"xaxis{key}"] |= axis(theme, "ω (rad/s)", nticks=6)
        spec["layout"][f"yaxis{key}"] |= axis(theme, "φ" if first else "", nticks=5, showticklabels=first)
        missed = np.array(stage.missed).reshape(-1, 2)
        spec["data"] += in_panel(
            i,
            [
                _marks(cells.phi, cells.omega, "tested", _tested_marker(theme)),
                _marks(missed[:, 0], missed[:, 1], "missed", _missed_marker(theme)),
            ],
        )
    spec["data"] += [
        legend_entry("condition", mode="markers", marker=_tested_marker(theme)),
        legend_entry("missed by more than 3 standard errors", mode="markers", marker=_missed_marker(theme)),
    ]
    return spec


def _outcome(stage: StageTest, alpha: float) -> str:
    missed = f", misses {len(stage.missed)} of {stage.cells}" if stage.missed else ""
    return f"{'fails' if stage.p < alpha else 'holds'}{missed}"


def _marks(phi: Floats, omega: Floats, name: str, marker: Spec) -> Spec:
    return {
        "type": "scatter", "mode": "markers", "name": name, "x": as_json(omega),
        "y": as_json(phi), "marker": marker, "showlegend": False,
        "hovertemplate": "φ %{y:.3f}, ω %{x:.3g} rad/s<extra>" + name + "</extra>",
    }  # fmt: skip


def _tested_marker(theme: Theme) -> Spec:
    return {"size": 5, "color": theme.faint}


def _missed_marker(theme: Theme) -> Spec:
    return {"size": 11, "symbol": "square-open", "color": theme.diverging[2], "line": {"width": 3}}


def stage_table(stages: Sequence[StageTest]) -> Table:
    """χ² and p-value of each test."""
    rows = [
        (s.stage, s.connects, text.number(s.chi2, 0), str(s.cells), text.probability(s.p), str(len(s.missed)))
        for s in stages
    ]  # fmt: skip
    caption = (
        "Each test compares two measured quantities that only this stage connects, or one with the base model. p: how "
        "often pure error alone would give as large a χ²."
    )
    head = ("stage", "connects", "χ²", "conditions", "p", "missed")
    return Table(caption, head, rows, (True, True, False, False, False, False))


def stages_caption(stages: Sequence[StageTest], alpha: float) -> str:
    """The stages that fail, those with p < alpha, worst first."""
    failing = sorted((stage for stage in stages if stage.p < alpha), key=lambda stage: stage.p)
    if not failing:
        return f"Every stage of the base model holds in these trials (p ≥ {alpha:g})."
    missed = [text.counted(len(stage.missed), "condition") for stage in failing]
    names = [f"{stage.stage} ({stage.connects}), {many} missed" for stage, many in zip(failing, missed, strict=True)]
    return f"The base model fails (p < {alpha:g}) at: {'; '.join(names)}."
