"""Cold fits of 7 k's and one Δt to 147 speeds: who reaches the global optimum, and how long it takes.

Peers get the same model (walking.Walker) as a function of (Δt, k_1 … k_7) and a random start in the range of Li09; ours
starts from nothing. Both are timed in this run, one thread each, by CPU. Then the same of all four observables: peers
minimise the residuals of our own likelihood, on our compiled chain.

``main`` ends with what was measured once, before and after the chain was compiled (decision 21): it can't be run again.
"""

import time
import warnings
from collections.abc import Callable
from functools import partial

import lmfit
import numpy as np
from scipy.optimize import OptimizeWarning, curve_fit, least_squares

from sandbot_common.accuracy import Accuracy
from sandbot_common.arrays import Floats
from sandbot_model.data.conditions import Cells, cells_of
from sandbot_model.fitting.fit import fit
from sandbot_model.fitting.fitted import state_at
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.fitting.states import States
from sandbot_model.physics.averaging import slope_of
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_model.physics.observables import COLUMNS, usual_noise
from sandbot_model.physics.walking import Inputs, Walker
from sandbot_record.trials.table import Row, from_rows

PHI = np.linspace(0.58, 0.633, 7)
OMEGA = np.array([4.0, 8.0, 12.0, 16.0, 20.0, 24.0, 30.0])
K = np.interp(PHI, [0.58, 0.6, 0.633], [170.0, 205.0, 220.0])
NOISE_M_S = 0.005
FITS = 40
WITHIN = 1.01

BEFORE_AND_AFTER = """
## Before and after the chain was compiled

Measured once, one process after the other on a busy machine, so in seconds of CPU of one thread: the cold fit of the
base model to four observables (median of 5), and `discover` with sets of up to two. Verdicts are the same.

| trials | cold fit: before, after, ratio | discover: before, after, ratio |
|---|---|---|
| demo, 105 trials, 35 cells | 0.413, 0.050, 8.3 | 6.1, 2.2, 2.8 |
| null, 147 trials | 0.501, 0.081, 6.2 | 4.3, 1.25, 3.4 |
| stance_overlap | 0.512, 0.101, 5.1 | 8.6, 3.2, 2.7 |
| disturbed_ground | 0.884, 0.128, 6.9 | 13.0, 4.7, 2.8 |
| disturbed_ground + stance_overlap | 0.750, 0.140, 5.4 | 32.7, 12.3, 2.7 |
| x_resonance (outside the catalogue) | 0.664, 0.132, 5.0 | 37.1, 13.8, 2.7 |

The speeds of 147 trials by this benchmark: 446 ms before, 83 ms after, beside curve_fit with 21 and 24 ms.

Since the first rows are no longer descended from and settled twice, and v_swim is not scanned (b62fe2e, minutes
apart): four observables in 30.0 ms before, beside scipy with 18.4, and 18.6 after, with 17.8; as near to the least."""


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


def four_observables(seed: int) -> Cells:
    """147 trials of the base model, all observables measured with the cameras' usual noise."""
    rng = np.random.default_rng(seed)
    grid = [axis.ravel() for axis in np.meshgrid(PHI, OMEGA, np.arange(3), indexing="ij")]
    seen = Walker().predict(Inputs(np.interp(grid[0], PHI, K), grid[1], 0.4)).observables
    seen = seen + rng.normal(size=seen.shape) * usual_noise(Accuracy())
    rows = [
        Row(trial_id=str(i), phi=p, omega_rad_s=w, gait="UNIFORM", replicate=r, **dict(zip(COLUMNS, v, strict=True)))
        for i, (p, w, r, v) in enumerate(zip(*grid, seen.tolist(), strict=True))
    ]
    return cells_of(from_rows(rows))


def same_objective() -> list[str]:
    """Our likelihood of four observables, minimised by peers from a random start and by us from nothing."""
    seconds: dict[str, list[float]] = {}
    deviance: dict[str, list[float]] = {}
    for seed in range(FITS // 2):
        rng, cells = np.random.default_rng(seed), four_observables(seed)
        problem = Problem(model_of("simple", (), catalogue()), cells)
        start = np.array([rng.uniform(0.2, 0.8), 0.02, *np.log(rng.uniform(165.0, 230.0, 7))])
        slope = slope_of(cells.level_phi, np.exp(start[2:]))
        at = partial(_states, problem, slope)
        methods = {
            "scipy least_squares": lambda: least_squares(lambda x: at(x).all_residuals[0], start).x,  # noqa: B023
            "lmfit leastsq": lambda: _lmfit(at, start),  # noqa: B023
            "ours": lambda: fit(problem.model, cells).point,  # noqa: B023
        }
        for name, method in methods.items():
            began = time.process_time()
            found = method()
            seconds.setdefault(name, []).append(time.process_time() - began)
            state = state_at(problem, found) if name == "ours" else at(found)
            deviance.setdefault(name, []).append(float(state.deviance[0]))
    least = np.min(list(deviance.values()), axis=0)
    reached = {name: np.mean(np.array(values) <= WITHIN * least) for name, values in deviance.items()}
    return [f"| {name} | {1e3 * np.median(seconds[name]):.1f} | {100 * reached[name]:.0f} % |" for name in seconds]


def _states(problem: Problem, slope: Floats, x: Floats) -> States:
    return problem.states(np.maximum(x[None, :2], 1e-3), x[None, 2:], slope)


def _lmfit(at: Callable[[Floats], States], start: Floats) -> Floats:
    parameters = lmfit.Parameters()
    for i, value in enumerate(start):
        parameters.add(f"x{i}", value)
    found = lmfit.minimize(lambda p: at(np.array([one.value for one in p.values()])).all_residuals[0], parameters)
    return np.array([one.value for one in found.params.values()])


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
            began = time.process_time()
            try:
                found = method(measured, rng)
            except RuntimeError:
                found = (0.4, np.full(7, 100.0))
            seconds[name].append(time.process_time() - began)
            squares[name].append(polished(measured, *found))
        least.append(min([polished(measured, 0.4, K), *(squares[name][-1] for name in methods)]))
    head = "| method | ms of CPU (median) | within 1 % of the least deviance |"
    four = ["", "## Four observables, 147 trials, the same objective", "", head, "|---|---|---|", *same_objective()]
    lines = [
        "# Cold fits",
        "",
        "| method | ms of CPU (median) | within 1 % of the best sum of squares |",
        "|---|---|---|",
    ]
    for name in methods:
        share = np.mean(np.array(squares[name]) <= WITHIN * np.array(least))
        lines.append(f"| {name} | {1e3 * np.median(seconds[name]):.1f} | {100 * share:.0f} % |")
    return "\n".join([*lines, *four, BEFORE_AND_AFTER])
