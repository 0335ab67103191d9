"""Plain-text tables of fits, in a reader's units (cm, cm/s)."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_common.terminal import filled
from sandbot_model.data.conditions import level_name
from sandbot_model.data.regime import walks
from sandbot_model.discovery.batch_sd import batch_sd_of
from sandbot_model.discovery.ladder import ladder_rows
from sandbot_model.discovery.result import Discovery
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.text import NO_ERROR, UNDETERMINED, counted, table, to_error
from sandbot_model.physics.gait import assumption
from sandbot_model.physics.observables import CM, Observable

WEIGHT = "weight: BIC weight of all sets tried that contain the effect, 1 if no set without it is likely"
WITH_NUISANCES = (
    "The last step is fitted with nuisances: errors that trials share (in the zero of the lift and the scale of speed, "
    "a drift of k{}). Without them: {}."
)
"""Why one model may have two values of p and of the error out of sample."""


def data_line(fit: Fit) -> str:
    """What was read, in one line."""
    cells = fit.cells
    left_out = f", {counted(cells.excluded, 'trial')} left out" if cells.excluded else ""
    assumed = assumption(cells.gait)
    conditions = f"{counted(len(cells), 'cell')} ({counted(len(cells.level_phi), 'volume fraction')})"
    return (
        f"{counted(cells.trials, 'trial')} in {conditions}{left_out}; "
        f"measured: {', '.join(cells.observables)}{assumed and f'; {assumed}'}"
    )


def notes(found: Sequence[str]) -> str:
    """Notes on suspicious trials, one per paragraph; empty if there are none."""
    return "".join(f"{filled(f'note: {note}')}\n" for note in found)


def ladder(steps: Sequence[Fit]) -> str:
    """Each step's error per observable, in and out of sample, over the noise floor."""
    return table(ladder_rows(steps))


def ladder_of(discovery: Discovery) -> str:
    """The ladder of a discovery, and what of its last step differs from fits elsewhere."""
    if discovery.fit.nuisances is None:
        return ladder(discovery.steps)
    beside = all(fit.nuisances is None for fit in discovery.fits)
    scatter = ", differences between batches or conditions" if batch_sd_of(discovery.fit) else ""
    note = WITH_NUISANCES.format(scatter, "compare, p in 'why' and the single effects below" if beside else "compare")
    return f"{ladder(discovery.steps)}\n{filled(note)}"


def bootstrap(fit: Fit, drawn: Mapping[str, float], draws: int) -> str:
    """Standard errors from the fit's Jacobian, and from a bootstrap over trials."""
    rows = [["parameter", "value", "± stderr", f"± bootstrap, {draws} draws"]]
    ks = {f"k[{i}]": pair for i, pair in enumerate(zip(fit.k_n_per_m, fit.k_stderr_n_per_m, strict=True))}
    fitted = {**fit.parameters, **ks}
    rows += [[name, *(f"{value:.4g}" for value in fitted[name]), f"{stderr:.2g}"] for name, stderr in drawn.items()]
    return table(rows)


def parameters(fit: Fit) -> str:
    """Shared parameters and k(φ) with standard errors (SI units, as their names say)."""
    if fit.undetermined:
        return f"{fit.undetermined}, so no values are given"
    rows = [["parameter", "value", ""]]
    for name, estimate in fit.estimates():
        rows.append([name, estimate, _remark(fit, name, estimate)])
    together = ", ".join(fit.known_only_together)
    remarks = [f"known only together, not one by one: {together}"] if together else []
    remarks += [] if fit.errors_hold else [NO_ERROR]
    return "\n".join([table(rows), *map(filled, remarks)])


def _remark(fit: Fit, name: str, estimate: str) -> str:
    """What is suspicious about an estimate. If undetermined, the search may leave it anywhere, even at a bound."""
    if name == "v_swim_m_s" and walks(fit.cells.mean).all():
        return "no cell swims"
    if estimate == UNDETERMINED:
        return ""
    return "at its bound" if name in fit.at_bounds else "outside its plausible range" if name in fit.implausible else ""


def lock_line(ratio: Floats) -> str:
    """The geometry lock, which needs no fit; empty where it can't be checked."""
    finite = np.isfinite(ratio)
    if not finite.any():
        return ""
    spread = f"{ratio[finite].min():.3f} to {ratio[finite].max():.3f}"
    return (
        f"geometry lock: step from speed over step from lift is {np.median(ratio[finite]):.3f} "
        f"(median of {counted(int(finite.sum()), 'walking cell')}, {spread}; "
        "1 where nothing is lost between step and speed)"
    )


def fails(fit: Fit, most: int) -> str:
    """The worst missed cell means."""
    if not math.isfinite(fit.lack_of_fit_p):
        return ""
    if not fit.fails:
        return "no cell mean is missed by more than 3 standard errors"
    rows = [["observable", "phi", "omega [rad/s]", "measured - model", "z"]]
    for fail in fit.fails[:most]:
        sign = "+" if fail.residual > 0.0 else ""
        residual = f"{sign}{to_error(CM * fail.residual, CM * fail.stderr)} {Observable[fail.observable].readers_unit}"
        phi = level_name(fit.cells, fail.cell)
        rows.append([fail.observable, phi, f"{fail.omega_rad_s:.4g}", residual, f"{fail.z:+.1f}"])
    return table(rows) + _more(len(fit.fails) - most)


def _more(count: int) -> str:
    return f"\n… and {count} more (--verbose)" if count > 0 else ""


def candidates(discovery: Discovery, most: int) -> str:
    """Single effects and what each improves."""
    rows = [["effect", "stage", "Δχ²", "ΔBIC", "out of\nsample\n[cm/s]", "cells\nscored", "weight"]]
    implausible, shown = discovery.only_implausible, [one.effect for one in discovery.candidates[:most]]
    for candidate in discovery.candidates[:most]:
        rows.append(
            [
                f"{candidate.effect}{' *' * (candidate.effect in implausible)}",
                candidate.stage,
                f"{candidate.delta_chi2:+.1f}",
                f"{candidate.delta_bic:+.1f}",
                f"{CM * candidate.cv_rmse_m_s:.2f}" if np.isfinite(candidate.cv_rmse_m_s) else "–",
                str(candidate.cv_cells),
                f"{candidate.weight:.2f}",
            ]
        )
    listed = "; ".join(f"{name} with {values}" for name, values in implausible.items() if name in shown)
    note = f"\n{filled(f'* only with implausible values, so not named: {listed}')}" if listed else ""
    return f"{table(rows, left=(0, 1))}{_more(len(discovery.candidates) - most)}\n{filled(WEIGHT)}{note}"


def stages(discovery: Discovery) -> str:
    """Where in the chain the base model fails."""
    rows = [["stage", "connects", "cells", "χ²", "p", "missed"]]
    for test in discovery.stages:
        rows.append(
            [test.stage, test.connects, str(test.cells), f"{test.chi2:.0f}", f"{test.p:.2g}", str(len(test.missed))]
        )
    return table(rows, left=(0, 1))


def next_trials(discovery: Discovery) -> str:
    """What to measure next."""
    rows = [["at", "look at", "separates", "gap\n[sd]", "times"]]
    for trial in discovery.next_trials:
        rows.append(
            [
                trial.where,
                trial.observable,
                " |\n".join(trial.separates),
                f"{trial.expected_gap_sd:.1f}" if np.isfinite(trial.expected_gap_sd) else "-",
                str(trial.replicates),
            ]
        )
    return table(rows, left=(0, 1, 2))
