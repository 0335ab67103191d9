"""What an expert would reach for in place of ``discover``: lmfit + AIC, sparse regression, a Gaussian process.

Each is a function ``trials -> Choice``: what it names, and how to fit what it chose to other trials and predict mean
speed. All get the same trials table and the project's own model as a function; none gets the truth.
"""

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import lmfit
import numpy as np
import pysindy
from numpy.typing import NDArray
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Kernel, Matern, WhiteKernel

from sandbot_common.accuracy import USUAL
from sandbot_common.arrays import Floats
from sandbot_common.robot import SANDBOT
from sandbot_model.data.clustering import phi_levels
from sandbot_model.data.conditions import cells_of
from sandbot_model.data.regime import peaks_seen, swam_from_start
from sandbot_model.fitting.fit import Fit, fit
from sandbot_model.fitting.global_minimum import WarmStart
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.gait import USUAL_FRAME_RATE_HZ, clock
from sandbot_model.physics.model import Model, model_of
from sandbot_model.physics.observables import COLUMNS, Observable, usual_noise
from sandbot_model.physics.walking import KCurve
from sandbot_record.trials.table import Trials

Predict = Callable[[Floats, Floats], Floats]
"""Mean speed [m/s] at φ and ω [rad/s]."""
Named = tuple[frozenset[str], ...]

CATALOGUE = catalogue()
CLEARLY = 10.0
"""ΔAIC from which a model with an effect is said to beat one without (Burnham & Anderson 2002: no support left)."""
AS_WELL = 2.0
"""ΔAIC within which another model has as much support."""


@dataclass(frozen=True)
class Choice:
    """What a method makes of some trials: sets of effects it names, the best first; empty where it names nothing."""

    named: Named
    refit: Callable[[Trials], Predict]


# --- lmfit: the catalogue as candidate models, trial by trial -----------------------------------------------------

DELTA_T = np.geomspace(0.08, 1.2, 8)
K_GRID = np.geomspace(150.0, 450.0, 28)
STARTS = 2
USUAL_NOISE = usual_noise(USUAL)
FOR_PAIRS = 8


@dataclass(frozen=True, eq=False)
class Table:
    """Trials as lmfit's user would hold them: values ``(n, 4)``, and the distinct conditions ``(m,)`` behind them."""

    values: Floats
    condition: NDArray[np.int64]
    level: NDArray[np.int64]
    omega: Floats
    level_phi: Floats
    gait: str

    def predicted(self, model: Model, theta: Floats, k: Floats) -> Floats:
        """The observables of every condition ``(..., m, 4)`` at θ ``(..., parameters)`` and k ``(..., m)``."""
        curve = KCurve(self.level_phi, k[self._first] if k.ndim == 1 else np.linspace(170, 220, len(self.level_phi)))
        phi = self.level_phi[self.level]
        inputs, params = model.inputs(theta, k, self.omega, phi, clock([self.gait])[0], curve)
        return np.broadcast_to(
            model.walker.predict(inputs, params).observables,
            (*np.broadcast_shapes(k.shape, theta.shape[:-1], phi.shape), 4),
        )

    @property
    def _first(self) -> NDArray[np.int64]:
        return np.unique(self.level, return_index=True)[1]


def table_of(trials: Trials) -> Table:
    """All trials of one gait; what is left out for everybody is left out here."""
    values = np.stack([np.asarray(getattr(trials, name), dtype=float) for name in COLUMNS], axis=-1)
    omega, gait = np.asarray(trials.omega_rad_s, dtype=float), str(trials.gait[0])
    seen = peaks_seen([gait] * len(omega), omega, values, SANDBOT, USUAL, USUAL_FRAME_RATE_HZ)
    values[~seen, Observable.peak_speed] = np.nan
    values[swam_from_start([gait] * len(omega), omega, values), Observable.first_step] = np.nan
    phi = np.asarray(trials.phi, dtype=float)
    level = phi_levels(phi)
    keys, condition = np.unique(np.stack([level, omega]), axis=1, return_inverse=True)
    level_phi = np.array([phi[level == one].mean() for one in range(int(level.max()) + 1)])
    return Table(values, condition, keys[0].astype(np.int64), keys[1], level_phi, gait)


@dataclass(frozen=True, eq=False)
class LmfitFit:
    """One candidate model at its optimum."""

    model: Model
    theta: Floats
    k: Floats
    aic: float

    def predict(self, table: Table) -> Predict:
        """Mean speed elsewhere; k is interpolated between the φ levels."""
        curve = KCurve(table.level_phi, self.k)

        def speed(phi: Floats, omega: Floats) -> Floats:
            inputs, params = self.model.inputs(self.theta, curve(phi), omega, phi, clock([table.gait])[0], curve)
            return np.asarray(self.model.walker.predict(inputs, params).speed_m_s)

        return speed


def lmfit_aic(observables: Sequence[int]) -> Callable[[Trials], Choice]:
    """Base model, every effect, then every pair with the best effect; the least AIC wins if it wins clearly.

    ``observables`` are the columns of ``Observable`` that are fitted, each scaled by its usual noise.
    """
    used = list(observables)

    def choose(trials: Trials) -> Choice:
        table = table_of(trials)
        base = best_lmfit(table, used, ())
        singles = [best_lmfit(table, used, (name,)) for name in CATALOGUE]
        best, same_size = base, singles
        if better := _clear_winner(base, singles):
            best = better
            (name,) = best.model.identifiers
            others = [one.model.identifiers[0] for one in sorted(singles, key=lambda one: one.aic)[: FOR_PAIRS + 1]]
            pairs = [best_lmfit(table, used, (name, other), best) for other in others if other != name]
            if better := _clear_winner(best, pairs):
                best, same_size = better, pairs
        named = () if best is base else _as_good(best, same_size)
        model = best.model

        def refit(others: Trials) -> Predict:
            new = table_of(others)
            return _descend(new, used, model, best.theta, best.k).predict(new)

        return Choice(named, refit)

    return choose


def _clear_winner(standing: LmfitFit, rivals: Iterable[LmfitFit]) -> LmfitFit | None:
    best = min(rivals, key=lambda one: one.aic)
    return best if standing.aic - best.aic > CLEARLY else None


def _as_good(best: LmfitFit, rivals: Iterable[LmfitFit]) -> Named:
    close = sorted((one for one in rivals if one.aic - best.aic <= AS_WELL), key=lambda one: one.aic)
    return tuple(frozenset(one.model.identifiers) for one in close)


def best_lmfit(table: Table, used: list[int], effects: tuple[str, ...], near: LmfitFit | None = None) -> LmfitFit:
    """The best of several descents: from the best of a grid of starts, and from ``near``, a smaller model's optimum."""
    model = model_of("simple", effects, CATALOGUE)
    starts = _starts(table, used, model)
    if near is not None:
        values = dict(zip(near.model.names, near.theta, strict=True))
        theta = [values.get(name, one.start) for name, one in zip(model.names, model.parameters, strict=True)]
        starts = [(np.array(theta), near.k), starts[0]]
    return min((_descend(table, used, model, *start) for start in starts), key=lambda one: one.aic)


def _starts(table: Table, used: list[int], model: Model) -> list[tuple[Floats, Floats]]:
    """For Δt on a grid and effects weak, middling and strong: k of each level from a grid of its own; the best few."""
    rows = []
    for share in (0.15, 0.5, 0.85):
        for delta_t in DELTA_T:
            rows.append([one.low + share * (one.high - one.low) for one in model.parameters])
            rows[-1][model.names.index("delta_t_s")] = delta_t
            if "v_swim_m_s" in model.names:
                rows[-1][model.names.index("v_swim_m_s")] = 0.02
        if not any("." in name for name in model.names):
            break
    theta = np.array(rows)
    seen = table.predicted(model, theta[:, None, :], K_GRID[:, None, None])[..., used]
    mean, count = _means(table, used)
    misfit = (count * np.square((seen - mean) / USUAL_NOISE[used])).sum(axis=-1)
    by_level = np.stack([misfit[..., table.level == one].sum(axis=-1) for one in range(len(table.level_phi))], axis=-1)
    k = K_GRID[by_level.argmin(axis=0)]
    order = by_level.min(axis=0).sum(axis=-1).argsort()[:STARTS]
    return [(theta[row], k[row]) for row in order]


def _means(table: Table, used: list[int]) -> tuple[Floats, Floats]:
    """Mean of each condition ``(m, used)``, 0 where nothing was measured, and how many values it has."""
    values = table.values[:, used]
    known = np.isfinite(values)
    sums, count = (np.zeros((len(table.omega), len(used))) for _ in range(2))
    np.add.at(sums, table.condition, np.where(known, values, 0.0))
    np.add.at(count, table.condition, known)
    return np.divide(sums, count, out=np.zeros_like(sums), where=count > 0), count


def _descend(table: Table, used: list[int], model: Model, theta: Floats, k: Floats) -> LmfitFit:
    """lmfit's least_squares from one start."""
    wanted, scale = table.values[:, used], USUAL_NOISE[used]
    known = np.isfinite(wanted)
    parameters = lmfit.Parameters()
    names = [name.replace(".", "__") for name in model.names]
    for name, one, value in zip(names, model.parameters, theta, strict=True):
        low, high = one.search
        inside = 1e-3 * (high - low)
        parameters.add(name, float(np.clip(value, low + inside, high - inside)), min=low, max=high)
    stiffness = [f"k{i}" for i in range(len(k))]
    for name, value in zip(stiffness, k, strict=True):
        parameters.add(name, float(value), min=100.0, max=800.0)

    def values(found: lmfit.Parameters) -> tuple[Floats, Floats]:
        all_of = found.valuesdict()
        return np.array([all_of[name] for name in names]), np.array([all_of[name] for name in stiffness])

    def residual(tried: lmfit.Parameters) -> Floats:
        at, ks = values(tried)
        seen = table.predicted(model, at, ks[table.level])[table.condition][:, used]
        return np.asarray(((seen - wanted) / scale)[known])

    found = lmfit.minimize(residual, parameters, method="least_squares", x_scale="jac", max_nfev=60, calc_covar=False)
    return LmfitFit(model, *values(found.params), float(found.aic))


# --- The base model and what is left of it ------------------------------------------------------------------------


def speed_only(trials: Trials) -> Trials:
    """The trials as if nothing but mean speed had been measured."""
    return replace(trials, **{name: np.full(len(trials.phi), np.nan) for name in COLUMNS[1:]})


def base_fit(trials: Trials, near: WarmStart | None = None) -> Fit:
    """The simple model, fitted to mean speed to its global optimum."""
    return fit(model_of("simple", (), CATALOGUE), cells_of(speed_only(trials)), near)


def base_alone(trials: Trials) -> Choice:
    """The simple model: names nothing."""
    near = base_fit(trials).warm_start
    return Choice((), lambda others: speed_of(base_fit(others, near)))


def speed_of(found: Fit) -> Predict:
    """Mean speed a fit of the project predicts."""
    return lambda phi, omega: found.predict(phi, omega).speed_m_s


def _measured(trials: Trials) -> tuple[Floats, Floats, Floats]:
    phi, omega, speed = (np.asarray(one, dtype=float) for one in (trials.phi, trials.omega_rad_s, trials.speed_m_s))
    known = np.isfinite(speed)
    return phi[known], omega[known], speed[known]


# --- PySINDy: sparse regression on a library ----------------------------------------------------------------------

Library = Callable[[Fit, Floats, Floats], Mapping[str, Floats]]
SPARSITIES, MOST_TERMS = 8, 8
PHI_0, PHI_SCALE, OMEGA_0, OMEGA_SCALE = 0.6065, 0.0265, 17.0, 13.0
TERMS = {
    "W v": "stance_overlap",
    "W v Fr": "motor_saturation",
    "W v (d_r/d)^2": "leg_slip",
    "W v [s<0.95R]": "disturbed_ground",
    "W w^3 (d+h-R)^2": "belly_coast",
    "S/w": "swimming_thrust",
    "W T": "cohesion",
    "W T Fr": "inertial_drag",
    "W T Rw (1-s/2R)": "exact_vertical_acceleration",
    "W T Rw (phi-phi_0)": "phi_dependent_response",
}
"""Terms of the physical library that are what an effect does to mean speed, exactly or to first order."""


def polynomial(_base: Fit, phi: Floats, omega: Floats) -> Mapping[str, Floats]:
    """All monomials of φ and ω to the fourth degree, both scaled to ±1."""
    x = np.stack([(phi - PHI_0) / PHI_SCALE, (omega - OMEGA_0) / OMEGA_SCALE], axis=-1)
    library = pysindy.PolynomialLibrary(degree=4)
    columns = np.asarray(library.fit_transform(x))
    return dict(zip(library.get_feature_names(["phi", "w"]), columns.T, strict=True))


def physical(base: Fit, phi: Floats, omega: Floats) -> Mapping[str, Floats]:
    """Dimensionless groups and first-order effects, from the base model's own state.

    W and S are 1 where the base model walks and swims, v, s and d its speed, step and depth, Fr = Rω²/g, and
    T = -∂v/∂F = -(ω/π) 4(d+h-R)/(s k) what a newton of missing support costs.
    """
    robot, at = base.model.robot, base.predict(phi, omega)
    walk = at.walking.astype(float)
    step, depth, speed = (
        np.nan_to_num(at.step_m, nan=robot.leg_radius_m),
        np.nan_to_num(at.depth_m, nan=0.04),
        at.speed_m_s,
    )
    step = np.maximum(step, 0.1 * robot.leg_radius_m)
    leg = robot.leg_radius_m * omega
    froude, below = leg * omega / robot.gravity_m_s2, np.maximum(depth + robot.axle_height_m - robot.leg_radius_m, 0)
    yields = 4 * omega / np.pi * below / step / np.interp(phi, base.level_phi, base.k_n_per_m)
    clock_angle = omega * base.parameters["delta_t_s"].value
    terms = {
        "v": speed,
        "v Fr": speed * froude,
        "v w dt": speed * clock_angle,
        "v s/R": speed * step / robot.leg_radius_m,
        "v d/R": speed * depth / robot.leg_radius_m,
        "v (phi-phi_0)": speed * (phi - PHI_0),
        "v (d_r/d)^2": speed * (robot.stiffness_depth_m / depth) ** 2,
        "v [s<0.95R]": speed * (step < 0.95 * robot.leg_radius_m),
        "w^3 (d+h-R)^2": omega**3 * below**2,
        "T": -yields,
        "T Fr": -yields * froude,
        "T Rw (1-s/2R)": yields * leg * (1 - 0.5 * step / robot.leg_radius_m),
        "T Rw (phi-phi_0)": yields * leg * (phi - PHI_0),
        "1": np.ones_like(speed),
        "Fr": froude,
    }
    swim = 1 - walk
    return {f"W {name}": walk * term for name, term in terms.items()} | {
        "S": swim,
        "S/w": swim / omega,
        "S w": swim * omega,
        "S (phi-phi_0)": swim * (phi - PHI_0),
    }


def sindy(library: Library, on_base: bool) -> Callable[[Trials], Choice]:
    """Sparse regression of mean speed, or of what the base model leaves of it.

    BIC chooses between FROLS, STLSQ and SR3 and how sparse they are (Mangan et al. 2017; AIC keeps too many terms
    here, and STLSQ by itself loses its way among terms that are nearly collinear).
    """

    def choose(trials: Trials) -> Choice:
        base = base_fit(trials)
        coefficients, gain = _sparse(library, on_base, base, trials)
        phi, omega, _ = _measured(trials)
        size = {name: coefficients[name] * np.std(column) for name, column in library(base, phi, omega).items()}
        terms = sorted((name for name in TERMS if size.get(name)), key=lambda name: -abs(size[name]))
        named = _mapped(terms) if gain > CLEARLY else ()

        def refit(others: Trials) -> Predict:
            new = base_fit(others, base.warm_start)
            fitted, _ = _sparse(library, on_base, new, others)

            def speed(phi: Floats, omega: Floats) -> Floats:
                columns = library(new, phi, omega)
                start = speed_of(new)(phi, omega) if on_base else 0.0
                return np.asarray(start + sum(fitted[name] * column for name, column in columns.items()))

            return speed

        return Choice(named, refit)

    return choose


def _mapped(terms: Sequence[str]) -> Named:
    """Effects behind the selected terms: two or fewer as one set, and each by itself, the largest first."""
    singles = [frozenset({TERMS[name]}) for name in terms]
    together = [frozenset(TERMS[name] for name in terms)] if len(terms) == 2 else []
    return tuple(dict.fromkeys([*together, *singles]))


def _sparse(library: Library, on_base: bool, base: Fit, trials: Trials) -> tuple[Mapping[str, float], float]:
    """Coefficient of every term, and by how much BIC is below that of no term (no mean speed but the base's)."""
    phi, omega, speed = _measured(trials)
    columns = library(base, phi, omega)
    x = np.stack(list(columns.values()), axis=-1)
    used = np.linalg.norm(x, axis=0) > 1e-12
    target = speed - speed_of(base)(phi, omega) if on_base else speed
    scale = float(np.linalg.norm(target))
    nothing = _bic(target, 0)
    best, least = np.zeros(x.shape[1]), nothing
    for optimizer in _optimizers(scale):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = np.ravel(optimizer.fit(x[:, used], target[:, None]).coef_)
        score = _bic(target - x[:, used] @ found, int(np.count_nonzero(found)))
        if np.isfinite(score) and score < least:
            least, best = score, np.zeros(x.shape[1])
            best[used] = found
    return dict(zip(columns, best.tolist(), strict=True)), nothing - least


def _optimizers(scale: float) -> Iterable[pysindy.BaseOptimizer]:
    """From sparse to dense; ``scale`` is the norm of what is regressed."""
    for terms in range(1, MOST_TERMS + 1):
        yield pysindy.FROLS(max_iter=terms, alpha=1e-6, normalize_columns=True)
    for threshold in scale * np.geomspace(1.0, 0.01, SPARSITIES):
        yield pysindy.STLSQ(threshold=threshold, alpha=1e-6, normalize_columns=True)
        yield pysindy.SR3(
            reg_weight_lam=threshold**2, regularizer="l0", normalize_columns=True, unbias=True, max_iter=200
        )


def _bic(residual: Floats, terms: int) -> float:
    n = len(residual)
    return float(n * np.log(np.mean(residual**2)) + (terms + 1) * np.log(n))


# --- Kennedy & O'Hagan 2001: base model + Gaussian process --------------------------------------------------------

SHAPES: tuple[Kernel, ...] = (RBF([1.0, 1.0], (0.1, 20.0)), Matern([1.0, 1.0], (0.1, 20.0), nu=1.5))


def gp_discrepancy(trials: Trials) -> Choice:
    """The base model plus an anisotropic Gaussian process of its residual over (φ, ω), RBF or Matérn 3/2 by evidence.

    Names nothing: a discrepancy has no name.
    """
    base = base_fit(trials)
    kernels = [ConstantKernel(1.0, (1e-3, 1e3)) * shape + WhiteKernel(0.1, (1e-4, 10.0)) for shape in SHAPES]
    best = max((_process(base, trials, one, 2) for one in kernels), key=lambda one: one.log_marginal_likelihood_value_)

    def refit(others: Trials) -> Predict:
        new = base_fit(others, base.warm_start)
        process = _process(new, others, best.kernel_, 0)
        return lambda phi, omega: speed_of(new)(phi, omega) + process.predict(_scaled(phi, omega))

    return Choice((), refit)


def _process(base: Fit, trials: Trials, kernel: Kernel, restarts: int) -> GaussianProcessRegressor:
    phi, omega, speed = _measured(trials)
    process = GaussianProcessRegressor(kernel, n_restarts_optimizer=restarts, normalize_y=True, random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return process.fit(_scaled(phi, omega), speed - speed_of(base)(phi, omega))


def _scaled(phi: Floats, omega: Floats) -> Floats:
    return np.stack(np.broadcast_arrays((phi - PHI_0) / PHI_SCALE, (omega - OMEGA_0) / OMEGA_SCALE), axis=-1)
