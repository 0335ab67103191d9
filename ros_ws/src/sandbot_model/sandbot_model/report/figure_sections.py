"""The figure sections of the page, in order, with their captions and tables."""

import math

from sandbot_model.data.conditions import Cells, noise_floor
from sandbot_model.discovery.ladder import error_of_rms
from sandbot_model.fitting.goodness import cells_missed
from sandbot_model.physics.observables import CM, Observable
from sandbot_model.report import balance, captions, figures, lock, mechanics, residual_map, rivals, run_order, text
from sandbot_model.report.page import Figure, Section, Table
from sandbot_model.report.view import Step, is_ladder
from sandbot_record.trials.table import Trials


def figure_sections(steps: tuple[Step, ...], floor: float) -> list[Section]:
    """Every figure possible with the observables measured, in reading order."""
    cells = steps[0].fit.cells
    lock = [Section("lock", "The geometry lock: lift against speed", figures=(_lock_figure(cells),))]
    lock = lock if {"speed", "lift"} <= set(cells.observables) else []
    if missing := next((step.fit.undetermined for step in steps if step.fit.undetermined), ""):
        line = f"{missing}: figures of the model are left out."
        return [
            Section("speed", "Speed against leg frequency", text=(line,), figures=(_measured_speed_figure(steps[0]),)),
            *lock,
        ]
    omega = captions.worst_frequency(steps[0].fit)
    why = "where the base model misses the mean speed most" if "speed" in cells.observables else "the median one"
    return [
        Section("speed", "Speed against leg frequency", figures=(_speed_figure(steps),)),
        Section(
            "residuals",
            "Where the model fails",
            text=(captions.how_to_read("residuals", cells),),
            figures=tuple(_residual_figure(steps, name) for name in cells.observables),
        ),
        Section(
            "ladder", "Error as effects are added" if is_ladder(steps) else "Error of each model",
            figures=(_ladder_figure(steps, floor),), tables=(_errors(steps),),
        ),
        *lock,
        Section("collapse", "Where walking collapses", figures=(_collapse_figure(steps),)),
        Section("step", "Step length", figures=(_step_figure(steps),)),
        Section(
            "balance", f"Force balance at ω = {omega:.3g} rad/s, {why}",
            figures=(_balance_figure(steps, omega),),
        ),
    ]  # fmt: skip


def _speed_figure(steps: tuple[Step, ...]) -> Figure:
    if not is_ladder(steps):
        return rivals.overlay_figure("speed", steps, tuple(captions.speed(step) for step in steps))
    return Figure(
        name="speed",
        alt=tuple(captions.speed(step) for step in steps),
        caption=captions.how_to_read("speed", steps[0].fit.cells),
        draw=lambda theme: [figures.speed(step, steps[0], theme) for step in steps],
    )


def _measured_speed_figure(step: Step) -> Figure:
    return Figure(
        name="speed",
        alt=(captions.measured_speed(step.fit.cells),),
        caption=captions.points(step.fit.cells),
        draw=lambda theme: [figures.measured_speed(step, theme)],
    )


def _residual_figure(steps: tuple[Step, ...], observable: str) -> Figure:
    return Figure(
        name=f"residuals-{observable}",
        alt=tuple(captions.residuals(step, observable) for step in steps),
        caption="",
        draw=lambda theme: [residual_map.residual_map(step, observable, steps[0], theme) for step in steps],
    )


def run_order_section(trials: Trials, steps: tuple[Step, ...]) -> list[Section]:
    """Residuals in run order; none where too few trials have a known place, or the model is not determined."""
    if steps[-1].fit.undetermined or not run_order.drawable(trials, steps[-1].fit):
        return []
    figure = Figure(
        name="run-order",
        alt=tuple(run_order.caption(trials, step.fit) for step in steps),
        caption="",
        draw=lambda theme: [run_order.figure(trials, step.fit, theme) for step in steps],
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


def _lock_figure(cells: Cells) -> Figure:
    return Figure(
        name="lock",
        alt=(captions.lock(cells),),
        caption=captions.how_to_read("lock", cells),
        draw=lambda theme: [lock.geometry_lock(cells, theme)],
    )


def _collapse_figure(steps: tuple[Step, ...]) -> Figure:
    return Figure(
        name="collapse",
        alt=tuple(captions.critical(step) for step in steps),
        caption=captions.how_to_read("critical", steps[0].fit.cells),
        draw=lambda theme: [mechanics.critical(step, theme) for step in steps],
    )


def _step_figure(steps: tuple[Step, ...]) -> Figure:
    return Figure(
        name="step",
        alt=tuple(captions.step_ratio(step) for step in steps),
        caption=captions.how_to_read("step", steps[0].fit.cells),
        draw=lambda theme: [mechanics.step_ratio(step, theme) for step in steps],
    )


def _balance_figure(steps: tuple[Step, ...], omega_rad_s: float) -> Figure:
    return Figure(
        name="balance",
        alt=tuple(captions.balance(step, omega_rad_s) for step in steps),
        caption=captions.how_to_read("balance", steps[0].fit.cells),
        draw=lambda theme: [balance.force_balance(step, omega_rad_s, steps[0], theme) for step in steps],
    )
