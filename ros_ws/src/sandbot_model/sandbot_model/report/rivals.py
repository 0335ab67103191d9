"""Rival explanations of the same trials: their choice, their overlaid speed curves, and a table that compares them."""

from collections.abc import Sequence

from sandbot_model.discovery.result import Discovery
from sandbot_model.discovery.verdict import sound
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.goodness import cells_missed
from sandbot_model.report import text
from sandbot_model.report.figures import in_panel, legend_entry, line, points, speed_panels
from sandbot_model.report.page import Figure, Table
from sandbot_model.report.theme import Spec, Theme
from sandbot_model.report.view import Step, bands

MAX_RIVALS = 4
DASHES = ("dot", "solid", "dash", "dashdot", "longdash")
"""Rivals differ in both colour and dash."""


def rivals(discovery: Discovery) -> tuple[Fit, ...]:
    """The base model, the model that the verdict names, then equivalent alternatives, then the next best."""
    verdict = discovery.verdict
    by_effects = {fit.effects: fit for fit in reversed((*discovery.steps[-1:], *discovery.fits))}
    equivalent = [by_effects[names] for names in verdict.alternatives if names in by_effects]
    size = max(len(verdict.effects), 1)
    next_best = [
        fit for fit in discovery.fits
        if sound(fit) and (len(fit.effects) == size or (verdict.status == "unexplained" and fit.effects))
    ]  # fmt: skip
    chosen = [discovery.fit, *equivalent, *next_best]
    distinct = {fit.effects: fit for fit in reversed(chosen) if fit.effects}
    ordered = [distinct[names] for names in dict.fromkeys(fit.effects for fit in chosen) if names]
    return discovery.steps[0], *ordered[:MAX_RIVALS]


def overlay(steps: Sequence[Step], chosen: int, theme: Theme) -> Spec:
    """Mean speed against ω with the curve of every rival, the chosen one thicker; one panel per φ."""
    cells = steps[0].fit.cells
    colours = theme.model_colours(len(steps))
    spec = speed_panels(steps, theme)
    for i, band in enumerate(bands(cells)):
        drawn = [line(step, i, _line_style(n, n == chosen, colours)) for n, step in enumerate(steps)]
        spec["data"] += in_panel(i, [*drawn, points(cells, band, theme.ink, theme)])
    spec["data"] += [
        legend_entry(step.label, mode="lines", line=_line_style(n, n == chosen, colours))
        for n, step in enumerate(steps)
    ]
    return spec


def overlay_figure(name: str, steps: Sequence[Step], alt: tuple[str, ...]) -> Figure:
    """The overlay, for each step as the chosen one."""
    return Figure(
        name, alt,
        "Points: measured, bars one standard deviation of a trial. Lines: the models, the one chosen above is thicker.",
        lambda theme: [overlay(steps, n, theme) for n in range(len(steps))],
    )  # fmt: skip


def _line_style(n: int, chosen: bool, colours: Sequence[str]) -> Spec:
    return {"color": colours[n], "width": 3.5 if chosen else 1.8, "dash": DASHES[n % len(DASHES)]}


def comparison_table(steps: Sequence[Step], tried: Sequence[Fit]) -> Table:
    """ΔBIC to the best, error, lack of fit and missed conditions of each rival, all by the same fits, ``tried``."""
    by_effects = {fit.effects: fit for fit in tried}
    fits = [by_effects[step.fit.effects] for step in steps]
    best = min(fit.bic for fit in fits)
    rows = [
        (
            step.label, text.number(fit.bic - best), text.centi(fit.rmse_m_s), text.centi(fit.cv_rmse_m_s),
            str(fit.cross_validation.cells), text.probability(fit.lack_of_fit_p), str(cells_missed(fit.fails)),
        )
        for step, fit in zip(steps, fits, strict=True)
    ]  # fmt: skip
    caption = "ΔBIC to the best of these: above 10, the data speak strongly against it. Errors of mean speed."
    if any(step.fit.nuisances and not fit.nuisances for step, fit in zip(steps, fits, strict=True)):
        caption += " Models are compared without nuisance parameters (lift zero, speed scale, drift)."
    counts = ("conditions scored", "lack of fit, p", "conditions missed")
    head = ("model", "ΔBIC", "error (cm/s)", "out of sample (cm/s)", *counts)
    return Table(caption, head, rows, (True, *[False] * 6))
