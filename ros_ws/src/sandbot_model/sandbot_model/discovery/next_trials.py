"""Trials that would best discriminate between the surviving sets (T-optimality: Atkinson & Fedorov 1975)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_common.robot import Robot
from sandbot_model.data.clustering import frequencies
from sandbot_model.data.penetrometer import USUAL_SD
from sandbot_model.discovery.criteria import DEFAULT, Criteria
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.gait import clock_signal
from sandbot_model.physics.geometry import deepest_m
from sandbot_model.physics.observables import NAMES, usual_noise

MAX_TRIALS = 6
CONTENDERS = 6
"""The best sets, between which the trials are to decide."""
READINGS = 2
"""Most penetrometer readings among the proposed measurements."""
LEAST_SD = 0.3
"""Expected gap below which two sets predict the same."""
FINER = 3
"""Frequencies tried between neighbouring measured ones."""
PENETRATION = "penetration_force"
"""The force on a leg pressed into the ground: not a trial, but a measurement of what trials can't show."""
DEPTHS = (0.01 / 0.046, 0.02 / 0.046, 0.03 / 0.046, 0.044 / 0.046)
"""Depths of proposed readings, relative to the greatest that the legs reach: 1 to 4.4 of SandBot's 4.6 cm."""
SETTLED_SD = 5.0
"""Gap in standard errors at which a pair of sets counts as separated."""
LEAST_REPLICATES = 2
"""Fewest replicates proposed, so that their scatter can be seen."""


Condition = tuple[bool, float, float]
"""Whether a leg is pressed, φ, and the depth [m] or ω [rad/s]."""


@dataclass(frozen=True)
class NextTrial:
    """A measurement worth making. It ``separates`` two sets by ``expected_gap_sd`` standard deviations of one
    replicate; ``replicates`` of it, together with the others proposed, settle which of them holds (``next_trials``).

    ``observable`` is the name of an ``Observable``, for a trial at ``omega_rad_s`` in a ``gait`` (empty if that is not
    known by name), or ``PENETRATION``, for a reading at ``depth_m``.
    """

    phi: float
    omega_rad_s: float
    observable: str
    separates: tuple[str, str]
    expected_gap_sd: float
    replicates: int
    depth_m: float = float("nan")
    gait: str = ""

    @property
    def kind(self) -> str:
        """``trial``, or ``reading`` of the penetrometer."""
        return "reading" if self.observable == PENETRATION else "trial"

    @property
    def condition(self) -> Condition:
        """The condition to set up."""
        pressed = self.kind == "reading"
        return pressed, self.phi, self.depth_m if pressed else self.omega_rad_s

    @property
    def where(self) -> str:
        """The condition for a reader."""
        if self.kind == "reading":
            return f"φ {self.phi:.3f}, {round(100 * self.depth_m, 2)} cm deep"
        return ", ".join(filter(None, (f"φ {self.phi:.3f}, ω {self.omega_rad_s:.3g} rad/s", self.gait)))


class Proposed(NamedTuple):
    """Measurements that are worth making."""

    trials: list[NextTrial]
    shown: Mapping[str, NextTrial] = MappingProxyType({})
    """Effects that would show, and where best: another's trial may also tell of them."""
    out_of_reach: Sequence[str] = ()
    """Effects that no measurement within reach would show."""


def next_trials(contenders: Sequence[Fit], criteria: Criteria = DEFAULT) -> list[NextTrial]:
    """The most informative measurements, best first, no two at the same condition; empty if none separates the sets.

    They are chosen greedily: each adds most to the separation of all pairs by those chosen before it. A gap counts only
    up to ``SETTLED_SD``, so that a pair that is easily separated does not take all of them. The replicates needed for a
    pair are shared among its measurements. A measurement that would need more replicates than there are trials is out
    of reach; so are those of a pair if one of its sets, refitted, could explain all that are chosen.
    """
    if len(contenders) < 2:
        return []
    pairs, within_reach = list(combinations(map(Predicted.by, contenders[:CONTENDERS]), 2)), contenders[0].cells.trials
    chosen = _chosen([between(*pair) for pair in pairs], within_reach)
    kept = [trial for pair in pairs for trial in _after_refitting(*pair, chosen, within_reach, criteria.clearly)]
    return sorted(kept, key=lambda trial: -trial.expected_gap_sd)


def trials_to_exclude(base: Fit, unseen: Sequence[Fit]) -> Proposed:
    """The most informative measurements in which effects would show that are ``unseen`` but not excluded."""
    predicted, within_reach = Predicted.by(base), base.cells.trials
    pairs = {other.effects[0]: between(predicted, Predicted.by(other)) for other in unseen}
    least = {name: min((trial.replicates for trial in trials), default=math.inf) for name, trials in pairs.items()}
    hopeless = [name for name in least if least[name] > within_reach]
    chosen = _chosen(list(pairs.values()), within_reach)
    conditions = {trial.condition for trial in chosen}
    made = {name: [trial for trial in trials if trial.condition in conditions] for name, trials in pairs.items()}
    return Proposed(chosen, {name: own[0] for name, own in made.items() if own and name not in hopeless}, hopeless)


def _chosen(pairs: Sequence[Sequence[NextTrial]], within_reach: int) -> list[NextTrial]:
    """The most informative of each pair's measurements (see ``next_trials``), without those that alone would need more
    replicates than are ``within_reach``."""
    gaps = [{trial.condition: trial for trial in reversed(trials)} for trials in pairs]
    separated = np.zeros(len(pairs))
    chosen: list[NextTrial] = []
    while len(chosen) < MAX_TRIALS and (best := _most_informative(gaps, separated, chosen, within_reach)):
        chosen.append(best)
        separated += [_weight(gap.get(best.condition)) for gap in gaps]
    return sorted(_with_shared_replicates(chosen, gaps), key=lambda trial: -trial.expected_gap_sd)


def _with_shared_replicates(
    chosen: Sequence[NextTrial], gaps: Sequence[Mapping[Condition, NextTrial]]
) -> list[NextTrial]:
    """The trials with as few replicates as separate each pair by ``SETTLED_SD``, all of its trials together."""
    of_pair = {trial.separates: gap for gap in gaps for trial in gap.values()}

    def replicates(of: NextTrial) -> int:
        gap = of_pair[of.separates]
        chi2 = [
            (trial.separates == of.separates, gap[trial.condition].expected_gap_sd ** 2)
            for trial in chosen
            if trial.condition in gap
        ]
        # Those for other pairs may have the fewest replicates.
        given = LEAST_REPLICATES * sum(value for own, value in chi2 if not own)
        return replicates_for(sum(value for own, value in chi2 if own), given)

    return [replace(trial, replicates=replicates(trial)) for trial in chosen]


def _most_informative(
    gaps: Sequence[Mapping[Condition, NextTrial]], separated: Floats, chosen: Sequence[NextTrial], within_reach: int
) -> NextTrial | None:
    """The measurement that adds most to ``separated (pairs,)``, or None. It is reported for the pair that gains most;
    if all its pairs are separated already, it is proposed only where ``LEAST_REPLICATES`` are enough."""
    taken = {trial.condition for trial in chosen}
    readings = sum(trial.kind == "reading" for trial in chosen)
    conditions = {key: trial for gap in gaps for key, trial in gap.items() if key not in taken}
    best, most = None, 0.0
    for key, trial in conditions.items():
        if trial.kind == "reading" and readings == READINGS:
            continue
        after = np.array([_weight(gap.get(key)) for gap in gaps]) + separated
        gain = np.minimum(after, SETTLED_SD**2) - np.minimum(separated, SETTLED_SD**2)
        # Once all pairs are separated, a wider gap still counts a little: it makes the separation more certain.
        score = gain + 1e-3 * np.minimum(after - separated, SETTLED_SD**2)
        shown = gaps[int(np.argmax(score))].get(key, trial)
        enough = within_reach if gain.any() else LEAST_REPLICATES
        if score.sum() > most and shown.replicates <= enough:
            best, most = shown, float(score.sum())
    return best


def _weight(trial: NextTrial | None) -> float:
    """Expected χ² of ``LEAST_REPLICATES`` replicates."""
    return 0.0 if trial is None else LEAST_REPLICATES * trial.expected_gap_sd**2


@dataclass(frozen=True, eq=False)
class Predicted:
    """A fit's predictions of all candidate measurements: trials at levels φ × frequencies ω, readings at φ × depths."""

    name: str
    gait: str
    """The gait of most trials, in which the candidates are run, too; see ``known_gait``."""
    phi: Floats
    omega: Floats
    noise: Floats
    """Standard deviation of one replicate ``(4,)``."""
    trials: Floats
    """Observables ``(φ, ω, 4)``."""
    moves: Floats
    """Changes of ``trials`` with the parameters ``(m, φ, ω, 4)``, the sum of whose products is their covariance."""
    scatter: Floats
    """Variance of ``trials`` from the scatter of φ, ``(φ, ω, 4)``."""
    depth_m: Floats
    force: Floats
    """Force of the penetrometer ``(φ, depths)``."""
    force_sd: Floats

    @property
    def variance(self) -> Floats:
        """Variance of ``trials`` from the uncertainty of the parameters and the scatter of φ, ``(φ, ω, 4)``."""
        return np.asarray((self.moves**2).sum(axis=0) + self.scatter)

    @classmethod
    def by(cls, fit: Fit) -> "Predicted":
        """The predictions of one fit, at frequencies spaced more finely than those measured."""
        cells = fit.cells
        phi, omega = cells.level_phi[:, None], _finer(frequencies(cells.omega))[None, :]
        sides = [fit.predict(phi + sign * cells.phi_scatter, omega).observables for sign in (-1.0, 1.0)]
        at_phi, at_depth = np.meshgrid(cells.level_phi, depths_m(cells.robot), indexing="ij")
        force, force_sd = fit.press(at_phi.ravel(), at_depth.ravel())
        return cls(
            name=" + ".join(fit.effects) or "base",
            gait=known_gait(fit.gait),
            phi=cells.level_phi,
            omega=omega[0],
            noise=np.where(np.isfinite(cells.noise), cells.noise, usual_noise(cells.accuracy)),
            trials=fit.predict(phi, omega).observables,
            moves=fit.deviations(phi, omega),
            scatter=(0.5 * (sides[1] - sides[0])) ** 2,
            depth_m=at_depth[0],
            force=force.reshape(at_phi.shape),
            force_sd=np.broadcast_to(force_sd, force.shape).reshape(at_phi.shape),
        )


def _after_refitting(
    first: Predicted, second: Predicted, chosen: Sequence[NextTrial], within_reach: int, clearly: float
) -> list[NextTrial]:
    """The chosen measurements of this pair, trials with as many replicates as leave a χ² of ``clearly`` even if either
    set is refitted to them; no trials if that takes more replicates than are ``within_reach``."""
    own = [trial for trial in chosen if trial.separates == (first.name, second.name)]
    trials, readings = ([trial for trial in own if trial.kind == kind] for kind in ("trial", "reading"))
    others = [trial for trial in chosen if trial.kind == "trial" and trial not in own]
    while trials and _chi2_after_refitting(first, second, [*trials, *others]) < clearly:
        trials = [replace(trial, replicates=2 * trial.replicates) for trial in trials]
        if max(trial.replicates for trial in trials) > within_reach:
            trials = []
    return [*trials, *readings]


def _chi2_after_refitting(first: Predicted, second: Predicted, trials: Sequence[NextTrial]) -> float:
    """χ² that these trials are expected to leave if one set is true and the other is refitted to them and all data, to
    first order: gᵀ(N + S)⁻¹g with the gaps g of all observables, their noise N, and the covariance S of the refitted
    set's predictions. The smaller of both ways round."""
    phi = [first.phi.tolist().index(trial.phi) for trial in trials]
    omega = [first.omega.tolist().index(trial.omega_rad_s) for trial in trials]
    count = np.array([trial.replicates for trial in trials])[:, None]
    gap = (first.trials - second.trials)[phi, omega].ravel()

    def left(refitted: Predicted) -> float:
        moves = refitted.moves[:, phi, omega].reshape(len(refitted.moves), -1)
        noise = np.diag(((first.noise**2 + refitted.scatter[phi, omega]) / count).ravel())
        return float(gap @ np.linalg.solve(noise + moves.T @ moves, gap))

    return min(left(first), left(second))


def known_gait(gait: str) -> str:
    """The name of a gait; empty where its clock signal is not known by name."""
    return gait if clock_signal(gait) else ""


def depths_m(robot: Robot) -> Floats:
    """Depths at which readings are proposed ``(depths,)``, to three digits."""
    return np.array([float(f"{share * deepest_m(robot):.3g}") for share in DEPTHS])


def between(first: Predicted, second: Predicted) -> list[NextTrial]:
    """Measurements in which two fits differ, the widest gap first, including conditions not measured yet."""
    found = [*_trials_between(first, second), *_readings_between(first, second)]
    return sorted(found, key=lambda trial: -trial.expected_gap_sd)


def _trials_between(first: Predicted, second: Predicted) -> list[NextTrial]:
    """One trial per condition, in the observable that separates the two most."""
    gap = np.abs(first.trials - second.trials) / np.sqrt(first.noise**2 + first.variance + second.variance)
    best, names = gap.argmax(axis=-1), (first.name, second.name)
    found = []
    for p, w in np.argwhere(gap.max(axis=-1) > LEAST_SD):
        size = float(gap[p, w].max())
        at = (float(first.phi[p]), float(first.omega[w]))
        found.append(NextTrial(*at, NAMES[best[p, w]], names, size, replicates_for(size**2), gait=first.gait))
    return found


def _readings_between(first: Predicted, second: Predicted) -> list[NextTrial]:
    """One reading per level, at the depth that separates the two most."""
    sd = np.sqrt((USUAL_SD * first.force) ** 2 + first.force_sd**2 + second.force_sd**2)
    gap = np.abs(first.force - second.force) / sd
    best, names = gap.argmax(axis=1), (first.name, second.name)
    found = []
    for level in np.flatnonzero(gap.max(axis=1) > LEAST_SD):
        size, depth = float(gap[level].max()), float(first.depth_m[best[level]])
        at = (float(first.phi[level]), float("nan"))
        found.append(NextTrial(*at, PENETRATION, names, size, replicates_for(size**2), depth))
    return found


def replicates_for(chi2: float, given: float = 0.0) -> int:
    """Replicates, each of which is expected to add ``chi2`` to what is ``given``, that separate a pair."""
    return max(LEAST_REPLICATES, math.ceil((SETTLED_SD**2 - given) / chi2))


def _finer(omega: Floats) -> Floats:
    if len(omega) < 2:
        return omega
    steps = [np.linspace(a, b, FINER + 1, endpoint=False) for a, b in pairwise(omega)]
    return np.round(np.concatenate([*steps, omega[-1:]]), 2)
