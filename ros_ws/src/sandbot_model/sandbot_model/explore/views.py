"""What the explorer shows for a selection, as plain data: the figure looked at, the ladder, words and numbers."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from sandbot_model.chain import Effect
from sandbot_model.explore.selection import Selection
from sandbot_model.explore.session import Session
from sandbot_model.report import figures, mechanics, text
from sandbot_model.report.theme import Spec, Theme, layout, note
from sandbot_model.report.view import Step, readable

TITLES = {
    "speed": "Speed",
    "residuals": "Where it fails",
    "critical": "Collapse",
    "step": "Step length",
    "balance": "Force balance",
    "lock": "Geometry lock",
    "parameters": "Parameters",
}
"""View → what its tab is called."""


@dataclass(frozen=True)
class Shown:
    """Everything that changes with the selection."""

    steps: tuple[Step, ...]
    current: Step
    ladder: Spec
    figure: Spec
    status: str


@dataclass(frozen=True)
class Slider:
    """A parameter that can be held by hand."""

    name: str
    words: str
    low: float
    high: float
    value: float
    held: bool


def show(session: Session, selection: Selection, theme: Theme) -> Shown:
    """Fit what is selected and draw the figure looked at. Raises InputError for what is not known."""
    steps = session.ladder(selection)
    current = session.shown(selection)
    rungs = (*steps, current) if selection.by_hand else steps
    ladder = figures.ladder(rungs, session.noise_floor_m_s, len(rungs) - 1, theme)
    if selection.by_hand:
        ladder["layout"]["xaxis"]["ticktext"][-1] = "by hand"
    return Shown(
        steps=steps,
        current=current,
        ladder=ladder,
        figure=figure(selection, steps[0], current, theme),
        status=status(selection, current, session.noise_floor_m_s),
    )


def figure(selection: Selection, base: Step, current: Step, theme: Theme) -> Spec:
    """The figure of the selected view; words in its place where the data can't show it."""
    cells = current.fit.cells
    cell = min(selection.cell or 0, len(cells) - 1)
    draw: Mapping[str, Callable[[], Spec]] = {
        "speed": lambda: figures.speed(current, base, theme),
        "residuals": lambda: figures.residual_map(current, selection.observable, base, theme),
        "critical": lambda: mechanics.critical(current, theme),
        "step": lambda: mechanics.step_ratio(current, theme),
        "balance": lambda: mechanics.force_balance(current.fit, cell, theme),
        "lock": lambda: figures.geometry_lock(cells, theme),
        "parameters": lambda: figures.speed(current, base, theme),
    }
    if selection.view == "residuals" and selection.observable not in cells.observables:
        return words(f"{readable(selection.observable).capitalize()} was not measured in these trials.", theme)
    if selection.view == "lock" and not {"speed", "lift"} <= set(cells.observables):
        return words("The geometry lock needs speed and lift; lift was not measured in these trials.", theme)
    return draw[selection.view]()


def status(selection: Selection, current: Step, noise_floor_m_s: float) -> str:
    """The one sentence that a screen reader hears after each change."""
    fit = current.fit
    chosen = " + ".join([f"{selection.model} model", *map(readable, selection.effects)])
    by_hand = ", some values held by hand" if selection.by_hand else ""
    failing = len({(fail.phi, fail.omega_rad_s) for fail in fit.fails})
    outside = "" if selection.by_hand else f", {text.cm_s(fit.cv_rmse_m_s)} out of sample"
    return (
        f"{chosen}{by_hand}: error {text.cm_s(fit.rmse_m_s)}{outside}; noise floor {text.cm_s(noise_floor_m_s)}; "
        f"{failing} of {len(fit.cells)} conditions fail."
    )


def promise(error: tuple[float, float] | None, switched_on: bool) -> str:
    """What switching an effect over would do to the error of mean speed."""
    if error is None:
        return "…"
    return f"{'off' if switched_on else 'on'}: {text.cm_s(error[0])}"


def sliders(selection: Selection, current: Step, effects: Mapping[str, Effect]) -> list[Slider]:
    """One slider for each shared parameter of the model shown, over its plausible range and its value."""
    model = current.fit.fitted
    held = dict(selection.by_hand)
    found = []
    for name, parameter in zip(model.names, model.parameters, strict=True):
        # As many digits as fit beside a slider; ``actions.moved`` knows that much rounding for no move.
        value = float(f"{held.get(name, current.fit.parameters[name].value):.5g}")
        words, unit = text.described(name, effects.values())
        found.append(
            Slider(
                name,
                f"{words} ({unit})" if unit else words,
                min(parameter.low, value),
                max(parameter.high, value),
                value,
                name in held,
            )
        )
    return found


def parameter_rows(selection: Selection, current: Step, effects: Mapping[str, Effect]) -> list[tuple[str, str, str]]:
    """(what, value ± stderr, unit) of every number; those held by hand have no error."""
    held = dict(selection.by_hand)
    fit = current.fit
    rows = []
    for name, (value, stderr) in fit.parameters.items():
        words, unit = text.described(name, effects.values())
        rows.append((words, f"{value:.5g} (held)" if name in held else text.with_error(value, stderr), unit))
    for phi, k, stderr in zip(fit.level_phi, fit.k_n_per_m, fit.k_stderr_n_per_m, strict=True):
        rows.append((f"k at φ = {phi:.3f}, stiffness of the ground under a leg", text.with_error(k, stderr), "N/m"))
    return rows


def words(sentence: str, theme: Theme) -> Spec:
    """A figure that says why there is none."""
    hidden = {"visible": False}
    said = note(sentence, 0.0, 1.0, xanchor="left", yanchor="top", font={"size": 15})
    return {"data": [], "layout": layout(theme, 120, xaxis=hidden, yaxis=hidden, annotations=[said])}
