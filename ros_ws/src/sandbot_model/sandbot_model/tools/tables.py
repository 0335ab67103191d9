"""Plain-text tables of fits, in a reader's units (cm, cm/s)."""

from collections.abc import Mapping, Sequence

import numpy as np

from sandbot_model.discovery.discover import Discovery
from sandbot_model.discovery.ladder import ladder_rows
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.text import table
from sandbot_model.physics.arrays import Array
from sandbot_model.physics.gait import assumption
from sandbot_model.physics.observables import CM, Observable


def data_line(fit: Fit) -> str:
    """What was read, in one line."""
    cells = fit.cells
    left_out = f", {cells.excluded} trials left out" if cells.excluded else ""
    assumed = assumption(cells.gait)
    return (
        f"{cells.trials} trials in {len(cells)} cells ({len(cells.level_phi)} volume fractions){left_out}; "
        f"measured: {', '.join(cells.observables)}{assumed and f'; {assumed}'}"
    )


def notes(found: Sequence[str]) -> str:
    """What is odd about the trials, a line each; nothing where nothing is."""
    return "".join(f"note: {note}\n" for note in found) + ("\n" if found else "")


def ladder(steps: Sequence[Fit]) -> str:
    """Each step's error per observable, in and out of sample, over the noise floor."""
    return table(ladder_rows(steps))


def bootstrap(fit: Fit, drawn: Mapping[str, float], draws: int) -> str:
    """Standard errors of the fit's Jacobian beside those of a bootstrap over trials."""
    rows = [["parameter", "value", "± stderr", f"± bootstrap, {draws} draws"]]
    ks = {f"k[{i}]": pair for i, pair in enumerate(zip(fit.k_n_per_m, fit.k_stderr_n_per_m, strict=True))}
    fitted = {**fit.parameters, **ks}
    rows += [[name, *(f"{value:.4g}" for value in fitted[name]), f"{stderr:.2g}"] for name, stderr in drawn.items()]
    return table(rows)


def parameters(fit: Fit) -> str:
    """Shared parameters and k(φ) with standard errors (SI units, as their names say)."""
    rows = [["parameter", "value", "± stderr", ""]]
    for name, (value, stderr) in fit.parameters.items():
        flag = (
            "at its bound"
            if name in fit.at_bounds
            else "outside its plausible range"
            if name in fit.implausible
            else ""
        )
        rows.append([name, f"{value:.4g}", f"{stderr:.2g}", flag])
    for phi, k, stderr in zip(fit.level_phi, fit.k_n_per_m, fit.k_stderr_n_per_m, strict=True):
        rows.append([f"k_n_per_m at phi {phi:.4f}", f"{k:.1f}", f"{stderr:.2g}", ""])
    return table(rows)


def lock_line(ratio: Array) -> str:
    """The geometry lock in one line: it needs no fit."""
    finite = np.isfinite(ratio)
    if not finite.any():
        return "geometry lock: speed and lift of walking cells are needed to check it"
    spread = f"{ratio[finite].min():.3f} to {ratio[finite].max():.3f}"
    return (
        f"geometry lock: step from speed over step from lift is {np.median(ratio[finite]):.3f} "
        f"(median of {finite.sum()} walking cells, {spread}; 1 where nothing is lost between step and speed)"
    )


def fails(fit: Fit, most: int = 12) -> str:
    """The worst missed cell means."""
    if not fit.fails:
        return "no cell mean is missed by more than 3 standard errors"
    rows = [["observable", "phi", "omega [rad/s]", "measured - model", "z"]]
    for fail in fit.fails[:most]:
        residual = f"{CM * fail.residual:+.2f} {Observable[fail.observable].readers_unit}"
        rows.append([fail.observable, f"{fail.phi:.4f}", f"{fail.omega_rad_s:.4g}", residual, f"{fail.z:+.1f}"])
    more = f"\n… and {len(fit.fails) - most} more" if len(fit.fails) > most else ""
    return table(rows) + more


def candidates(discovery: Discovery, most: int = 10) -> str:
    """Single effects by what they change."""
    rows = [["effect", "stage", "Δχ²", "ΔBIC", "out of sample [cm/s]", "weight"]]
    for candidate in discovery.candidates[:most]:
        rows.append(
            [
                candidate.effect,
                candidate.stage,
                f"{candidate.delta_chi2:+.1f}",
                f"{candidate.delta_bic:+.1f}",
                f"{CM * candidate.cv_rmse_m_s:.3f}",
                f"{candidate.weight:.3g}",
            ]
        )
    return table(rows)


def stages(discovery: Discovery) -> str:
    """Where in the chain the base model fails."""
    rows = [["stage", "connects", "cells", "χ²", "p", "missed"]]
    for test in discovery.stages:
        rows.append(
            [test.stage, test.connects, str(test.cells), f"{test.chi2:.0f}", f"{test.p:.2g}", str(len(test.missed))]
        )
    return table(rows)


def next_trials(discovery: Discovery) -> str:
    """What to measure next."""
    rows = [["at", "look at", "separates", "expected gap [sd]", "replicates"]]
    for trial in discovery.next_trials:
        rows.append(
            [
                trial.where,
                trial.observable,
                " | ".join(trial.separates),
                f"{trial.expected_gap_sd:.1f}" if np.isfinite(trial.expected_gap_sd) else "-",
                str(trial.replicates),
            ]
        )
    return table(rows)
