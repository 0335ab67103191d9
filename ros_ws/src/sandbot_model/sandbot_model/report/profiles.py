"""How well each parameter is known: profiles of the deviance, and correlations of the parameters' errors."""

from functools import lru_cache
from textwrap import wrap

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.profile import profile
from sandbot_model.report import text
from sandbot_model.report.figures import as_json, axis_key, grid_of_panels, in_panel, legend_entry, model_name
from sandbot_model.report.map_text import cell_labels
from sandbot_model.report.theme import Spec, Theme, axis, category_axis, layout
from sandbot_model.report.view import Step

SIGMAS = np.linspace(-3.5, 3.5, 15)
"""Values at which a parameter is held, in standard errors from the fit."""
FALLBACK_STEP = 0.02
"""Step used in place of an unknown standard error, as a fraction of the parameter's plausible range."""
CONFIDENCE_RISES = ((1.0, "68 %"), (3.84, "95 %"))
"""Rise of the deviance at the ends of an interval for one parameter (Wilks), and the interval's confidence."""
MAX_RISE = 12.0
"""Upper end of the axis of the deviance."""
PANEL_WIDTH, TITLE_PX = 28, 32
"""Characters per line of an axis title, and the height of its second and third line."""
SYMBOLS = {"delta_t_s": "Δt", "v_swim_m_s": "v<sub>swim</sub>"}
"""Symbols of the base model's parameters."""


@lru_cache(maxsize=128)
def curve(fit: Fit, index: int) -> tuple[Floats, Floats]:
    """Values ``(n,)`` of one shared parameter, and the rise of the deviance ``(n,)`` with it held there and all others
    refitted."""
    parameter, here, error = fit.model.parameters[index], float(fit.point.theta[index]), float(fit.stderr[index])
    unit = error if np.isfinite(error) and error > 0 else FALLBACK_STEP * parameter.width
    values = np.unique(np.clip(here + unit * SIGMAS, *parameter.search))
    states = profile(fit.problem, fit.state, [index], values[:, None])
    return values, np.maximum(states.deviance - fit.deviance, 0.0)


def profiles(step: Step, theme: Theme) -> Spec:
    """A panel for each shared parameter: the profile, and the parabola that its standard error implies."""
    fit = step.fit
    names = list(fit.model.names)
    spec = grid_of_panels([f"<b>{symbol(fit, name)}</b>" for name in names], theme, 3, height=260)
    spec["layout"]["height"] += TITLE_PX
    spec["layout"]["margin"]["b"] += TITLE_PX
    for i, name in enumerate(names):
        values, rise = curve(fit, i)
        estimate = fit.parameters[name]
        key = axis_key(i)
        spec["layout"][f"xaxis{key}"] |= axis(theme, _title(fit, name), nticks=5)
        first = i % 3 == 0
        up = "rise of the deviance" if first else ""
        spec["layout"][f"yaxis{key}"] |= axis(theme, up, range=[-0.4, MAX_RISE], nticks=5, showticklabels=first)
        spec["data"] += in_panel(i, _panel(values, rise, estimate.value, estimate.stderr, theme))
    looks = {"mode": "lines", "line": {"color": theme.accent, "width": 2.5}}
    spec["data"] += [
        legend_entry("profile, all others refitted", **looks),
        legend_entry("parabola of the standard error", mode="lines", line=_dashed(theme)),
        legend_entry("68 % and 95 %", mode="lines", line={"color": theme.faint, "width": 1, "dash": "dot"}),
    ]
    return spec


def _panel(values: Floats, rise: Floats, here: float, error: float, theme: Theme) -> list[Spec]:
    ends = [float(values[0]), float(values[-1])]
    traces: list[Spec] = [
        {"type": "scatter", "mode": "lines", "x": ends, "y": [level] * 2, "hoverinfo": "skip", "showlegend": False,
         "name": confidence, "line": {"color": theme.faint, "width": 1, "dash": "dot"}}
        for level, confidence in CONFIDENCE_RISES
    ]  # fmt: skip
    if np.isfinite(error) and error > 0:
        fine = np.linspace(ends[0], ends[1], 61)
        traces.append({
            "type": "scatter", "mode": "lines", "name": "parabola", "x": fine.tolist(), "hoverinfo": "skip",
            "y": as_json(((fine - here) / error) ** 2), "line": _dashed(theme), "showlegend": False,
        })  # fmt: skip
    traces.append({
        "type": "scatter", "mode": "lines+markers", "name": "profile", "x": values.tolist(), "y": as_json(rise),
        "line": {"color": theme.accent, "width": 2.5}, "marker": {"size": 5}, "showlegend": False,
        "hovertemplate": "%{x:.5g}: %{y:.1f}<extra></extra>",
    })  # fmt: skip
    return traces


def _dashed(theme: Theme) -> Spec:
    return {"color": theme.ink, "width": 1.2, "dash": "dash"}


def symbol(fit: Fit, name: str) -> str:
    """A parameter's symbol in formulas: ``Δt``, ``k<sub>L</sub>``."""
    parameter = fit.model.parameters[fit.model.names.index(name)]
    return SYMBOLS.get(parameter.name) or text.symbol(parameter)


def _title(fit: Fit, name: str) -> str:
    """Description and unit of a parameter, wrapped to the width of a panel."""
    words, unit = text.described(name, fit.model.catalogue.values())
    return "<br>".join(wrap(f"{words} ({unit})" if unit else words, PANEL_WIDTH))


def correlations(step: Step, theme: Theme) -> Spec:
    """Correlations of the errors of all unknowns, including k of every level."""
    fit = step.fit
    names = labels(fit)
    values = correlation(fit.covariance[: len(names), : len(names)])
    words = [[text.number(v, 1) if abs(v) >= 0.3 and i != j else "" for j, v in enumerate(row)]
             for i, row in enumerate(np.nan_to_num(values))]  # fmt: skip
    heat = {
        "type": "heatmap", "name": model_name(step), "x": names, "y": names, "z": as_json(values),
        "zmin": -1, "zmax": 1, "colorscale": theme.residual_scale(), "xgap": 1, "ygap": 1, "hoverongaps": False,
        "hovertemplate": "%{y} and %{x}: %{z:.2f}<extra></extra>",
        "colorbar": {
            "title": {"text": "correlation", "side": "right", "font": {"size": 12}}, "thickness": 14, "outlinewidth": 0,
        },
    }  # fmt: skip
    spec: Spec = {
        "data": [cell_labels(heat, words, theme), heat],
        "layout": layout(
            theme, 120 + 30 * len(names), showlegend=False, plot_bgcolor=theme.empty,
            xaxis=category_axis(theme, "", names, tickangle=-40),
            yaxis=category_axis(theme, "", names, autorange="reversed"),
        ),
    }  # fmt: skip
    spec["layout"]["margin"] |= {"l": 100, "b": 90, "t": 44}
    return spec


def labels(fit: Fit) -> list[str]:
    """A symbol for each unknown; prefixed by the effect's name where effects share one."""
    symbols = [symbol(fit, name) for name in fit.model.names]
    owners = [name.rpartition(".")[0].replace("_", " ") for name in fit.model.names]
    unique = [f"{owner} {s}" if symbols.count(s) > 1 else s for owner, s in zip(owners, symbols, strict=True)]
    return unique + [f"k at φ {phi:.3f}" for phi in fit.level_phi]


def correlation(covariance: Floats) -> Floats:
    """Correlation matrix ``(n, n)`` of a covariance, NaN where an error is unknown."""
    sd = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(covariance / np.outer(sd, sd))


def profiles_caption(step: Step) -> str:
    """Caption: the parameters for which the standard error is not sufficient."""
    fit = step.fit
    names = [text.described(name, fit.model.catalogue.values())[0] for name in fit.model.names]
    not_parabolic = [name for i, name in enumerate(names) if not _parabolic(fit, i)]
    if not not_parabolic:
        return f"For all {len(names)} parameters the profile is close to the parabola of the standard error."
    return f"The profile is far from the parabola of the standard error for: {'; '.join(not_parabolic)}."


def _parabolic(fit: Fit, index: int) -> bool:
    """Whether the deviance one and two standard errors away has risen by about 1 and 4."""
    error = float(fit.stderr[index])
    if not np.isfinite(error) or error <= 0:
        return False
    values, rise = curve(fit, index)
    away = np.array([-2.0, -1.0, 1.0, 2.0])
    at = np.interp(fit.point.theta[index] + error * away, values, rise)
    return bool((np.abs(at - away**2) < 0.5 * away**2).all())


def correlations_caption(step: Step) -> str:
    """Caption: the pair of errors with the strongest correlation."""
    fit = step.fit
    names = [text.described(name, fit.model.catalogue.values())[0] for name in fit.model.names]
    names += [f"k at φ {phi:.3f}" for phi in fit.level_phi]
    values = np.nan_to_num(correlation(fit.covariance[: len(names), : len(names)]))
    values[np.tril_indices(len(names))] = 0.0
    if not values.any():
        return "The errors of the parameters are not correlated."
    i, j = np.unravel_index(np.abs(values).argmax(), values.shape)
    return (
        f"Most correlated are the errors of {names[int(i)]} and {names[int(j)]}: {text.number(float(values[i, j]), 2)}."
    )
