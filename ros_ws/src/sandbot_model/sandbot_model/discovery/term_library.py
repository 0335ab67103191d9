"""What a missing effect may look like: levers on the chain, and terms in the field's dimensionless groups.

A lever is a quantity of one stage, in every step or in the first one only. A term is such a group or a threshold in it.
A lever with a term is a formula for ``--effect``.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.data.clustering import frequencies
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.geometry import chord, deepest_m

BAND_RAD_S = 3.0
"""Half width of a band of leg frequencies, to 1/e."""
SHARES = (0.2, 0.35, 0.5, 0.65, 0.8)
"""Quantiles of the cells' depths and steps that serve as thresholds."""
PHI_0 = 0.6
"""The φ from which deviations are counted: the middle of the range of poppy seeds."""


@dataclass(frozen=True)
class Lever:
    """``{}`` in ``formula`` stands for the term; a lever that is ``first`` acts in the first step only."""

    stage: str
    words: str
    formula: str
    unit: str = "relative"
    first: bool = False

    def assignment(self, term: str) -> str:
        """What a formula effect does to the chain."""
        factor = f"({term})" if " + " in term else term
        if self.first:
            factor = term = f"first*{factor}"
        return self.formula.format(factor if self.formula.endswith("*{}") else term)


@dataclass(frozen=True)
class Term:
    """A dimensionless function of the condition and its values ``(cells,)``; ``{}`` in the words is the coefficient."""

    words: str
    expression: str
    values: Floats
    switches: bool = False
    """Whether it has a threshold, which is chosen from the data as well."""
    needs_depth: bool = False
    """Whether it needs the depth, which is not known at the clock stage."""

    def times(self, coefficient: str) -> str:
        """The term in a formula."""
        return coefficient if self.expression == "1" else f"{coefficient}*{self.expression}"


_ALWAYS = (
    Lever("clock", "the leg frequency", "omega *= 1 + {}"),
    Lever("clock", "the swimming speed", "v_swim *= 1 + {}"),
    Lever("strength", "the stiffness of the ground", "k *= 1 + {}"),
    Lever("balance", "the force the ground gives", "extra_force += m*g*{}", "body weights"),
    Lever("speed", "the speed at every moment of a step", "kept, peak_ratio *= 1 + {}"),
    Lever("speed", "the peak of v_x(t), not its mean,", "peak_ratio *= 1 + {}"),
    Lever("speed", "the advance, but not the peak speed,", "kept *= 1 + {}"),
)
_ALSO_FIRST = ("k *=", "extra_force +=", "kept *=")
LEVERS = (
    *_ALWAYS,
    *(
        Lever(lever.stage, f"in the first step {lever.words}", lever.formula, lever.unit, first=True)
        for lever in _ALWAYS
        if lever.formula.startswith(_ALSO_FIRST)
    ),
)


def terms(fit: Fit) -> list[Term]:
    """The library for these cells, at the depths of this fit."""
    cells, robot = fit.cells, fit.model.robot
    omega, phi = cells.omega, cells.level_phi[cells.level]
    depth = np.nan_to_num(fit.predict(phi, omega, cells.clock).depth_m, nan=deepest_m(robot))
    radius, delta_t = robot.leg_radius_m, fit.parameters["delta_t_s"].value
    froude = radius * omega**2 / robot.gravity_m_s2
    return [
        Term("{} everywhere", "1", np.ones(len(cells))),
        Term("{} Rω²/g", "R*omega**2/g", froude),
        Term("{} ωΔt", "omega*delta_t", omega * delta_t),
        *_of_omega(omega, delta_t),
        Term(f"{{}} (φ - {PHI_0:g})", f"(phi - {PHI_0:g})", phi - PHI_0),
        *_of_phi(phi),
        *_of_depth("d/R", "d/R", depth / radius),
        *_of_depth("s/R", "chord/R", chord(robot, depth) / radius),
    ]


def _of_omega(omega: Floats, delta_t: float) -> Iterator[Term]:
    """Ramps up and down from each measured frequency, bands about each, steps between neighbouring ones."""
    levels = np.unique(frequencies(omega).round(2))
    for w in levels:
        above, below = np.maximum(omega - w, 0.0), np.maximum(w - omega, 0.0)
        at = f"ω = {w:g} rad/s"
        yield Term(f"{{}} (ω - {w:g} rad/s)Δt beyond {at}", f"maximum(omega - {w:g}, 0)*delta_t", above * delta_t, True)
        yield Term(f"{{}} ({w:g} rad/s - ω)Δt below {at}", f"maximum({w:g} - omega, 0)*delta_t", below * delta_t, True)
        band = np.exp(-(((omega - w) / BAND_RAD_S) ** 2))
        yield Term(f"{{}} in a band about {at}", f"exp(-((omega - {w:g})/{BAND_RAD_S:g})**2)", band, True)
    for w in 0.5 * (levels[1:] + levels[:-1]):
        yield Term(f"{{}} above ω = {w:.4g} rad/s", f"where(omega > {w:.4g}, 1, 0)", 1.0 * (omega > w), True)


def _of_phi(phi: Floats) -> Iterator[Term]:
    """Ramps up and down from each level, steps between neighbouring ones."""
    levels = np.unique(phi.round(4))
    for c in levels:
        yield Term(f"{{}} (φ - {c:g}) above φ = {c:g}", f"maximum(phi - {c:g}, 0)", np.maximum(phi - c, 0.0), True)
        yield Term(f"{{}} ({c:g} - φ) below φ = {c:g}", f"maximum({c:g} - phi, 0)", np.maximum(c - phi, 0.0), True)
    for c in 0.5 * (levels[1:] + levels[:-1]):
        yield Term(f"{{}} above φ = {c:.4f}", f"where(phi > {c:.4f}, 1, 0)", 1.0 * (phi > c), True)


def _of_depth(name: str, expression: str, values: Floats) -> Iterator[Term]:
    """Depth or step length in leg radii: linear, and a ramp and a step at each threshold."""
    yield Term(f"{{}} {name}", expression, values, needs_depth=True)
    for c in np.unique(np.quantile(values, SHARES).round(2)):
        rest, jump = np.maximum(values - c, 0.0), 1.0 * (values > c)
        yield Term(
            f"{{}} ({name} - {c:g}) beyond {name} = {c:g}", f"maximum({expression} - {c:g}, 0)", rest, True, True
        )
        yield Term(f"{{}} above {name} = {c:g}", f"where({expression} > {c:g}, 1, 0)", jump, True, True)
