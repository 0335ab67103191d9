"""Speed curves of fits over a fine grid of frequencies, and the steps that the page draws."""

from collections.abc import Sequence

import numpy as np

from sandbot_common.arrays import Bools, Floats
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.walking import Prediction
from sandbot_model.report.view import Step, bands

POINTS = 240


def steps(fits: Sequence[Fit]) -> tuple[Step, ...]:
    """Each fit with its curves over slightly more than the measured range of ω."""
    omega = fits[0].cells.omega
    edge = 0.03 * (omega.max() - omega.min()) or 0.1 * float(omega.max())
    grid = np.linspace(max(omega.min() - edge, 0.05), omega.max() + edge, POINTS)
    return tuple(Step(fit, grid, speed_curves(fit, grid)) for fit in fits)


def speed_curves(fit: Fit, omega_rad_s: Floats) -> Floats:
    """Mean speed of each band as ``drawn`` and ``broken`` [m/s], (n_bands, m)."""
    cells, slowest = fit.cells, swim_m_s(fit)
    found = [
        fit.predict(np.full_like(omega_rad_s, band.phi), omega_rad_s, cells.clock[band.cells[0]])
        for band in bands(cells)
    ]
    return np.array([broken(one, slowest) for one in found])


def swim_m_s(fit: Fit) -> float:
    """Lowest speed drawn for swimming: the fitted swimming speed, or 0 where an effect models swimming."""
    estimate = fit.parameters.get("v_swim_m_s")
    return 0.0 if estimate is None else estimate.value


def drawn(found: Prediction, slowest_m_s: float) -> tuple[Floats, Bools]:
    """Mean speed along curves as drawn [m/s], of the prediction's shape, and whether it is that of walking: where
    walking would be slower than swimming, swimming is drawn."""
    speed = np.where(found.walking, np.maximum(found.speed_m_s, slowest_m_s), found.speed_m_s)
    return speed, np.asarray(found.walking) & (found.speed_m_s > slowest_m_s)


def broken(found: Prediction, slowest_m_s: float) -> Floats:
    """The curve as ``drawn`` [m/s], with a gap (NaN) where it jumps between walking and swimming.

    Where walking slows down to swimming first there is no jump.
    """
    speed, walks = drawn(found, slowest_m_s)
    jumps = (walks[1:] != walks[:-1]) & (found.walking[1:] != found.walking[:-1])
    return np.where(np.append(False, jumps), np.nan, speed)
