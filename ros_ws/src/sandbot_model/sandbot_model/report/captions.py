"""Captions: how to read each figure, and a text alternative with what it shows in words and numbers."""

import numpy as np

from sandbot_model.data.conditions import Cells
from sandbot_model.discovery import compare
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.observables import CM, Observable
from sandbot_model.report import text
from sandbot_model.report.balance import forces
from sandbot_model.report.mechanics import collapse
from sandbot_model.report.residual_map import UNTESTED, failing_cells
from sandbot_model.report.view import SHOWN_SDS, Step, band_name, bands, measured, observable_label, residual_z

PERFECT = "the error expected of a perfect model; a model falls below it by chance or by fitting the noise"
"""What the noise floor means."""

HOW_TO_READ = {
    "speed": f"{{points}} Solid: the chosen model, shaded, where errors are known, ± {SHOWN_SDS:g} standard errors "
    "from its fitted parameters. "
    "Dashed grey, where drawn: the base model. Where walking would be slower than swimming, swimming is drawn; a line "
    "is broken where it jumps.",
    "residuals": "▲ measured above the model, ▼ below; the number is the residual in standard errors of the mean. "
    "Cells without a mark agree with the model; – was not measured, or is not used (a peak that may belong to either "
    "phase of the clock).",
    "ladder": "In sample: the model fitted to all trials. Out of sample: each condition that the others can predict, "
    f"predicted by a model fitted without it. Noise floor: {{scatter}}, {PERFECT}.",
    "lock": "A leg of radius R that lifts its axle by Δz advances by s = 2√(Δz(2R − Δz)), whatever the "
    "ground. Points along the curve: the legs hold, and only how deep they sink changes. Points off it: speed is lost "
    "or gained after the legs hold (slip, drag, overlap of stances, coasting). Open grey: the robot swims (no lift "
    "beyond noise).",
    "critical": "Left: the frequency ω at which walking ends; the bar spans from the last measured ω that walks to the "
    "first that swims. Right: the largest mean speed, modelled over all ω (line) and over the measured ω (circles).",
    "step": "Step length πv̄/ω over leg radius R, lines as for speed. Grey band: s/R from 0.9 to 1, where Li09 saw "
    "walking end.",
    "balance": "The leg sinks until the ground first gives what the body needs (dot); where it never does, the robot "
    "swims. Coloured: force the ground gives. Dashed: weight plus the force that brings the body to leg speed. "
    "Thin grey: the base model's.",
}
"""Figure → how to read it; {points} and {scatter} depend on what the pure error is of."""


def how_to_read(figure: str, cells: Cells) -> str:
    """How to read a figure of these cells."""
    scatter = "r.m.s. of the error bars given" if cells.error_bars else "scatter of replicates"
    return HOW_TO_READ[figure].format(points=points(cells), scatter=scatter)


def points(cells: Cells) -> str:
    """What measured points and their bars are."""
    if cells.error_bars:
        return "Points: means as given, bars the r.m.s. of the error bars given."
    return "Points: mean over the replicates of a condition, bars one standard deviation of a single trial."


def speed(step: Step) -> str:
    """Where mean speed is largest, and where the model's error is largest."""
    cells, seen = step.fit.cells, measured(step.fit.cells, "speed")
    if not np.isfinite(seen).any():
        return measured_speed(cells)
    worst = int(np.nanargmax(np.abs(seen - step.fit.predicted[:, Observable.speed])))
    return (
        f"{measured_speed(cells)} Missed most: {condition_label(cells, worst)}, measured {text.cm_s(seen[worst])}, "
        f"modelled {text.cm_s(step.fit.predicted[worst, Observable.speed])}."
    )


def measured_speed(cells: Cells) -> str:
    """Where mean speed is largest."""
    seen = measured(cells, "speed")
    if not np.isfinite(seen).any():
        return "Mean speed was not measured."
    best = int(np.nanargmax(seen))
    return (
        f"Mean speed against leg frequency ω, one panel for each of "
        f"{text.counted(len(bands(cells)), 'volume fraction')}. Fastest: {text.cm_s(seen[best])} at "
        f"{condition_label(cells, best)}."
    )


def residuals(step: Step, observable: str) -> str:
    """How many cells fail and which is the worst."""
    cells, failing = step.fit.cells, failing_cells(step.fit, observable)
    z = np.where(failing, residual_z(step.fit, observable), np.nan)
    prefix = f"Map over φ and ω of standardised residuals of {observable_label(observable)}, {step.label}: "
    if not np.isfinite(z).any():
        return f"{prefix}{'no cell fails' if np.isfinite(step.fit.lack_of_fit_p) else UNTESTED}."
    worst = int(np.nanargmax(np.abs(z)))
    fail = next(f for f in step.fit.fails if f.observable == observable)
    more = "more" if z[worst] > 0 else "less"
    verb = "fails" if failing.sum() == 1 else "fail"
    return (
        f"{prefix}{int(failing.sum())} of {text.counted(len(cells), 'cell')} {verb}. Worst: "
        f"{condition_label(cells, worst)}, {text.to_error(CM * abs(fail.residual), CM * fail.stderr)} "
        f"{Observable[observable].readers_unit} {more} than modelled, {text.number(abs(z[worst]))} standard errors."
    )


def critical(step: Step) -> str:
    """Where walking ends, per volume fraction."""
    cells = step.fit.cells
    seen = collapse(cells)
    parts = []
    for i, band in enumerate(bands(cells)):
        last, first = seen.last_walking_rad_s[i], seen.first_swimming_rad_s[i]
        if not np.isfinite(last):
            ends = "never walks"
        elif not np.isfinite(first):
            ends = f"walks up to {last:.3g} rad/s, the largest ω measured"
        else:
            ends = f"walking ends between {last:.3g} and {first:.3g} rad/s"
        parts.append(f"{band.label}: {ends}, fastest {text.cm_s(seen.peak_speed_m_s[i])}")
    return f"Critical leg frequency and largest mean speed against volume fraction. {'; '.join(parts)}."


def step_ratio(step: Step) -> str:
    """The range of step lengths measured."""
    cells = step.fit.cells
    ratio = np.pi * measured(cells, "speed") / cells.omega / step.fit.model.robot.leg_radius_m
    if not np.isfinite(ratio).any():
        return "Mean speed was not measured, so step length is not known."
    longest = int(np.nanargmax(ratio))
    return (
        f"Step length over leg radius against leg frequency, measured and modelled, for "
        f"{text.counted(len(bands(cells)), 'volume fraction')}. Longest: "
        f"{ratio[longest]:.2f} R at {condition_label(cells, longest)}; shortest "
        f"{np.nanmin(ratio):.2f} R."
    )


def balance(step: Step, omega_rad_s: float) -> str:
    """Depth at which the leg holds, per volume fraction."""
    depth = forces(step.fit, omega_rad_s).holds_m
    holds = (
        f"{band.label}: {f'{CM * d:.2f} cm' if np.isfinite(d) else 'never, it swims'}"
        for band, d in zip(bands(step.fit.cells), depth, strict=True)
    )
    return f"Forces on a leg against depth at ω = {omega_rad_s:.3g} rad/s. Depth at which it holds: {'; '.join(holds)}."


def lock(cells: Cells) -> str:
    """Ratio of the step length from speed to that from lift."""
    ratio = compare.geometry_lock(cells)
    finite = ratio[np.isfinite(ratio)]
    if not finite.size:
        return "Step length against body lift. No walking cell has both speed and lift."
    return (
        "Step length against body lift, with the curve that the geometry of a circular leg of radius "
        f"R = {CM * cells.robot.leg_radius_m:.3g} cm dictates. Step length from "
        f"speed over step length from lift: median {np.median(finite):.3f} over {finite.size} walking cells (1: "
        "nothing lost or gained between step and speed)."
    )


def ladder(steps: tuple[Step, ...], noise_floor_m_s: float) -> str:
    """Errors of each step of the ladder."""
    rungs = "; ".join(
        f"{step.label} {text.cm_s(step.fit.rmse_m_s)} in sample, {step.fit.out_of_sample}" for step in steps
    )
    return f"Error of mean speed for each step: {rungs}; noise floor {text.cm_s(noise_floor_m_s)}."


def condition_label(cells: Cells, cell: int) -> str:
    """The φ and ω of a cell, as in the labels of panels and maps."""
    return f"φ {band_name(cells, cell)}, ω {cells.omega[cell]:.3g} rad/s"


def worst_frequency(fit: Fit) -> float:
    """The leg frequency [rad/s] with the largest standardised residual of speed; the median ω if none is known."""
    z = np.abs(residual_z(fit, "speed"))
    if not np.isfinite(z).any():
        return float(np.median(fit.cells.omega))
    return float(fit.cells.omega[int(np.nanargmax(z))])
