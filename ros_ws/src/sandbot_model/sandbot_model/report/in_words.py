"""A verdict in plain words: what it says, how sure it is and what to do next; what each effect that it names does."""

import re
from collections.abc import Iterable, Iterator

from sandbot_common.robot import Robot
from sandbot_model.data.conditions import level_name
from sandbot_model.discovery.plausibility import doubts, in_doubt
from sandbot_model.discovery.result import Discovery
from sandbot_model.discovery.verdict import INCOMPLETE
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.text import NO_ERROR, UNDETERMINED, counted
from sandbot_model.physics.effect import Parameter
from sandbot_model.physics.gait import ASSUMED, assumption
from sandbot_model.report.view import observable_label, readable

MOST_REPEATED = 3
"""Conditions that are asked for again where nothing explains the data."""


def estimates(name: str, fit: Fit) -> Iterator[tuple[Parameter, str, str]]:
    """The parameters of an effect that the data determine: each, its value ± error with the unit, and a remark on a
    missing error."""
    remark = "" if fit.errors_hold else f"; {NO_ERROR}"
    for parameter in fit.model.catalogue[name].parameters:
        estimate = fit.parameters.get(f"{name}.{parameter.name}")
        if estimate and (value := fit.value_text(*estimate)) != UNDETERMINED:
            yield parameter, f"{value}{'' if parameter.unit == '1' else f' {parameter.unit}'}", remark


def named_sets(found: Discovery) -> tuple[tuple[tuple[str, ...], Fit | None], ...]:
    """The sets of effects that a verdict names, each with its fit: all of an ambiguous one, which are equal; none if no
    effect is named. The fit is None where only the names are known."""
    verdict = found.verdict
    fits = {fit.effects: fit for fit in reversed((found.fit, *found.fits))}
    if verdict.status == "ambiguous":
        return tuple((names, fits.get(names)) for names in verdict.alternatives)
    return ((verdict.effects, found.fit),) if verdict.effects else ()


def steps_shown(found: Discovery) -> tuple[Fit, ...]:
    """The ladder; of an ambiguous verdict the base model, then each of the sets that the data can't tell apart."""
    if found.verdict.status != "ambiguous":
        return found.steps
    return found.steps[0], *(fit for _, fit in named_sets(found) if fit is not None)


def condition(found: Discovery, robot: Robot | None) -> str:
    """The condition of a verdict where nothing says which robot walked, or in which gait; else empty.

    A wrong one is as likely a reason as missing physics for what is left, and moves what is claimed.
    """
    robots = ["the robot was SandBot"] if robot is None else []
    taken = robots + ([f"the gait was {ASSUMED}"] if assumption(found.cells.gait) else [])
    return f"if {' and '.join(taken)}, which is assumed" if taken and found.verdict.status != "untested" else ""


def in_three_sentences(found: Discovery, robot: Robot | None) -> str:
    """What the verdict is, how sure, and what to do next; without a statistic."""
    only_if = condition(found, robot)
    what = f"{only_if}, {_what(found)}" if only_if else _what(found)
    return " ".join(f"{sentence[:1].upper()}{sentence[1:]}." for sentence in (what, _how_sure(found), _next(found)))


def _what(found: Discovery) -> str:
    base = f"the {found.fit.model.base} model"
    sets = [" + ".join(map(readable, names)) for names in found.verdict.alternatives]
    return {
        "adequate": f"{base} explains these data, and no effect of the catalogue improves it enough to be claimed",
        "identified": f"{base} lacks {' or '.join(sets)}, and with it explains these data",
        "ambiguous": f"{base} lacks something: {' or '.join(sets)} would explain these data",
        "partial": f"{base} lacks {' or '.join(sets)}, which explains most of what it misses, but not all",
        "unexplained": f"{base} is not confirmed, and nothing in the catalogue is claimed to explain what it misses",
        "untested": f"these data can't tell whether {base} is right",
    }[found.verdict.status]


def _how_sure(found: Discovery) -> str:
    return {
        "adequate": f"{counted(len(found.unseen), 'effect')} may still be present without showing in these data"
        if found.unseen
        else "an effect of its usual strength would have shown",
        "identified": _next_to(found),
        "ambiguous": "these data can't tell which",
        "partial": "this effect is not in doubt, but something else is missing too",
        "unexplained": "only the effects that were tried are ruled out; the true one may be another",
        "untested": "a good fit proves nothing here",
    }[found.verdict.status]


def _next_to(found: Discovery) -> str:
    if not found.alike:
        return "every other explanation that was tried fits clearly worse or takes implausible values"
    alike = " and ".join(dict.fromkeys(" + ".join(map(readable, fit.effects)) for fit in found.alike))
    return (
        "every other effect, in the catalogue's form, fits clearly worse or takes implausible values; in another form "
        f"{alike} would fit as well"
    )


def _next(found: Discovery) -> str:
    if found.next_trials:
        first = found.next_trials[0]
        times = counted(first.replicates, first.kind)
        return f"next: {times} at {first.where}, watching {observable_label(first.observable)} (all under Next trials)"
    if found.controls:
        return "next: an experiment of another kind (under Next trials)"
    if found.residual is not None:
        return "next: try the formula given under What the catalogue does not explain"
    controls = (found.fit.model.catalogue[name].control for name in found.verdict.effects)
    if told := "; ".join(filter(None, controls)):
        return f"to confirm it, {told}"
    return "no further measurement is proposed"


def no_trial(found: Discovery) -> str:
    """Why no trial is proposed and, where nothing explains the data, what to do instead."""
    if found.next_trials:
        return "no trial is proposed: only a penetrometer would show the difference"
    if found.verdict.status not in INCOMPLETE:
        return "no trial is proposed: none is needed, or none within reach would help"
    if in_doubt(found.cells):
        measure = "measure the robot's legs first, and give robot.yaml with them"
        split = "give the trials of each robot or set-up as a table of its own first"
        return f"no trial is proposed: {measure if doubts(found.cells) else split}"
    fails = next((fit.fails for fit in (*found.fits[:1], found.fit) if fit.fails), ())
    missed = [f"φ {level_name(found.cells, fail.cell)}, ω {fail.omega_rad_s:.3g} rad/s" for fail in fails]
    where = [*dict.fromkeys(missed)][:MOST_REPEATED]
    again = f"; repeat on another day what is missed most ({'; '.join(where)})" if where else ""
    lift = "" if "lift" in found.cells.observables else "; measure the lift, which names most effects"
    return f"no trial is proposed: trials decide between explanations, and none holds{again}{lift}"


def spelled_out(sentence: str, effects: Iterable[str]) -> str:
    """The sentence with these effects as the report writes them: ``leg_slip`` → ``leg slip``."""
    known = set(effects)
    return re.sub(r"\w+", lambda word: readable(word[0]) if word[0] in known else word[0], sentence)
