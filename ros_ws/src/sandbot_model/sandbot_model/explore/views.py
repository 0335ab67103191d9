"""The content of the explorer for a selection, as plain data: figure, ladder, captions and numbers."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sandbot_common.errors import InputError
from sandbot_model.discovery.selection import Selection
from sandbot_model.explore.actions import slider_value
from sandbot_model.explore.condition import index_of
from sandbot_model.explore.highlight import mark
from sandbot_model.explore.session import Session
from sandbot_model.fitting.errors import with_sampled_errors
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.goodness import cells_missed
from sandbot_model.fitting.text import with_unit
from sandbot_model.physics.effect import Effect
from sandbot_model.report import balance, captions, figures, lock, mechanics, model_difference, residual_map, text
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
"""View → title of its tab."""
OF_THE_MODEL = ("residuals", "critical", "step", "balance")
"""Views that show nothing where the data determine no model."""
COLUMNS = 4
PANE_COLUMNS = 2
"""Panels per row of a figure alone, and of one side by side with another."""


@dataclass(frozen=True)
class Shown:
    """Everything that changes with the selection."""

    steps: tuple[Step, ...]
    current: Step
    ladder: Spec
    ladder_caption: str
    figure: Spec
    how_to_read: str
    """How to read the figure."""
    caption: str
    """What it shows, in words and numbers."""
    status: str


@dataclass(frozen=True)
class Pane:
    """A second figure beside the first; without a figure, ``caption`` gives the reason."""

    title: str
    caption: str
    figure: Spec | None = None
    same_axes: bool = True
    """Whether it shares the axes of the first figure."""


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
    """Fit the selection and draw its figure. Raises InputError for an unknown effect or parameter."""
    steps = session.ladder(selection)
    current = session.step(selection)
    rungs = (*steps, current) if selection.by_hand else steps
    floor = session.noise_floor_m_s
    ladder = figures.ladder(rungs, floor, len(rungs) - 1, theme)
    if selection.by_hand:
        ladder["layout"]["xaxis"]["ticktext"][-1] = "by hand"
    view = "speed" if selection.view == "parameters" else selection.view
    missing = unavailable(selection, current)
    return Shown(
        steps=steps,
        current=current,
        ladder=ladder,
        ladder_caption=captions.ladder(steps, floor),
        figure=message_figure(missing, theme) if missing else figure(selection, steps[0], current, theme),
        how_to_read="" if missing else captions.how_to_read(view, current.fit.cells),
        caption=missing or caption(selection, current),
        status=status(selection, current, floor),
    )


def second_pane(session: Session, selection: Selection, title: str, theme: Theme) -> Pane:
    """A pane with the same view of another data set or model, or with the reason why it can't be shown."""
    try:
        current = session.step(selection)
    except InputError as error:
        return Pane(title, str(error))
    missing = unavailable(selection, current)
    if missing:
        return Pane(title, missing)
    words = f"{status(selection, current, session.noise_floor_m_s)} {caption(selection, current)}"
    return Pane(title, words, figure(selection, None, current, theme, columns=PANE_COLUMNS))


def difference(session: Session, selection: Selection, other: Selection, theme: Theme) -> Pane:
    """A pane with the difference between the model shown and the second model, over the conditions measured."""
    observable = selection.observable if selection.view == "residuals" else "speed"
    try:
        pair = session.step(selection), session.step(other)
    except InputError as error:
        return Pane("Difference", str(error))
    if observable not in pair[0].fit.cells.observables:
        return Pane("Difference", unavailable(replace(selection, view="residuals", observable=observable), pair[0]))
    spec = mark(
        model_difference.difference_map(*pair, observable, theme), index_of(session.cells, selection.cell), theme
    )
    return Pane("Difference of the two", model_difference.difference_caption(*pair, observable), spec, same_axes=False)


def figure(selection: Selection, base: Step | None, current: Step, theme: Theme, columns: int = COLUMNS) -> Spec:
    """The figure of the selected view, with the model ``base``, if given, faintly behind."""
    cells = current.fit.cells

    def speed() -> Spec:
        if current.fit.undetermined:
            return figures.measured_speed(current, theme)
        return figures.speed(current, base, theme, columns=columns, with_uncertainty=not selection.by_hand)

    draw: Mapping[str, Callable[[], Spec]] = {
        "speed": speed,
        "residuals": lambda: residual_map.residual_map(current, selection.observable, base, theme),
        "critical": lambda: mechanics.critical(current, theme),
        "step": lambda: mechanics.step_ratio(current, theme),
        "balance": lambda: balance.force_balance(current, frequency(selection, current), base, theme, columns),
        "lock": lambda: lock.geometry_lock(cells, theme),
        "parameters": speed,
    }
    return mark(draw[selection.view](), index_of(cells, selection.cell), theme)


def caption(selection: Selection, current: Step) -> str:
    """Caption of the selected view."""
    by_view: Mapping[str, Callable[[], str]] = {
        "speed": lambda: _speed_caption(current),
        "residuals": lambda: captions.residuals(current, selection.observable),
        "critical": lambda: captions.critical(current),
        "step": lambda: captions.step_ratio(current),
        "balance": lambda: captions.balance(current, frequency(selection, current)),
        "lock": lambda: captions.lock(current.fit.cells),
        "parameters": lambda: _speed_caption(current),
    }
    return by_view[selection.view]()


def _speed_caption(current: Step) -> str:
    missing = current.fit.undetermined
    return (
        f"{captions.measured_speed(current.fit.cells)} No model is drawn: {missing}."
        if missing
        else captions.speed(current)
    )


def unavailable(selection: Selection, current: Step) -> str:
    """Why the data can't show the selected view; empty if they can."""
    measured = current.fit.cells.observables
    if selection.view == "residuals" and selection.observable not in measured:
        return f"{readable(selection.observable).capitalize()} was not measured in these trials."
    if selection.view == "lock" and not {"speed", "lift"} <= set(measured):
        return "The geometry lock needs speed and lift; lift was not measured in these trials."
    if current.fit.undetermined and selection.view in OF_THE_MODEL:
        return f"{current.fit.undetermined}: figures of the model are left out."
    return ""


def frequency(selection: Selection, current: Step) -> float:
    """The leg frequency [rad/s] of the chosen cell; without one, that at which the model fails most."""
    cell = index_of(current.fit.cells, selection.cell)
    return captions.worst_frequency(current.fit) if cell is None else float(current.fit.cells.omega[cell])


def same_ranges(specs: Sequence[Spec]) -> None:
    """Give figures side by side the same range of y."""
    layouts = [spec["layout"].items() for spec in specs]
    axes = [axis for layout in layouts for name, axis in layout if name.startswith("yaxis") and "range" in axis]
    if axes:
        together = np.array([axis["range"] for axis in axes])
        for axis in axes:
            axis["range"] = [float(together[:, 0].min()), float(together[:, 1].max())]


def status(selection: Selection, current: Step, noise_floor_m_s: float) -> str:
    """The one-sentence summary that screen readers announce after each change."""
    fit = current.fit
    by_hand = ", some values held by hand" if selection.by_hand else ""
    if fit.undetermined:
        return f"{current.whole_label}{by_hand} can't be tested: {fit.undetermined}."
    failing = cells_missed(fit.fails)
    outside = "" if selection.by_hand else f", {fit.out_of_sample}"
    return (
        f"{current.whole_label}{by_hand}: error {text.cm_s(fit.rmse_m_s)}{outside}; "
        f"noise floor {text.cm_s(noise_floor_m_s)}; {failing} of {text.counted(len(fit.cells), 'condition')} "
        f"{'fails' if 1 in (failing, len(fit.cells)) else 'fail'}."
    )


def fitted_values(effect: Effect, fit: Fit) -> str:
    """Fitted values ± errors of an effect switched on, with descriptions and units; empty without parameters."""
    parts = []
    for name in fit.parameters:
        if name.startswith(f"{effect.identifier}."):
            words, unit = text.described(name, [effect])
            value = with_unit(fit.parameter_text(name), unit)
            parts.append(f"{words.removeprefix(f'{readable(effect.identifier)}: ')} {value}")
    return "; ".join(parts)


def sliders(selection: Selection, current: Step, effects: Mapping[str, Effect]) -> list[Slider]:
    """One slider for each shared parameter of the model shown, over its plausible range extended to the value."""
    model = current.fit.model
    held = dict(selection.by_hand)
    found = []
    for name, parameter in zip(model.names, replace(model, held={}).parameters, strict=True):
        value = slider_value(held.get(name, current.fit.parameters[name].value))
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


def parameter_rows(selection: Selection, fitted: Step, effects: Mapping[str, Effect]) -> list[tuple[str, str, str]]:
    """(description, value ± stderr, unit) of every parameter; no error for those held by hand, others as ``fitted``."""
    held = dict(selection.by_hand)
    fit = with_sampled_errors(fitted.fit)
    rows = []
    for name, estimate in fit.parameters.items():
        words, unit = text.described(name, effects.values())
        rows.append((words, f"{held[name]:.5g} (held)" if name in held else fit.value_text(*estimate), unit))
    for phi, k, stderr in zip(fit.level_phi, fit.k_n_per_m, fit.k_stderr_n_per_m, strict=True):
        rows.append((f"k at φ = {phi:.3f}, stiffness of the ground under a leg", fit.value_text(k, stderr), "N/m"))
    return rows


def message_figure(sentence: str, theme: Theme) -> Spec:
    """An empty figure with a sentence that explains why."""
    hidden = {"visible": False}
    words = note(sentence, 0.0, 1.0, xanchor="left", yanchor="top", font={"size": 15})
    return {"data": [], "layout": layout(theme, 120, xaxis=hidden, yaxis=hidden, annotations=[words])}
