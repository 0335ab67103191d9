"""A model's prediction of a trial: depth from the force balance, and from it the four observables.

The leg sinks to the least depth at which the ground gives the force needed:

    d = min { d in [0, 2R - h] : F(d) ≥ m (g + a(d)) },      no such depth: the robot swims

Strength, force and load are all functions of d (see ``chain``), so a self-consistent strength such as disturbed
ground's k_eff(s(d)) needs no iteration: the first crossing below the surface is the fixed point with the longest step.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from sandbot_common.arrays import Bools, Floats, Ints
from sandbot_common.robot import SANDBOT, Robot
from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.gait import EVEN, Clock
from sandbot_model.physics.geometry import deepest_m, depth_at
from sandbot_model.physics.observables import NAMES
from sandbot_model.physics.stages import through

BASES: dict[str, tuple[str, ...]] = {
    "simple": (),
    "full": ("exact_vertical_acceleration", "exact_leg_arc"),
    "li09": ("disturbed_ground", "belly_coast", "slow_phase_speed"),
}
"""The base models, as effects that are always on: "full" (physics §3) adds two to the simple model, "li09" those that
Li et al. 2009 found. A search adds further effects."""

V_SWIM_M_S = 0.02
"""Swimming speed of Li09, the same for every φ at ω ≥ 28 rad/s."""

DEPTHS = 40
"""Depths at which the margin is evaluated, 2 mm apart at the surface, 0.7 mm where legs stand. Ground that holds over a
shorter range (where disturbance soon weakens it) is found by extrapolating its rise; see ``_on_a_rise``."""
POLISH = 3
"""Illinois steps that refine a crossing."""
RISES = 3
"""Secant steps that extrapolate a rise to where the margin would reach 0."""
HELD_N = 1e-4
"""Tolerance [N] for the margin to count as 0 there."""
JUMP_M = 1e-9
BEYOND_A_JUMP_M = np.linspace(0.0, 2.4e-3, 13)
"""Additional depths right below a jump, where the load is least and disturbed ground may hold over a short range."""

Params = Sequence[Mapping[str, ArrayLike]]
"""Values of the parameters, one mapping per effect."""


@dataclass(frozen=True)
class Prediction:
    """A model's predictions; all arrays of one shape. Step and depth are NaN where the robot swims."""

    speed_m_s: Floats
    lift_m: Floats
    peak_speed_m_s: Floats
    first_step_m: Floats
    depth_m: Floats
    step_m: Floats
    walking: Bools

    @property
    def observables(self) -> Floats:
        """Shape ``(..., 4)`` in the order of ``Observable``."""
        return np.stack([self.speed_m_s, self.lift_m, self.peak_speed_m_s, self.first_step_m], axis=-1)


@dataclass(frozen=True)
class Inputs:
    """Inputs of a prediction, SI units, broadcastable against each other and against the parameters."""

    k_n_per_m: ArrayLike
    omega_rad_s: ArrayLike
    delta_t_s: ArrayLike
    phi: ArrayLike = np.nan
    v_swim_m_s: ArrayLike = V_SWIM_M_S
    clock: Clock = EVEN
    k_of_phi: Callable[[Floats], Floats] | None = None
    """The stiffness at another volume fraction, for effects that ask for it; by default the same everywhere."""


@dataclass(frozen=True, eq=False)
class KCurve:
    """Stiffness [N/m] at any volume fraction, linear between levels and constant beyond them.

    ``k_n_per_m`` is one curve ``(levels,)``, or one per row ``(*rows, levels)``, called with φ of shape ``(*rows,
    *inner)`` that has ``inner`` further axes.
    """

    phi: Floats
    k_n_per_m: Floats
    inner: int = 0

    def __call__(self, phi: Floats) -> Floats:
        """k at these volume fractions."""
        rows = self.k_n_per_m.shape[:-1]
        if not rows:
            return np.asarray(np.interp(phi, self.phi, self.k_n_per_m))
        wanted = np.broadcast_to(phi, np.broadcast_shapes(np.shape(phi), rows + (1,) * self.inner))
        flat = wanted.reshape(-1, *wanted.shape[len(rows) :])
        curves = self.k_n_per_m.reshape(-1, len(self.phi))
        found = [np.interp(w, self.phi, k) for w, k in zip(flat, curves, strict=True)]
        return np.stack(found).reshape(wanted.shape)


USUAL_K = KCurve(np.array([0.58, 0.6, 0.633]), np.array([170.0, 205.0, 220.0]))
"""The ground of Li09, for what is predicted before any fit."""


@dataclass(frozen=True)
class Footing:
    """Where the ground holds the legs: depths [m] (2R - h where it never does), steady and on virgin ground."""

    depth: Floats
    walking: Bools
    virgin_depth: Floats
    virgin_walking: Bools


@dataclass(frozen=True)
class Walker:
    """A robot with a set of effects."""

    effects: tuple[Effect, ...] = ()
    robot: Robot = SANDBOT

    @cached_property
    def remembers(self) -> bool:
        """Whether the first step, on virgin ground, differs from the others."""
        return any(effect.first_step_differs for effect in self.effects)

    def predict(self, inputs: Inputs, params: Params = ()) -> Prediction:
        """The four observables, of the broadcast shape of inputs and parameters."""
        return self.observe(inputs, params, self.footing(inputs, params))

    def footing(self, inputs: Inputs, params: Params = ()) -> Footing:
        """Solve the force balance. Arrays have the broadcast shape of the inputs that it depends on."""
        depth, walking = self._first_crossing(inputs, params, first_step=False)
        if not self.remembers:
            return Footing(depth, walking, depth, walking)
        return Footing(depth, walking, *self._first_crossing(inputs, params, first_step=True))

    def observe(self, inputs: Inputs, params: Params, footing: Footing) -> Prediction:
        """The observables at a given footing."""
        steady = self.chain(inputs, params, footing.depth[..., None], first_step=False)
        virgin = steady
        if self.remembers:
            virgin = self.chain(inputs, params, footing.virgin_depth[..., None], first_step=True)
        walking = footing.walking
        seen = observables(steady, virgin, walking[..., None], footing.virgin_walking[..., None])
        columns = np.broadcast_arrays(
            *(_flat(seen[name]) for name in NAMES),
            np.where(walking, footing.depth, np.nan),
            np.where(walking, _flat(steady.step), np.nan),
            walking,
        )
        return Prediction(*columns)

    def chain(self, inputs: Inputs, params: Params, depth: Floats, *, first_step: bool, one_leg: bool = False) -> Chain:
        """The chain at depths ``(..., depths)``; all other quantities get a new last axis for the depth."""
        k = _column(inputs.k_n_per_m)
        chain = Chain(
            robot=self.robot,
            depth=depth,
            k=k,
            omega=_column(inputs.omega_rad_s),
            phi=_column(inputs.phi),
            delta_t=_column(inputs.delta_t_s),
            v_swim=_column(inputs.v_swim_m_s),
            slow_phase_ratio=_column(inputs.clock.slow_ratio),
            swing_ratio=_column(inputs.clock.swing_ratio),
            slow_begin=self.slow_begin_m(inputs.clock)[..., None],
            slow_end=self.slow_end_m(inputs.clock)[..., None],
            first_step=first_step,
            k_of_phi=inputs.k_of_phi or (lambda _phi: k),
            one_leg=one_leg,
        )
        values = [{name: _column(value) for name, value in p.items()} for p in params]
        return through(chain, list(zip(self.effects, values, strict=True)))

    def margin(self, inputs: Inputs, params: Params, depth: Floats, *, first_step: bool) -> Floats:
        """Force of the ground minus load [N] at depths of the inputs' shape."""
        return _flat(self.chain(inputs, params, depth[..., None], first_step=first_step).margin)

    def sigma_phi(self, inputs: Inputs, params: Params) -> Floats:
        """Standard deviation of φ along the track, as set by effects [1]."""
        return _flat(self.chain(inputs, params, np.array([0.01]), first_step=False).sigma_phi)

    def _first_crossing(self, inputs: Inputs, params: Params, *, first_step: bool) -> tuple[Floats, Bools]:
        grid = self.depths(inputs.clock)
        margin = self.chain(inputs, params, grid, first_step=first_step).margin
        holds = margin >= 0
        walking = holds.any(axis=-1)
        peak = _highest_peak(margin, holds)
        upper = np.maximum(holds.argmax(axis=-1), 1)
        low, high = grid[upper - 1], grid[upper]
        margin_low = np.take_along_axis(margin, (upper - 1)[..., None], axis=-1)[..., 0]
        margin_high = np.take_along_axis(margin, upper[..., None], axis=-1)[..., 0]
        for _ in range(POLISH):
            depth = _secant(low, high, margin_low, margin_high)
            here = self.margin(inputs, params, depth, first_step=first_step)
            above = here >= 0
            # Illinois rule: halve the margin of the retained end, so that it is not retained for ever.
            margin_low, margin_high = (
                np.where(above, margin_low * 0.5, here),
                np.where(above, here, margin_high * 0.5),
            )
            low, high = np.where(above, low, depth), np.where(above, depth, high)
        depth = _secant(low, high, margin_low, margin_high)
        if peak.any():
            held, rise = self._on_a_rise(inputs, params, grid, margin, peak, first_step=first_step)
            depth, walking = np.where(held, rise, depth), walking | held
        return np.where(walking, depth, deepest_m(self.robot)), np.asarray(walking)

    def _on_a_rise(
        self, inputs: Inputs, params: Params, grid: Floats, margin: Floats, peak: Ints, *, first_step: bool
    ) -> tuple[Bools, Floats]:
        """Whether the margin reaches 0 between two grid depths as it rises to a peak, and at which depth.

        The rise before the peak is extrapolated to 0; the margin at that depth shows whether it still rises there.
        """
        before = np.maximum(peak - 1, 1)
        low, far = grid[before - 1], grid[np.minimum(peak + 1, len(grid) - 1)]
        margin_low = np.take_along_axis(margin, (before - 1)[..., None], axis=-1)[..., 0]
        depth, here = grid[before], np.take_along_axis(margin, before[..., None], axis=-1)[..., 0]
        for _ in range(RISES):
            beyond = _extrapolated(low, depth, margin_low, here)
            goes_on = (np.abs(here) >= HELD_N) & (beyond <= far)
            low, margin_low = np.where(goes_on, depth, low), np.where(goes_on, here, margin_low)
            depth = np.where(goes_on, beyond, depth)
            here = self.margin(inputs, params, depth, first_step=first_step)
        return (peak > 0) & (np.abs(here) < HELD_N), depth

    def depths(self, clock: Clock) -> Floats:
        """Depths at which the margin is evaluated, including both sides of its jumps."""
        grid = depth_grid(self.robot)
        if not any(effect.clocked for effect in self.effects):
            return grid
        jumps = np.unique(self.slow_begin_m(clock)[~clock.one_rate])
        beyond = np.minimum(jumps[:, None] + BEYOND_A_JUMP_M, grid[-1])
        return np.unique(np.concatenate([grid, jumps - JUMP_M, beyond.ravel()]))

    def slow_begin_m(self, clock: Clock) -> Floats:
        """Depth at which the slow phase begins [m]; 2R - h where that is not on the way down."""
        angle = np.asarray(clock.slow_begin_rad) + self.robot.leg_mount_rad
        return self._depth_at(np.minimum(angle, 0.0))

    def slow_end_m(self, clock: Clock) -> Floats:
        """Depth at which it ends [m]; 2R - h where that is not on the way up."""
        return self._depth_at(np.maximum(np.asarray(clock.slow_end_rad) + self.robot.leg_mount_rad, 0.0))

    def _depth_at(self, angle_rad: Floats) -> Floats:
        return np.clip(depth_at(self.robot, angle_rad), 0.0, deepest_m(self.robot))


def observables(steady: Chain, virgin: Chain, walking: Bools, virgin_walking: Bools) -> dict[str, Floats]:
    """The observables by name [SI], from the chains of the steady gait and of the first step on virgin ground.

    Each has the shape that the chains' quantities and ``walking`` broadcast to.
    """
    return {
        "speed": np.where(walking, steady.speed, steady.v_swim),
        "lift": np.where(walking, deepest_m(steady.robot) - steady.depth, 0.0),
        "peak_speed": np.where(walking, steady.peak_speed, steady.v_swim),
        "first_step": np.where(virgin_walking, virgin.advance, virgin.swum),
    }


def depth_grid(robot: Robot, count: int = DEPTHS) -> Floats:
    """Depths ``(count,)`` [m] from the surface to 2R - h, closer together where the step shrinks fast."""
    u = np.linspace(0.0, 1.0, count)
    return deepest_m(robot) * u * (2 - u)


def _highest_peak(margin: Floats, holds: Bools) -> Ints:
    """Index of the highest local maximum (below 0) before the ground first holds, 0 where there is none."""
    inner = margin[..., 1:-1]
    peak = (inner > margin[..., :-2]) & (inner >= margin[..., 2:])
    peak &= ~np.logical_or.accumulate(holds, axis=-1)[..., 1:-1]
    best = np.where(peak, inner, -np.inf).argmax(axis=-1)
    return np.where(peak.any(axis=-1), best + 1, 0)


def _extrapolated(low: Floats, high: Floats, margin_low: Floats, margin_high: Floats) -> Floats:
    """Depth at which a line through two margins reaches 0; infinite if it does not rise."""
    rise = margin_high - margin_low
    share = np.divide(-margin_low, rise, out=np.full_like(rise, np.inf), where=rise > 0)
    return np.where(rise > 0, low + share * np.maximum(high - low, JUMP_M), np.inf)


def _secant(low: Floats, high: Floats, margin_low: Floats, margin_high: Floats) -> Floats:
    rise = margin_high - margin_low
    share = np.divide(-margin_low, rise, out=np.full_like(rise, 0.5), where=rise > 0)
    return low + np.clip(share, 0.0, 1.0) * (high - low)


def _column(value: ArrayLike) -> Floats:
    column = np.asarray(value, dtype=np.float64)[..., None]
    column.flags.writeable = False  # it may be an array of the trials
    return column


def _flat(value: Floats) -> Floats:
    return value[..., 0] if value.ndim else value
