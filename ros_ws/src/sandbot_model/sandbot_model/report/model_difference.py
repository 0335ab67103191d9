"""Maps over φ × ω: the difference of two models, and the largest difference between rivals with the next trials."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.discovery.next_trials import NextTrial, Predicted, between
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.observables import CM, NAMES, Observable
from sandbot_model.report import text
from sandbot_model.report.captions import condition_label
from sandbot_model.report.figures import as_json, model_name
from sandbot_model.report.map_text import cell_labels
from sandbot_model.report.residual_map import MAX_LABELLED_COLUMNS, column_label
from sandbot_model.report.theme import Spec, Theme, category_axis, layout, note
from sandbot_model.report.view import Step, bands, frequencies, observable_label, readable

MIN_SCALE_END_SD = 10.0
SCALE_TICKS_SD = (1, 3, 10, 30, 100, 300, 1000)
"""Tick labels of the separation map's colour bar, which is logarithmic: gaps range from 3 to 300."""


def difference(first: Step, second: Step, observable: str) -> Floats:
    """The first model's predictions of the cell means minus the second's [SI], (n,)."""
    column = Observable[observable]
    return np.asarray(first.fit.predicted[:, column] - second.fit.predicted[:, column])


def difference_map(first: Step, second: Step, observable: str, theme: Theme) -> Spec:
    """First minus second model over the measured conditions, in readers' units."""
    cells = first.fit.cells
    rows = bands(cells)
    omegas, columns = frequencies(cells)
    away = CM * difference(first, second, observable)
    z, index = np.full((len(rows), len(omegas)), np.nan), np.full((len(rows), len(omegas)), None, dtype=object)
    for row, band in enumerate(rows):
        z[row, columns[band.cells]], index[row, columns[band.cells]] = away[band.cells], band.cells
    end = float(np.nanmax(np.abs(z))) or 1.0
    unit = Observable[observable].readers_unit
    shown = [["" if not np.isfinite(v) or abs(v) < 0.05 * end else text.number(v) for v in row] for row in z]
    heat = _heat(
        [column_label(omega) for omega in omegas], [band.label for band in rows], z, theme.residual_scale(), -end, end,
        f"difference ({unit})",
    ) | {
        "name": _difference_name(first, second),
        "customdata": np.stack([as_json(z), index], axis=-1).tolist(),
        "hovertemplate": f"%{{y}}, ω %{{x}} rad/s<br>%{{z:.2f}} {unit}<extra></extra>",
    }  # fmt: skip
    labels = [cell_labels(heat, shown, theme)] if len(omegas) <= 2 * MAX_LABELLED_COLUMNS else []
    spec = _map([*labels, heat], len(rows), theme)
    words = f"<b>{observable_label(observable)}</b><br>{_difference_name(first, second)}"
    spec["layout"]["annotations"] = [_heading(words)]
    return spec


def difference_caption(first: Step, second: Step, observable: str) -> str:
    """Caption: where the two differ most."""
    cells, away = first.fit.cells, difference(first, second, observable)
    if not np.isfinite(away).any():
        return f"{observable_label(observable).capitalize()} was not measured."
    most = int(np.nanargmax(np.abs(away)))
    return (
        f"{observable_label(observable).capitalize()}, {_difference_name(first, second)}. The largest difference is "
        f"{text.number(CM * away[most], 2)} {Observable[observable].readers_unit}, at "
        f"{condition_label(cells, most)}."
    )


def _difference_name(first: Step, second: Step) -> str:
    """The two models in words, first minus second."""
    return f"model {model_name(first)} minus {model_name(second)}".replace("model simple", "simple")


@dataclass(frozen=True, eq=False)
class Gaps:
    """Differences between rivals: for each (φ, ω) the trial that best separates a pair of them."""

    phi: Floats
    """φ of the levels."""
    omega: Floats
    """Frequencies [rad/s], a finer grid than those measured."""
    best: Mapping[tuple[float, float], NextTrial]
    """Omits (φ, ω) where no pair differs by more than scatter."""


def gaps(fits: Sequence[Fit]) -> Gaps:
    """The best separating trials over all pairs of two or more fits."""
    predicted = [Predicted.by(fit) for fit in fits]
    best: dict[tuple[float, float], NextTrial] = {}
    for pair in combinations(predicted, 2):
        for trial in between(*pair):
            place = (trial.phi, trial.omega_rad_s)
            if trial.observable in NAMES and (place not in best or best[place].expected_gap_sd < trial.expected_gap_sd):
                best[place] = trial
    return Gaps(predicted[0].phi, predicted[0].omega, best)


def separation_map(found: Gaps, trials: Sequence[NextTrial], theme: Theme) -> Spec:
    """Largest difference between rivals, in standard deviations of one trial, over φ × ω; stars are the next trials."""
    phi, omega = found.phi, found.omega
    at = [[found.best.get((p, w)) for w in omega] for p in phi]
    z = np.array([[trial.expected_gap_sd if trial else 0.0 for trial in row] for row in at])
    rows = [f"φ {value:.3f}" for value in phi]
    heat = _heat(
        as_json(omega), rows, np.log10(np.maximum(z, 1.0)), theme.gap_scale(), 0.0,
        float(np.log10(max(MIN_SCALE_END_SD, z.max()))), "difference (standard<br>deviations of a trial)",
    )  # fmt: skip
    heat["colorbar"] |= {"tickvals": np.log10(SCALE_TICKS_SD).tolist(), "ticktext": [str(sd) for sd in SCALE_TICKS_SD]}
    heat |= {
        "name": "where they differ most",
        "customdata": [[[trial.expected_gap_sd if trial else 0.0, _hover_text(trial)] for trial in row] for row in at],
        "hovertemplate": "%{y}, ω %{x:.3g} rad/s<br>%{customdata[0]:.1f} s.d. %{customdata[1]}<extra></extra>",
    }  # fmt: skip
    walks = [trial for trial in trials if trial.kind == "trial"]
    stars = {
        "type": "scatter", "mode": "markers+text", "name": "next trials", "showlegend": False,
        "x": [trial.omega_rad_s for trial in walks],
        "y": [rows[int(np.argmin(np.abs(phi - trial.phi)))] for trial in walks],
        "text": [str(n) for n, _ in enumerate(walks, start=1)], "textposition": "middle right",
        "textfont": {"size": 14, "color": theme.ink},
        "marker": {"symbol": "star", "size": 15, "color": theme.paper, "line": {"color": theme.ink, "width": 1.5}},
        "customdata": [[trial.expected_gap_sd, _hover_text(trial)] for trial in walks],
        "hovertemplate": "next: %{y}, ω %{x:.3g} rad/s<br>%{customdata[0]:.1f} s.d. %{customdata[1]}<extra></extra>",
    }  # fmt: skip
    spec = _map([heat, stars], len(rows), theme)
    spec["layout"]["xaxis"] |= {"type": "linear"}
    spec["layout"]["annotations"] = [_heading("<b>Where they differ most</b><br>stars: next trials, best first")]
    return spec


def separation_caption(found: Gaps, trials: Sequence[NextTrial]) -> str:
    """Caption: where they differ most, by how much, and how many measurements are proposed."""
    best = found.best
    if not best:
        return "Within this range of φ and ω no trial tells these models apart."
    most = max(best.values(), key=lambda trial: trial.expected_gap_sd)
    first, second = map(readable, most.separates)
    proposed = f" {len(trials)} measurements are proposed." if trials else ""
    return (
        f"They differ most at {most.where}: {first} from {second} by {text.number(most.expected_gap_sd)} standard "
        f"deviations of a trial, in {observable_label(most.observable).lower()}.{proposed}"
    )


def _hover_text(trial: NextTrial | None) -> str:
    """The observable to watch and the pair of models that it separates, for the hover text."""
    if trial is None:
        return ""
    first, second = map(readable, trial.separates)
    return f"of {observable_label(trial.observable)}<br>{first} from {second}"


def _heat(
    x: list[str], y: list[str], z: Floats, scale: list[list[object]], low: float, high: float, title: str
) -> Spec:
    bar = {"title": {"text": title, "side": "right", "font": {"size": 12}}, "thickness": 14, "outlinewidth": 0}
    return {
        "type": "heatmap", "x": x, "y": y, "z": as_json(z), "zmin": low, "zmax": high, "colorscale": scale,
        "xgap": 1, "ygap": 2, "hoverongaps": False, "colorbar": bar,
    }  # fmt: skip


def _map(data: list[Spec], rows: int, theme: Theme) -> Spec:
    spec: Spec = {
        "data": data,
        "layout": layout(
            theme, 150 + max(28 * rows, 110), plot_bgcolor=theme.empty, showlegend=False,
            xaxis=category_axis(theme, "ω (rad/s)", data[-1]["x"]),
            yaxis=category_axis(theme, "", data[-1]["y"]),
        ),
    }  # fmt: skip
    spec["layout"]["margin"] |= {"t": 68, "l": 84}
    return spec


def _heading(words: str) -> Spec:
    return note(words, 0.0, 1.0, xanchor="left", yanchor="bottom", yshift=6, align="left", font={"size": 13})
