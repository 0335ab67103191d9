"""What ``compare`` and ``discover`` print first: the answer, the error before and after, and why."""

import math
from collections.abc import Sequence

from sandbot_common.robot import SANDBOT, Robot
from sandbot_common.terminal import filled, styled
from sandbot_model.data.conditions import noise_floor
from sandbot_model.discovery.criteria import DEFAULT
from sandbot_model.discovery.result import Discovery
from sandbot_model.discovery.sharing import calibrated, in_words
from sandbot_model.discovery.verdict import leaves_nothing, only_with, p_in_words, p_of_test
from sandbot_model.fitting.fit import Fit, scored
from sandbot_model.fitting.goodness import cells_missed
from sandbot_model.fitting.text import counted, to_error
from sandbot_model.physics.observables import CM
from sandbot_model.physics.variants import Variant
from sandbot_model.report.effect_facts import words
from sandbot_model.report.in_words import condition, estimates

_STYLES = {"adequate": "good", "identified": "good", "untested": "bad"}


def of_discovery(found: Discovery, robot: Robot | None = SANDBOT) -> str:
    """Status and class, each effect in plain words, error before → after → floor, its parameters; then why.

    ``robot`` is the one that the data or an option names; None: SandBot is assumed.
    """
    verdict = found.verdict
    ambiguous = f"ambiguous: one of {len(verdict.alternatives)} sets of effects, these data can't tell which"
    head = f"verdict: {ambiguous if verdict.status == 'ambiguous' else found.headline}"
    head += f", {only_if}" if (only_if := condition(found, robot)) else ""
    lines = [styled(filled(head), _STYLES.get(verdict.status, "open"))]
    named = verdict.effects if verdict.status != "ambiguous" else ()
    lines += [filled(line, "  ") for name in named for line in _effect(name, found.fit)]
    others = dict.fromkeys(name for names in verdict.alternatives for name in names if name not in named)
    lines += [filled(f"{name}: {words(found.fit.model.catalogue[name])}", "  ") for name in others]
    lines.append(filled(errors(found.steps), "  "))
    lines += [filled(f"- {one}", "  ") for one in (found.stability_in_words, *verdict.remarks) if one]
    lines += ["", filled(f"why: {verdict.statistics}")]
    alternatives = [fit for fit in found.fits if fit.effects in verdict.alternatives]
    for fit in alternatives if verdict.status == "ambiguous" else [found.fit]:
        lines += _command_for(fit)
    if found.residual is not None:
        told = found.residual.sentence in verdict.because
        lines += [] if told else ["", filled(f"what is left: {found.residual.sentence}")]
        lines += ["", f"try: compare DATA {found.residual.options}"]
    if verdict.status == "ambiguous" and found.next_trials:
        first = found.next_trials[0]
        ask = f"ask: {counted(first.replicates, first.kind)} at {first.where}, and look at {first.observable}"
        every = sum(trial.replicates for trial in found.next_trials if trial.kind == "trial")
        run = f"; campaign PLAN --plan DISCOVERY.json runs all {every} proposed trials" if every else ""
        lines += ["", filled(f"{ask}{run}")]
    return "\n".join(lines)


def of_comparison(steps: Sequence[Fit]) -> str:
    """Whether the last model fits, and the error before → after → floor."""
    last = steps[-1]
    held = ", ".join(f"{name} = {last.model.parameter(name).with_unit(at)}" for name, at in last.model.held.items())
    named = f"{last.name}{f' at {held} (held)' if held else ''}"
    if not math.isfinite(last.lack_of_fit_p):
        why = f"can't be tested: {last.undetermined or 'replicates, or error bars, are needed'}"
        return "\n".join([styled(filled(f"{named} {why}"), "bad"), filled(errors(steps), "  ")])
    fits = leaves_nothing(last)
    judgement = _explains(last) if fits else _fails(last)
    head = styled(filled(f"{named} {judgement}"), "good" if fits and not only_with(last) else "open")
    effects = [line for name in last.effects for line in _effect(name, last)]
    return "\n".join([head, *(filled(line, "  ") for line in effects), filled(errors(steps), "  ")])


def _explains(fit: Fit) -> str:
    """The statement that a fit explains the data, with the implausible values that it needs, if any."""
    p = f"lack of fit p = {fit.lack_of_fit_p:.2g}"
    if only := only_with(fit):
        return f"explains the data ({p}), but {only}"
    return f"holds: its misfit is within {fit.cells.scatter} ({p})"


def _fails(fit: Fit) -> str:
    missed = cells_missed(fit.fails)
    fails = f"fails: {p_of_test(fit)}, {missed} of {counted(len(fit.cells), 'cell')} missed"
    allowing = calibrated(fit, DEFAULT)
    if allowing is None:
        return fails
    return f"{fails}; allowing for {in_words(allowing, DEFAULT)}, as discover does, it holds {p_in_words(allowing)}"


def _effect(name: str, fit: Fit) -> list[str]:
    """An effect by its name, in plain words, then its fitted parameters."""
    effect = fit.model.catalogue[name]
    none = f"no parameter is fitted: every name in {effect.formula} is a quantity of the model or the robot"
    fitted = [f"{p.name} = {value}, {p.doc}{remark}" for p, value, remark in estimates(name, fit)]
    return [f"{name}: {words(effect)}", *(fitted if effect.parameters else [none])]


def _command_for(fit: Fit) -> list[str]:
    """The ``compare`` command for a fit with an effect under another convention than the catalogue's."""
    variants = [effect for effect in fit.model.effects if isinstance(effect, Variant)]
    if not variants:
        return []
    usual = ",".join(name for name in fit.effects if name not in fit.variants)
    formulas = " ".join(f"--effect '{variant.as_formula}'" for variant in variants)
    options = f"--model {fit.model.base} {f'--effects {usual} ' if usual else ''}{formulas}"
    why = f"compare --effects {','.join(fit.variants)} has the catalogue's convention; the one named is fitted by:"
    return ["", filled(why), f"compare DATA {options}"]


def errors(steps: Sequence[Fit]) -> str:
    """Speed error out of sample, before → after, and the scatter of replicates or the error bars, as far as known."""
    cells = steps[-1].cells
    floor, dof = noise_floor(cells)["speed"], int(cells.pure_error_dof[0])
    ends = (steps[0], *steps[1:][-1:])
    known = {step: step.cv_rmse_m_s for step in ends if math.isfinite(step.cv_rmse_m_s)}
    scattered = math.isfinite(floor) and dof > 0
    # The standard error of an rms of n values is 1/√(2n) of it.
    stderr = CM * (
        floor / math.sqrt(2 * dof) if scattered else min(known.values(), default=0.0) / math.sqrt(2 * cells.trials)
    )
    change = " → ".join(to_error(CM * step.cv_rmse_m_s, stderr) for step in ends)
    parts = [f"speed error out of sample: {change} cm/s{scored(*known)}"] if known else []
    scatter = "error bars of" if cells.error_bars else "replicates scatter by"
    parts += [f"{scatter} {to_error(CM * floor, stderr)} cm/s"] if scattered else []
    return "; ".join(parts) or "neither the error out of sample nor the scatter of replicates is known"
