"""Where an effect would show: the residuals of the base model fitted to trials in which the effect is present.

The trials are simulated with the usual k(φ) and Δt and scatter as the usual cameras' do. The base model's
k(φ), Δt and swimming speed are fitted to them, so what these absorb does not show (physics §7).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import hadamard

from sandbot_common.accuracy import Accuracy
from sandbot_common.arrays import Floats
from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting.fit import fit
from sandbot_model.physics.averaging import predicted
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.gait import clock
from sandbot_model.physics.model import model_of
from sandbot_model.physics.observables import Observable, usual_noise
from sandbot_model.physics.walking import USUAL_K, Inputs
from sandbot_record.trials.table import Row, from_rows

PHI = (0.58, 0.59, 0.6, 0.615, 0.633)
OMEGA_RAD_S = (4.0, 8.0, 12.0, 16.0, 20.0, 24.0, 28.0)
TRIALS = 3
"""Trials in each condition."""
SEEN = 3.0
"""An effect shows in a condition if it moves the mean by at least this many standard errors."""
_SIGNS = hadamard(8)[:, 1:5]
"""Deviations of eight replicates, orthogonal so that no two observables are correlated."""


@dataclass(frozen=True)
class Fingerprint:
    """``missed (φ, ω, 4)``: measured minus fitted, in standard errors of the mean of ``TRIALS`` trials."""

    missed: Floats

    def largest(self, observable: Observable) -> tuple[float, float, float]:
        """(standard errors, φ, ω [rad/s]) where the effect is largest in one observable."""
        row, column = np.unravel_index(np.abs(self.missed[..., observable]).argmax(), self.missed.shape[:2])
        return float(self.missed[row, column, observable]), PHI[row], OMEGA_RAD_S[column]


def fingerprint(effect: Effect, catalogue: Mapping[str, Effect]) -> Fingerprint:
    """The fingerprint of an effect of the catalogue at its usual strength (the start values of its parameters)."""
    phi, omega = (axis.ravel() for axis in np.meshgrid(PHI, OMEGA_RAD_S, indexing="ij"))
    values = {parameter.name: parameter.start for parameter in effect.parameters}
    gait = "SGCS" if effect.clocked else "UNIFORM"
    clocks = clock([gait] * len(phi))
    model = model_of("simple", (effect.identifier,), catalogue)
    delta_t_s, v_swim_m_s = (model.parameter(name).start for name in ("delta_t_s", "v_swim_m_s"))
    inputs = Inputs(USUAL_K(phi), omega, delta_t_s, phi, v_swim_m_s, clocks, USUAL_K)
    measured = predicted(model.walker, inputs, [values], USUAL_K).observables
    sd = usual_noise(Accuracy())
    scatter = _SIGNS * sd * np.sqrt(1 - 1 / len(_SIGNS))
    rows = [
        Row(f"{cell}r{replicate}", phi[cell], 0.0, omega[cell], gait, replicate + 1, mean[0] + extra[0], 0.0,
            mean[1] + extra[1], mean[2] + extra[2], mean[3] + extra[3])
        for cell, mean in enumerate(measured.tolist()) for replicate, extra in enumerate(scatter.tolist())
    ]  # fmt: skip
    fitted = fit(model_of("simple", (), catalogue), cells_of(from_rows(rows)))
    # Near the switch to swimming, the fit cannot say whether the robot walks.
    clear = fitted.problem.away_from_switch(fitted.problem.widening(fitted.state.covariance[0]))
    residual = np.nan_to_num((fitted.cells.mean - fitted.predicted) / sd) * np.sqrt(TRIALS)
    missed = np.where(clear[:, None], residual, 0.0)
    missed = missed[np.lexsort((fitted.cells.omega, fitted.cells.phi))]
    return Fingerprint(missed.reshape(len(PHI), len(OMEGA_RAD_S), len(Observable)))
