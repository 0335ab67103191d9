"""The figure sections of the page, in order, with their captions and tables."""

import math
from collections.abc import Callable

from sandbot_model.data.conditions import Cells, noise_floor
from sandbot_model.discovery.ladder import error_of_rms
from sandbot_model.fitting.goodness import cells_missed
from sandbot_model.physics.observables import CM, Observable
from sandbot_model.report import balance, captions, figures, lock, mechanics, residual_map, rivals, run_order, text
from sandbot_model.report.page import Figure, Section, Table
from sandbot_model.report.theme import Spec, Theme
from sandbot_model.report.view import Step, is_ladder
from sandbot_record.trials.table import Trials


def figure_sections(steps: tuple[Step, ...], floor: float) -> list[Section]:
    """Every figure possible with the observables measured, in reading order."""
    cells = steps[0].fit.cells
    geometry = [Section("lock", "The geometry lock: lift against speed", figures=(lock_figure(cells),))]
    geometry = geometry if {"speed", "lift"} <= set(cells.observables) else []
    if missing := next((step.fit.undetermined for step in steps if step.fit.undetermined), ""):
        line = f"{missing}: figures of the model are left out."
        return [
            Section("speed", "Speed against leg frequency", text=(line,), figures=(_measured_speed_figure(steps[0]),)),
            *geometry,
        ]
    omega = captions.worst_frequency(steps[0].fit)
    why = "where the base model misses the mean speed most" if "speed" in cells.observables else "the median one"
    return [
        Section("speed", "Speed against leg frequency", figures=(_speed_figure(steps),)),
        Section(
            "residuals",
            "Where the model fails",
            text=(captions.how_to_read("residuals", cells),),
            figures=tuple(residual_figure(steps, name) for name in cells.observables),
        ),
        Section(
            "ladder", "Error as effects are added" if is_ladder(steps) else "Error of each model",
            figures=(_ladder_figure(steps, floor),), tables=(_errors(steps),),
        ),
        *geometry,
        Section("collapse", "Where walking collapses", figures=(
            _of_each("collapse", steps, mechanics.critical, captions.critical, "critical"),
        )),
        Section("step", "Step length", figures=(
            _of_each("step", steps, mechanics.step_ratio, captions.step_ratio, "step"),
        )),
        Section("balance", f"Force balance at ω = {omega:.3g} rad/s, {why}", figures=(
            _of_each(
                "balance", steps,
                lambda step, theme: balance.force_balance(step, omega, steps[0], theme),
                lambda step: captions.balance(step, omega),
                "balance",
            ),
        )),
    ]  # fmt: skip


def _of_each(
    name: str,
    steps: tuple[Step, ...],
    draw: Callable[[Step, Theme], Spec],
    in_words: Callable[[Step], str],
    how_to_read: str = "",
) -> Figure:
    """A figure of each step, with the text alternative of each, and the caption ``how_to_read``, if any."""
    caption = captions.how_to_read(how_to_read, steps[0].fit.cells) if how_to_read else ""
    return Figure(name, tuple(map(in_words, steps)), caption, lambda theme: [draw(step, theme) for step in steps])


def _speed_figure(steps: tuple[Step, ...]) -> Figure:
    if not is_ladder(steps):
        return rivals.overlay_figure("speed", steps, tuple(map(captions.speed, steps)))
    return _of_each("speed", steps, lambda step, theme: figures.speed(step, steps[0], theme), captions.speed, "speed")


def _measured_speed_figure(step: Step) -> Figure:
    cells = step.fit.cells
    return Figure(
        "speed",
        (captions.measured_speed(cells),),
        captions.points(cells),
        lambda theme: [figures.measured_speed(step, theme)],
    )


def residual_figure(steps: tuple[Step, ...], observable: str) -> Figure:
    """Residual maps of an observable, with those of the first step, the base model, on the left."""
    return _of_each(
        f"residuals-{observable}",
        steps,
        lambda step, theme: residual_map.residual_map(step, observable, steps[0], theme),
        lambda step: captions.residuals(step, observable),
    )


def run_order_section(trials: Trials, steps: tuple[Step, ...]) -> list[Section]:
    """Residuals in run order; none where too few trials have a known place, or the model is not determined."""
    if steps[-1].fit.undetermined or not run_order.drawable(trials, steps[-1].fit):
        return []
    figure = _of_each(
        "run-order",
        steps,
        lambda step, theme: run_order.figure(trials, step.fit, theme),
        lambda step: run_order.caption(trials, step.fit),
    )
    return [Section("order", "Residuals in run order", figures=(figure,))]


def _ladder_figure(steps: tuple[Step, ...], floor: float) -> Figure:
    return Figure(
        name="ladder",
        alt=(captions.ladder(steps, floor),),
        caption=captions.how_to_read("ladder", steps[0].fit.cells),
        draw=lambda theme: [figures.ladder(steps, floor, i, theme) for i in range(len(steps))],
    )


def _errors(steps: tuple[Step, ...]) -> Table:
    """Error per observable, in and out of sample, for each step, with the noise floor."""
    cells = steps[0].fit.cells
    floor = noise_floor(cells)

    def rounded(name: str, error: float) -> str:
        return text.to_error(CM * error, error_of_rms(floor[name], int(cells.pure_error_dof[Observable[name]])))

    head = [
        "model",
        *(Observable[name].heading for name in cells.observables),
        "cells scored",
        "lack of fit, p",
        "failing cells",
    ]
    rows = []
    for step in steps:
        errors = (
            f"{rounded(n, step.fit.rmse[n])} / {rounded(n, step.fit.cross_validation.rmse[n])}"
            for n in cells.observables
        )
        counts = (step.fit.cross_validation.cells, cells_missed(step.fit.fails))
        scored, failing = (f"{count} of {len(cells)}" for count in counts)
        failing = failing if math.isfinite(step.fit.lack_of_fit_p) else text.UNKNOWN
        rows.append((step.label, *errors, scored, text.probability(step.fit.lack_of_fit_p), failing))
    rows.append(("noise floor", *(rounded(name, floor[name]) for name in cells.observables), "", "", ""))
    caption = (
        "Error in sample / out of sample, per observable. Cells scored: those that the others predict. Lack of fit: "
        "how often pure error alone would give a misfit as large."
    )
    return Table(caption, tuple(head), rows, (True, *(False for _ in head[1:])))


def lock_figure(cells: Cells) -> Figure:
    """Step length against lift, with nothing fitted."""
    return Figure(
        "lock",
        (captions.lock(cells),),
        captions.how_to_read("lock", cells),
        lambda theme: [lock.geometry_lock(cells, theme)],
    )
