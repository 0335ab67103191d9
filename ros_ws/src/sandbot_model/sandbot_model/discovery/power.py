"""How strong an effect must be for a design to detect it, before a campaign or along with a verdict.

To first order about a fit an effect of strength p moves the cell means, and a penetrometer's readings, by Δy(p); the
part that the fit's own parameters and the nuisances can't absorb gains λ = |P Δy/σ|² in deviance, with a standard
deviation of 2√λ. It is claimed with probability Φ(z) where √λ = √claim + z.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sandbot_common.accuracy import USUAL
from sandbot_common.arrays import Floats
from sandbot_common.robot import SANDBOT
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.criteria import DEFAULT, Criteria
from sandbot_model.discovery.effect_search import EffectSearch
from sandbot_model.discovery.nuisances_about import nuisances_for
from sandbot_model.discovery.verdict import claim_threshold
from sandbot_model.fitting.fit import Fit, fit, fitted_at
from sandbot_model.fitting.jacobian import project_out, tangent_basis
from sandbot_model.fitting.likelihood import Problem
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.effect import Parameter
from sandbot_model.physics.gait import clock
from sandbot_model.physics.model import model_of
from sandbot_model.physics.observables import Observable, usual_noise
from sandbot_model.physics.walking import USUAL_K
from sandbot_record.trials.table import Trials

POWER, Z = 0.9, 1.2816
"""Fraction of campaigns in which an effect is to be detected, and its normal quantile."""
STRENGTHS = 60
"""Values tried between the neutral one and the end of the plausible range."""


@dataclass(frozen=True)
class Detectable:
    """The weakest strength of an effect detected in nine campaigns of ten; None if none in its plausible range is."""

    effect: str
    parameter: str
    unit: str
    value: float | None

    def __str__(self) -> str:
        unit = "" if self.unit == "1" else f" {self.unit}"
        return self.effect if self.value is None else f"{self.effect}.{self.parameter} {self.value:.3g}{unit}"


def detectable(search: EffectSearch, base: Fit) -> list[Detectable]:
    """For every effect that can be added to a fit and vanishes at a neutral value of one parameter."""
    return [
        Detectable(name, strength.name, strength.unit, _weakest(search, base, name, strength))
        for name, strength in search.strengths(base.effects)
    ]


def in_words(found: list[Detectable], names: Iterable[str]) -> str:
    """One sentence for a reader; ``names`` are all effects that could be present."""
    shown = ", ".join(str(effect) for effect in found if effect.value is not None)
    hidden = ", ".join(str(effect) for effect in found if effect.value is None)
    parts = [f"would show in {POWER:.0%} of such campaigns from this strength on: {shown}"] * bool(shown)
    parts += [f"at no usual strength: {hidden}"] * bool(hidden)
    covered = {effect.effect for effect in found}
    other = ", ".join(name for name in names if name not in covered)
    parts += [f"not covered, as no value of a parameter makes them vanish: {other}"] * bool(other)
    return "; ".join(parts)


def expected(design: Trials, criteria: Criteria = DEFAULT) -> Fit:
    """The base model fitted to a campaign that has not been run: the ground of Li09, usual scatter, nothing hidden.

    ``design``: its trials, any numbers in place of what they will measure; what is NaN they can't.
    """
    model = model_of("simple", (), catalogue(), design.robot or SANDBOT)
    theta = np.array([parameter.start for parameter in model.parameters])
    clocks = clock(tuple(str(gait) for gait in design.gait))
    inputs, params = model.inputs(theta, USUAL_K(design.phi), design.omega_rad_s, design.phi, clocks, USUAL_K)
    values = np.broadcast_to(model.walker.predict(inputs, params).observables, (len(design), len(Observable)))
    noise = np.random.default_rng(0).standard_normal(values.shape)
    values = values + usual_noise(design.accuracy or USUAL) * noise
    columns: dict[str, Any] = {
        observable.column: np.where(np.isfinite(getattr(design, observable.column)), values[:, observable], np.nan)
        for observable in Observable
    }
    plain = fit(model, cells_of(replace(design, **columns)))
    return fitted_at(model, plain.cells, plain.point, nuisances_for(plain, criteria))


def _weakest(search: EffectSearch, base: Fit, name: str, parameter: Parameter) -> float | None:
    model = search.model(search.extended(base.effects, [name])[0])
    problem = Problem(model, base.cells, base.nuisances)
    index, neutral = model.names.index(f"{name}.{parameter.name}"), float(parameter.neutral or 0.0)
    needed = np.sqrt(claim_threshold(base, search.criteria)) + Z
    ends = [end for end in (parameter.high, parameter.low) if end != neutral]
    shown = []
    for strengths in (np.linspace(neutral, end, STRENGTHS + 1) for end in ends):
        # The last strength that is not detected: a gap may close again where an effect makes cells swim, or walk.
        hidden = int(np.flatnonzero(_gap(problem, base, index, strengths) < needed)[-1])
        shown += [float(strengths[hidden + 1])] if hidden < STRENGTHS else []
    return min(shown, key=lambda value: abs(value - neutral), default=None)


def _gap(problem: Problem, base: Fit, index: int, strengths: Floats) -> Floats:
    """√λ at every strength of one parameter, the first of which is the neutral one."""
    values = {f"{effect.identifier}.{p.name}": p.start for effect in problem.model.effects for p in effect.parameters}
    values |= {name: estimate.value for name, estimate in base.parameters.items()}
    theta = np.tile([values.get(name, 0.0) for name in problem.model.names], (len(strengths), 1))
    theta[:, index] = strengths
    rows = np.zeros(len(strengths), dtype=np.int64)
    shared = None if base.nuisances is None else base.problem.shared(base.state)[rows]
    states = problem.states(theta, base.state.ln_k[rows], base.state.slope[rows], shared)
    moved = np.where(problem.measured, states.predicted - states.predicted[0], 0.0)
    gap = np.zeros((len(base.state.all_residuals[0]), len(strengths)))
    pressed = states.pressed[0] - states.pressed
    gap[: moved[0].size] = np.einsum("cij,rcj->rci", base.state.whiten[0], moved).reshape(len(strengths), -1).T
    gap[moved[0].size : moved[0].size + pressed.shape[1]] = pressed.T
    return np.asarray(np.linalg.norm(project_out(gap, tangent_basis(base.problem, base.state)), axis=0))
