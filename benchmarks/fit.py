"""Cold fits of 7 k's and one Δt to 147 speeds: who reaches the global optimum, and how long it takes.

Peers get the same model (walking.Walker) as a function of (Δt, k_1 … k_7) and a random start in the range of Li09; ours
starts from nothing. Both are timed in this run, one thread each.
"""

import time
import warnings
from collections.abc import Callable

import lmfit
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeWarning, curve_fit

from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting.fit import fit
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_model.physics.walking import Inputs, Walker
from sandbot_record.trials.table import Row, from_rows

Floats = NDArray[np.float64]
PHI = np.linspace(0.58, 0.633, 7)
OMEGA = np.array([4.0, 8.0, 12.0, 16.0, 20.0, 24.0, 30.0])
K = np.interp(PHI, [0.58, 0.6, 0.633], [170.0, 205.0, 220.0])
NOISE_M_S = 0.005
FITS = 40
WITHIN = 1.01


def speeds(delta_t: float, k: Floats) -> Floats:
    """Mean speeds of 147 trials [m/s]."""
    found = Walker().predict(Inputs(k[:, None, None], OMEGA[:, None], delta_t)).speed_m_s
    return np.broadcast_to(found, (7, 7, 3)).ravel()


def ours(measured: Floats, _rng: np.random.Generator) -> tuple[float, Floats]:
    """Profile, descents, look around: the project's own fit, from the trials on."""
    grid = [axis.ravel() for axis in np.meshgrid(PHI, OMEGA, np.arange(3), indexing="ij")]
    rows = [
        Row(trial_id=str(i), phi=float(p), omega_rad_s=float(w), gait="UNIFORM", replicate=float(r), speed_m_s=float(v))
        for i, (p, w, r, v) in enumerate(zip(*grid, measured, strict=True))
    ]
    found = fit(model_of("simple", (), catalogue()), cells_of(from_rows(rows)))
    return found.parameters["delta_t_s"].value, found.k_n_per_m


def with_curve_fit(measured: Floats, rng: np.random.Generator) -> tuple[float, Floats]:
    """scipy.optimize.curve_fit."""
    start = [rng.uniform(0.2, 0.8), *rng.uniform(165.0, 230.0, 7)]
    found, _ = curve_fit(lambda _x, *p: speeds(p[0], np.array(p[1:])), None, measured, start, maxfev=4000)
    return float(found[0]), found[1:]


def with_lmfit(measured: Floats, rng: np.random.Generator) -> tuple[float, Floats]:
    """lmfit.minimize, leastsq."""
    parameters = lmfit.Parameters()
    parameters.add("delta_t", rng.uniform(0.2, 0.8), min=0.02, max=3)
    for i in range(7):
        parameters.add(f"k{i}", rng.uniform(165.0, 230.0), min=100, max=600)

    def residual(p: lmfit.Parameters) -> Floats:
        return speeds(p["delta_t"].value, np.array([p[f"k{i}"].value for i in range(7)])) - measured

    found = lmfit.minimize(residual, parameters).params
    return found["delta_t"].value, np.array([found[f"k{i}"].value for i in range(7)])


def polished(measured: Floats, delta_t: float, k: Floats) -> float:
    """Sum of squares at the nearest minimum: what counts is the valley a fit ends in."""
    best = np.inf
    for stretch in (1.0, 0.999, 1.001):
        try:
            found, _ = curve_fit(
                lambda _x, *p: speeds(p[0], np.array(p[1:])), None, measured, [delta_t, *(k * stretch)], maxfev=4000
            )
        except (RuntimeError, ValueError):
            continue
        best = min(best, float(np.sum((speeds(found[0], found[1:]) - measured) ** 2)))
    return best


def main() -> str:
    """The section of the report, in Markdown."""
    warnings.simplefilter("ignore", OptimizeWarning)
    methods: dict[str, Callable[[Floats, np.random.Generator], tuple[float, Floats]]] = {
        "curve_fit": with_curve_fit,
        "lmfit": with_lmfit,
        "ours": ours,
    }
    seconds: dict[str, list[float]] = {name: [] for name in methods}
    squares: dict[str, list[float]] = {name: [] for name in methods}
    least: list[float] = []
    for seed in range(FITS):
        rng = np.random.default_rng(seed)
        measured = speeds(0.4, K) + rng.normal(0.0, NOISE_M_S, 147)
        for name, method in methods.items():
            began = time.perf_counter()
            try:
                found = method(measured, rng)
            except RuntimeError:
                found = (0.4, np.full(7, 100.0))
            seconds[name].append(time.perf_counter() - began)
            squares[name].append(polished(measured, *found))
        least.append(min([polished(measured, 0.4, K), *(squares[name][-1] for name in methods)]))
    lines = ["# Cold fits", "", "| method | ms (median) | within 1 % of the best sum of squares |", "|---|---|---|"]
    for name in methods:
        share = np.mean(np.array(squares[name]) <= WITHIN * np.array(least))
        lines.append(f"| {name} | {1e3 * np.median(seconds[name]):.1f} | {100 * share:.0f} % |")
    return "\n".join(lines)
