"""What a verdict names, in plain words: what each effect does, and its fitted parameters."""

import re
from collections.abc import Iterable, Iterator

from sandbot_common.robot import Robot
from sandbot_model.discovery.discover import Discovery
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.text import NO_ERROR, UNDETERMINED
from sandbot_model.physics.effect import Parameter
from sandbot_model.physics.gait import ASSUMED, assumption
from sandbot_model.report.view import readable


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


def spelled_out(sentence: str, effects: Iterable[str]) -> str:
    """The sentence with these effects as the report writes them: ``leg_slip`` → ``leg slip``."""
    known = set(effects)
    return re.sub(r"\w+", lambda word: readable(word[0]) if word[0] in known else word[0], sentence)
