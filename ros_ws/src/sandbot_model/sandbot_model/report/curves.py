"""Speed curves of fits over a fine grid of frequencies, and the steps that the page draws."""

from collections.abc import Callable, Sequence

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.fitting.fit import Fit
from sandbot_model.report.view import Step, bands

Curve = Callable[[Fit, Floats], Floats]
"""(fit, ω (m,)) → mean speed (n_bands, m) [m/s]."""

POINTS = 240


def steps(fits: Sequence[Fit], curve: Curve | None = None) -> tuple[Step, ...]:
    """Each fit with its curves over slightly more than the measured range of ω."""
    omega = fits[0].cells.omega
    edge = 0.03 * (omega.max() - omega.min()) or 0.1 * float(omega.max())
    grid = np.linspace(max(omega.min() - edge, 0.05), omega.max() + edge, POINTS)
    draw = curve or speed_curves
    return tuple(Step(fit, grid, draw(fit, grid)) for fit in fits)


def speed_curves(fit: Fit, omega_rad_s: Floats) -> Floats:
    """Mean speed of each band [m/s], (n_bands, m)."""
    cells = fit.cells
    rows = [
        fit.predict(np.full_like(omega_rad_s, band.phi), omega_rad_s, cells.clock[band.cells[0]]).speed_m_s
        for band in bands(cells)
    ]
    return np.array(rows)
