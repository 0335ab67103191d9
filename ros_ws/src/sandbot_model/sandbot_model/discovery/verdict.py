"""The rules of a verdict: adequate, identified, ambiguous, partial, unexplained or untested.

``judge`` applies them in this order to the sets that were fitted:

1. Without a test of lack of fit: *untested*.
2. If the base model shows no lack of fit and no single effect gains enough to be claimed: *adequate*.
3. Candidates are the sets that show no lack of fit, at plausible parameters, and whose effects all earn their place. If
   there are none: *unexplained*.
4. If a set that does not contain the best candidate fits clearly better, even one that is not credible: *unexplained*.
5. If other candidates, or sets of equal size that pass, are not clearly worse than the best: *ambiguous*.
6. Otherwise: *identified*.

``partial`` adds the verdict of that name.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.data.conditions import Cells, level_name
from sandbot_model.data.distributions import chi2_sf, f_isf, f_sf
from sandbot_model.discovery.criteria import DEFAULT, Criteria
from sandbot_model.fitting.diagnose import stage_tests
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.variants import VARIANTS

RESPONSE_TIME = "delta_t_s"
EXPLAINS_ALL = ("identified", "ambiguous")
"""Statuses by which effects of the catalogue explain all data."""
NAMES_EFFECTS = (*EXPLAINS_ALL, "partial")
"""Statuses that name effects."""
INCOMPLETE = ("partial", "unexplained")
"""Statuses that leave part of the data unexplained."""
CONVENTION_COUNT = sum(map(len, VARIANTS.values()))
"""Number of other conventions from which one is selected."""
USUAL_LEVEL = 0.05
"""p-value below which a reader takes a misfit for real, though the criteria do not reject the model yet."""
Names = tuple[str, ...]
"""A set of effects, in the order of the catalogue; empty for the base model."""
Sets = Mapping[Names, Fit]
"""Fits by their effects on top of the base model."""


@dataclass(frozen=True)
class Verdict:
    """``status`` is adequate, identified, ambiguous, partial, unexplained or untested; ``because``: one sentence with
    numbers, the ``statistics`` and then the ``remarks``: what else it could be, and what to do."""

    status: str
    effects: Names
    alternatives: tuple[Names, ...]
    because: str
    remarks: tuple[str, ...] = ()

    def with_remarks(self, *remarks: str) -> "Verdict":
        """The same verdict with these remarks, except empty ones, at the end of its sentence."""
        new = tuple(filter(None, remarks))
        return replace(self, because="; ".join((self.because, *new)), remarks=(*self.remarks, *new))

    @property
    def statistics(self) -> str:
        """The sentence without the remarks."""
        return self.because.removesuffix("".join(f"; {remark}" for remark in self.remarks))


def passes(fit: Fit, criteria: Criteria = DEFAULT) -> bool:
    """Whether a fit shows no lack of fit, at plausible parameters."""
    return leaves_nothing(fit, criteria) and sound(fit)


def leaves_nothing(fit: Fit, criteria: Criteria = DEFAULT) -> bool:
    """Whether there is no significant lack of fit against the replicates, jointly and in each observable."""
    tested = [p for p in fit.goodness.lack_of_fit.values() if np.isfinite(p)]
    jointly = fit.lack_of_fit_p >= criteria.lack_of_fit
    return bool(jointly and all(p >= criteria.lack_of_fit_of_one for p in tested))


def sound(fit: Fit) -> bool:
    """Whether the parameters of all effects, and Δt if there are effects, are plausible and not at a bound."""
    return not doubtful_parameters(fit)


def doubtful_parameters(fit: Fit) -> list[str]:
    """Parameters of effects that are at a bound or implausible; also Δt, if it is well determined beside effects."""
    delta_t = RESPONSE_TIME if fit.effects and is_determined(*fit.parameters[RESPONSE_TIME]) else ""
    return [name for name in (*fit.at_bounds, *fit.implausible) if "." in name or name == delta_t]


def doubtful_values(fit: Fit) -> str:
    """The doubtful parameters, or the implausible ones of a base model alone, with their plausible ranges:
    ``delta_t_s = 1.75 (plausible: 0.1 to 1.2)``; empty if there are none."""
    ranges = dict(zip(fit.model.names, fit.model.parameters, strict=True))
    return " and ".join(
        f"{name} = {fit.parameters[name].value:.4g} (plausible: {ranges[name].low:g} to {ranges[name].high:g})"
        for name in dict.fromkeys(doubtful_parameters(fit) if fit.effects else fit.implausible)
    )


def only_with(fit: Fit) -> str:
    """``only with`` these values; empty if there are none."""
    values = doubtful_values(fit)
    return f"only with {values}" if values else ""


def is_determined(value: float, stderr: float) -> bool:
    """Whether the standard error is less than half the value."""
    return bool(stderr < 0.5 * abs(value))


def earns_place(fits: Sets, larger: Names, smaller: Names, criteria: Criteria = DEFAULT) -> bool:
    """Whether the larger set has plausible parameters and its additional effects gain enough."""
    return sound(fits[larger]) and gains_enough(fits, larger, smaller, criteria)


def gains_enough(fits: Sets, larger: Names, smaller: Names, criteria: Criteria) -> bool:
    """Whether the gain in deviance exceeds the threshold of each additional effect, and a fraction of it (``one_cell``)
    without the cell or level that gains most."""
    gain = _gain(fits[smaller], fits[larger])
    threshold = claim_threshold(fits[larger], criteria) * (len(larger) - len(smaller))
    return bool(gain.sum() > threshold and gain.sum() - gain.max() > criteria.one_cell * threshold)


def claim_threshold(fit: Fit, criteria: Criteria = DEFAULT) -> float:
    """Gain in deviance that an effect must bring in these data; more than ``criteria.claim`` if replicates are few.

    ``claim_on_replicates``, multiplied by the overdispersion about the larger set (quasi-likelihood; Burnham & Anderson
    2002, ch. 2).
    """
    return claim_on_replicates(fit.cells, criteria) * overdispersion(fit)


def claim_on_replicates(cells: Cells, criteria: Criteria) -> float:
    """``criteria.claim`` of a pure error known from so many replicates: the tail probability of χ² is converted to F on
    its degrees of freedom; inf without any."""
    freedom = int(cells.pure_error_dof.sum())
    return f_isf(chi2_sf(criteria.claim, 1), 1, freedom) if freedom else math.inf


def selection_penalty(count: int) -> float:
    """Penalty in BIC for selecting one of so many models (extended BIC; Chen & Chen 2008, Biometrika 95, 759)."""
    return 2 * math.log(max(count, 1))


def overdispersion(fit: Fit) -> float:
    """χ² per degree of freedom if cell means scatter about a fit by more than replicates do; else 1."""
    return max(1.0, fit.goodness.chi2 / fit.goodness.dof) if fit.goodness.dof > 0 else 1.0


def _deviance_terms(fit: Fit) -> Floats:
    """Terms of the deviance: of each cell, of penetrometer readings at each level, of each nuisance's prior."""
    readings = fit.cells.pressed
    level = readings.level if readings is not None else np.zeros(0, dtype=np.int64)
    pressed = np.bincount(level, fit.state.pressed[0] ** 2, len(fit.level_phi))
    return np.concatenate([fit.state.cell_deviance[0], pressed, fit.state.shared[0] ** 2])


def judge(fits: Sets, criteria: Criteria = DEFAULT) -> Verdict:
    """The verdict on all sets tried, by the rules above."""
    base = fits[()]
    if np.isnan(base.lack_of_fit_p):
        return Verdict(
            "untested", (), (), "no more cell means than parameters of the base model: nothing is left to test"
        )
    # Implausible parameters count here: they bar a claim, but the misfit that they repair is real.
    helpful = [key for key in fits if len(key) == 1 and gains_enough(fits, key, (), criteria)]
    if passes(base, criteria) and not helpful:
        return Verdict("adequate", (), (), _base_suffices(base))
    good = [fit for key, fit in fits.items() if key and passes(fit, criteria) and _all_needed(fits, key, criteria)]
    if not good:
        return _unexplained(fits, criteria)
    best = min(good, key=lambda fit: fit.bic)
    margin = criteria.clearly * overdispersion(best)
    # A Δt that had to be held indicates a missing effect: then a set that fits as well also speaks against the claim.
    lead = margin if not best.model.held else -margin
    better = [fit for fit in fits.values() if not set(best.effects) <= set(fit.effects) and fit.bic < best.bic - lead]
    better = [fit for fit in better if fit not in good]
    if better:
        return _not_the_best_fit(best, min(better, key=lambda fit: fit.bic))
    rivals = [fit for fit in good if fit is not best] + _rivals_of_equal_size(fits, best, good, criteria)
    rivals = sorted(
        (fit for fit in rivals if _penalised_bic(fit) - _penalised_bic(best) < margin), key=lambda fit: fit.bic
    )
    although = f"{_base_suffices(base)}; " if leaves_nothing(base, criteria) else ""
    if rivals:
        sets = tuple(fit.effects for fit in (best, *rivals))
        return Verdict(
            "ambiguous",
            best.effects,
            sets,
            (f"{although}{_fall(base, best)}; " if although else "")
            + f"{len(sets)} sets explain the data equally well: {'; '.join(map(_name, sets))}"
            + (
                f" (one with a formula selected from {CONVENTION_COUNT})" if rivals[-1].bic - best.bic >= margin else ""
            ),
        )
    return Verdict("identified", best.effects, (best.effects,), although + _because(base, best))


def _base_suffices(base: Fit) -> str:
    """That the base model shows no lack of fit, or too little to reject it, and at which implausible values."""
    by = (
        f"no more than {base.cells.scatter}"
        if base.lack_of_fit_p >= USUAL_LEVEL
        else f"more than {base.cells.scatter}, too little to reject it"
    )
    only = only_with(base)
    return f"the {base.model.base} model misses the cell means by {by} {p_in_words(base)}" + (
        f", but {only}" if only else ""
    )


def _fall(base: Fit, best: Fit) -> str:
    return f"with {_name(best.effects)} the deviance falls from {base.deviance:.0f} to {best.deviance:.0f}"


def _penalised_bic(fit: Fit) -> float:
    return fit.bic + price_of_conventions(fit)


def price_of_conventions(fit: Fit) -> float:
    """Penalty in BIC for effects whose convention was selected from all."""
    return len(fit.variants) * selection_penalty(CONVENTION_COUNT) * overdispersion(fit)


def _rivals_of_equal_size(fits: Sets, best: Fit, good: Iterable[Fit], criteria: Criteria) -> list[Fit]:
    """Other sets of equal size that pass, although an effect falls short of the claim threshold: that alone does not
    rule them out."""
    others = [fit for key, fit in fits.items() if len(key) == len(best.effects) and fit not in good]
    return [fit for fit in others if passes(fit, criteria)]


def _all_needed(fits: Sets, key: Names, criteria: Criteria) -> bool:
    return all(earns_place(fits, key, part, criteria) for part in parts_of(key, fits))


def parts_of(names: Names, fits: Sets) -> list[Names]:
    """The fitted sets with one effect less than this one; none for the base model."""
    return [part for part in combinations(names, len(names) - 1) if part in fits] if names else []


def _because(base: Fit, best: Fit) -> str:
    return (
        f"{_fall(base, best)} on {best.goodness.dof} degrees of freedom, and what remains is within "
        f"{best.cells.scatter} {p_in_words(best)}{_what_is_tested(best)}"
    )


def _what_is_tested(fit: Fit) -> str:
    """The statistic that p belongs to, where a reader would find another p for the deviance, in which conditions near
    the switch to swimming also count by how much they scatter; else empty."""
    dof, error_dof = fit.goodness.dof, int(fit.cells.pure_error_dof.max())
    seems_to_fail = f_sf(fit.deviance / dof, dof, error_dof) < USUAL_LEVEL <= fit.lack_of_fit_p
    if not seems_to_fail:
        return ""
    return f", by the misfit alone: F = {fit.goodness.lack_of_fit_f:.2f} on {dof} and {error_dof} degrees of freedom"


def next_best(fits: Sets, best: Fit, tried: Iterable[Fit] = (), criteria: Criteria = DEFAULT) -> str:
    """One clause: the best other set of as many effects, those ``tried`` under other conventions included, and all that
    fit about as well; empty if there is none."""
    ranked = _others_of_its_size(fits, best, tried)
    second = next(filter(sound, ranked), None)
    clauses = [f"the next best, {_in_full(second)}, has ΔBIC {second.bic - best.bic:.0f}"] if second else []
    if second and second.variants:
        clauses.append(f"(its form selected from {CONVENTION_COUNT})")
    if ranked and ranked[0] is not second:
        # Excluded for its parameters, not for its fit: the reader may judge them differently.
        but = f"but with {doubtful_parameters(ranked[0])[0]} at or beyond its bound"
        clauses.append(f"({_name(ranked[0].effects)} {ranked[0].bic - best.bic:.0f}, {but})")
    alike = ["it" if fit is second else _in_full(fit) for fit in look_alikes(fits, best, tried, criteria)]
    same = f"{' and '.join(alike)} {'fits' if len(alike) == 1 else 'fit'} about as well" if alike else ""
    return "; ".join(filter(None, (" ".join(clauses), same)))


def look_alikes(fits: Sets, best: Fit, tried: Iterable[Fit], criteria: Criteria) -> list[Fit]:
    """Those of the same sets as in ``next_best`` that pass and do not fit clearly worse, in order of BIC."""
    most = best.bic + criteria.clearly * overdispersion(best)
    return [fit for fit in _others_of_its_size(fits, best, tried) if fit.bic < most and passes(fit, criteria)]


def _others_of_its_size(fits: Sets, best: Fit, tried: Iterable[Fit]) -> list[Fit]:
    """The other sets of as many effects and, of those ``tried``, the sound ones, in order of BIC."""
    some = [*fits.values(), *filter(sound, tried)]
    others = (fit for fit in some if fit.effects != best.effects and len(fit.effects) == len(best.effects))
    return sorted(others, key=lambda fit: fit.bic)


def best_earned(fits: Sets, criteria: Criteria) -> Fit:
    """The best set whose effects all earn their place, or the base model."""
    return min(
        (fit for key, fit in fits.items() if not key or _all_needed(fits, key, criteria)), key=lambda fit: fit.bic
    )


def _not_the_best_fit(best: Fit, better: Fit) -> Verdict:
    """The refusal of a claim because a set that is not credible itself fits better."""
    why = (
        f"with {doubtful_parameters(better)[0]} at or beyond its bound"
        if doubtful_parameters(better)
        else "not all of its effects gain enough"
    )
    how = "better still" if better.bic < best.bic - 1.0 else "as well"
    because = (
        f"{_name(best.effects)} fits {_within_scatter(best)}, but {_name(better.effects)} fits "
        f"{how} (ΔBIC {better.bic - best.bic:.0f}), though {why}, so neither is claimed"
    )
    return Verdict("unexplained", (), (), because)


def _unexplained(fits: Sets, criteria: Criteria) -> Verdict:
    best = best_earned(fits, criteria)
    named = f"the best set, {_name(best.effects)}," if best.effects else "the base model"
    missed = f"{named} still fails {p_in_words(best)}{_where_it_fails(best)}"
    if would := would_suffice(fits, criteria):
        tried = f"{_name(would.effects)} would fit {_within_scatter(would)}, but "
        tried += why_not_claimed(fits, would, criteria)
    else:
        tried = "no set of catalogue effects passes the lack-of-fit test" if len(fits) > 1 else _NONE_TRIED
    return Verdict("unexplained", (), (), f"{tried}: {missed}")


def would_suffice(fits: Sets, criteria: Criteria) -> Fit | None:
    """The smallest set of effects, and of these the best, that shows no lack of fit; None if there is none."""
    enough = [fit for key, fit in fits.items() if key and leaves_nothing(fit, criteria)]
    return min(enough, key=lambda fit: (len(fit.effects), fit.bic), default=None)


def _where_it_fails(fit: Fit) -> str:
    where = ""
    if fit.fails:
        worst = fit.fails[0]
        where = (
            f"; {len(fit.fails)} cell means are still missed, the worst {worst.observable} at "
            f"φ {level_name(fit.cells, worst.cell)}, ω {worst.omega_rad_s:.3g} rad/s by {abs(worst.z):.1f} standard "
            "errors"
        )
    if tests := [test for test in stage_tests(fit) if test.missed]:
        worst_stage = min(tests, key=lambda test: test.p)
        where += f"; in the chain, {worst_stage.stage} ({worst_stage.connects}) fails most, p = {worst_stage.p:.1g}"
    return where


def refused_as_implausible(fit: Fit) -> Verdict:
    """The refusal of a set that shows no lack of fit, because a parameter is implausible."""
    would = f"{_name(fit.effects)} would fit {_within_scatter(fit)}, but {only_with(fit)}"
    return Verdict("unexplained", (), (), would)


def why_not_claimed(fits: Sets, fit: Fit, criteria: Criteria) -> str:
    """Why a set that shows no lack of fit, not all of whose effects gain enough, is not claimed."""
    if doubtful_parameters(fit):
        return only_with(fit)
    part = next(_short_of(fits, fit, criteria))
    gain = _gain(fits[part], fit)
    over = f" on top of {_name(part)}" if part else ""
    if gain.sum() <= (threshold := claim_threshold(fit, criteria)):
        gained, needed = _told_apart(gain.sum(), threshold)
        return f"gains {gained}{over}, less than the {needed} that an effect must"
    cell = int(np.argmax(gain))
    is_cell = cell < len(fit.cells.phi)
    where = f"φ {level_name(fit.cells, cell)}, ω {fit.cells.omega[cell]:.3g} rad/s" if is_cell else "one level"
    return f"{gain.max() / gain.sum():.0%} of what it gains{over} is at {where}: run that again"


def decided_by(fits: Sets, fit: Fit, criteria: Criteria) -> tuple[Names, int] | None:
    """Where ``why_not_claimed`` asks for a condition to be run again: the part over which the set gains most there, and
    the condition's cell; else None."""
    part = next(_short_of(fits, fit, criteria), None)
    if part is None or doubtful_parameters(fit):
        return None
    gain = _gain(fits[part], fit)
    cell = int(np.argmax(gain))
    enough = gain.sum() > claim_threshold(fit, criteria)
    return (part, cell) if enough and cell < len(fit.cells.phi) else None


def _short_of(fits: Sets, fit: Fit, criteria: Criteria) -> Iterator[Names]:
    """The parts of a set over which it does not gain enough."""
    return (part for part in parts_of(fit.effects, fits) if not gains_enough(fits, fit.effects, part, criteria))


def _gain(smaller: Fit, larger: Fit) -> Floats:
    return _deviance_terms(smaller) - _deviance_terms(larger)


def _told_apart(first: float, second: float) -> tuple[str, str]:
    """Two numbers as text, with as many decimals (at most 3) as it takes to see that they differ."""
    texts = [(f"{first:.{decimals}f}", f"{second:.{decimals}f}") for decimals in range(4)]
    return next((pair for pair in texts if pair[0] != pair[1]), texts[-1])


_NONE_TRIED = "no effect was tried (--max-effects 0)"


def _name(effects: Names) -> str:
    return " + ".join(effects) or "the base model"


def _in_full(fit: Fit) -> str:
    return in_full(fit.effects, fit.variants)


def in_full(effects: Iterable[str], variants: Mapping[str, str]) -> str:
    """A set, and the conventions in it that are not the catalogue's: ``leg_slip (the peak spared) + cohesion``."""
    return " + ".join(f"{name} ({variants[name]})" if name in variants else name for name in effects)


def either(sets: Iterable[Names]) -> str:
    """``leg_slip or bed_slope + cohesion``."""
    return " or ".join(map(" + ".join, sets))


def _within_scatter(fit: Fit) -> str:
    return f"within {fit.cells.scatter} {p_in_words(fit)}"


def p_in_words(fit: Fit) -> str:
    """``(lack of fit p = 0.43)``."""
    return f"({p_of_test(fit)})"


def with_p_of(reported: Fit, verdict: Verdict, judged: Fit) -> Verdict:
    """A verdict on the set ``judged`` with the p-value of its reported fit, which may be deeper, instead."""
    because = p_in_words(reported).join(verdict.because.rsplit(p_in_words(judged), 1))
    if tested := _what_is_tested(judged):
        because = because.replace(tested, _what_is_tested(reported))
    return replace(verdict, because=because)


def p_of_test(fit: Fit) -> str:
    """``lack of fit p = 0.43``; where only single observables fail, theirs: ``lack of fit of speed p = 1e-5, of all
    together 0.38``."""
    jointly, tests = f"{fit.lack_of_fit_p:.2g}", fit.goodness.lack_of_fit.items()
    failed = [f"{name.replace('_', ' ')} p = {p:.2g}" for name, p in tests if p < DEFAULT.lack_of_fit_of_one]
    if not failed or not fit.lack_of_fit_p >= DEFAULT.lack_of_fit:
        return f"lack of fit p = {jointly}"
    return f"lack of fit of {', of '.join(failed)}, of all together {jointly}"
