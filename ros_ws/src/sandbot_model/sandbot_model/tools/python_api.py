"""The Python API: ``discover`` and ``compare`` on any data, with results that print and draw themselves.

    import sandbot_model as sm
    found = sm.discover("table.csv")
    found                                     # verdict, ladder, parameters
    found.fit.to_frame(); found.plot()
    sm.compare("runs/demo", effects=["stance_overlap"]).plot()

No ROS is needed in the process. What can't be used raises InputError, one line that names the argument.
"""

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from sandbot_common import files
from sandbot_common.data_frame import data_frame
from sandbot_common.errors import InputError
from sandbot_common.parallel import Processes
from sandbot_common.robot import Robot, read_robot
from sandbot_common.typed import check_types
from sandbot_model.data.conditions import cells_of
from sandbot_model.data.penetrometer import Readings, read_readings
from sandbot_model.data.quality import checked
from sandbot_model.discovery import compare as comparing
from sandbot_model.discovery import discover as discovering
from sandbot_model.discovery.assumed import assumed
from sandbot_model.discovery.compare import Comparison
from sandbot_model.discovery.criteria import DEFAULT, Criteria
from sandbot_model.discovery.each_gait import judged_by_gait
from sandbot_model.discovery.next_trials import NextTrial
from sandbot_model.discovery.other_gait import tried_with_other_gaits
from sandbot_model.discovery.result import Discovery
from sandbot_model.discovery.selection import name_of
from sandbot_model.discovery.verdict import Verdict
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.goodness import cells_missed
from sandbot_model.fitting.parallel import Progress
from sandbot_model.fitting.text import WIDTH
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.walking import BASES
from sandbot_model.report import print_figures, write_comparison, write_report
from sandbot_model.report.curves import steps as with_curves
from sandbot_model.tools import arguments
from sandbot_record.trials.frame import from_frame, is_frame
from sandbot_record.trials.read import read
from sandbot_record.trials.table import Trials

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

    Data: TypeAlias = str | Path | Sequence[str | Path] | DataFrame | Trials
    """A campaign folder, bags, a trials CSV (or several of them), a DataFrame with its columns, or ``Trials``."""

Paths = str | Path | Sequence[str | Path]


@dataclass(frozen=True, repr=False)
class Result:
    """What ``discover`` and ``compare`` return: a ladder of fits that prints, draws and reports itself."""

    content: Discovery | Comparison
    """The full result."""
    trials: Trials
    notes: tuple[str, ...] = ()
    """What is assumed about the robot and the gait, and what is suspicious about the trials, one sentence each."""

    @property
    def steps(self) -> tuple[Fit, ...]:
        """The ladder: the base model, then one more effect per step."""
        return tuple(self.content.steps)

    @property
    def fit(self) -> Fit:
        """The last step of the ladder."""
        return self.steps[-1]

    def to_frame(self) -> "DataFrame":
        """The ladder [SI], one row for each step: errors of mean speed, and the fit to all observables.

        Raises InputError where pandas is not installed.
        """
        rows = [
            {
                "model": step.name,
                "rmse_m_s": step.rmse_m_s,
                "cv_rmse_m_s": step.cv_rmse_m_s,
                "cv_cells": step.cross_validation.cells,
                "deviance": step.deviance,
                "dof": step.goodness.dof,
                "bic": step.bic,
                "lack_of_fit_p": step.lack_of_fit_p,
                "cells_missed": cells_missed(step.fails),
            }
            for step in self.steps
        ]
        return data_frame(rows, "to_dict()").set_index("model")

    def to_dict(self) -> dict[str, Any]:
        """Plain data: what the command writes with ``--json``."""
        content = self.content.to_dict()
        content["data"]["notes"] = list(self.notes)
        return content

    def report(self, path: str | Path, *, title: str = "trackway") -> Path:
        """Write the self-contained report and return its path. Raises InputError if it can't be written."""
        with files.writing(out := Path(path)):
            if isinstance(self.content, Discovery):
                write_report(out, self.content, self.trials, title=title)
            else:
                write_comparison(out, self.steps, self.trials, title=title)
        return out

    def plot(self) -> "Figure":
        """Mean speed against ω at every φ: measured, the base model, and the last step's model."""
        return print_figures.speed(with_curves(list(dict.fromkeys((self.steps[0], self.fit)))))

    def __repr__(self) -> str:
        return "\n".join([*(textwrap.fill(f"note: {note}", WIDTH) for note in self.notes), repr(self.content)])

    def _repr_html_(self) -> str:
        return "".join([*(f"<p>Note: {escape(note)}</p>" for note in self.notes), self.content._repr_html_()])


class Found(Result):
    """What ``discover`` found; ``fit`` is the model with the effects the verdict names."""

    content: Discovery

    @property
    def verdict(self) -> Verdict:
        """Status, the effects named, the alternatives, and why."""
        return self.content.verdict

    @property
    def next_trials(self) -> tuple[NextTrial, ...]:
        """What to measure next, the most informative first."""
        return self.content.next_trials


class Compared(Result):
    """What ``compare`` fitted; ``fit`` is the model with all effects asked for."""

    content: Comparison


def discover(
    data: "Data",
    *,
    model: str = "simple",
    max_effects: int = 3,
    effects_from: Paths = (),
    formulas: Sequence[str] = (),
    penetrometer: str | Path | None = None,
    robot: str | Path | Robot | None = None,
    criteria: Criteria = DEFAULT,
    workers: int = 1,
    progress: Progress = lambda _stage, _done, _total: None,
) -> Found:
    """Which effect of the catalogue the model lacks, or that none is missing, or which can't be told apart.

    ``data`` is a campaign folder, bags, a trials CSV (or several), a DataFrame with its columns, or ``Trials``.
    ``effects_from`` are Python files with effects of your own, ``formulas`` effects as a line of text,
    ``penetrometer`` a CSV of readings, ``robot`` a robot.yaml or a ``Robot`` (by default the data's own, else SandBot).
    ``criteria`` say what it takes to claim an effect. ``workers`` processes fit at once; ``progress`` hears (stage,
    done, total). Raises InputError that names the argument.
    """
    check_types(discover, locals())
    if workers < 1:
        raise InputError(f"workers: {workers}; at least one process is needed")
    if max_effects < 0:
        raise InputError(f"max_effects: {max_effects}; 0 or more are needed")
    effects = _catalogue(model, effects_from, formulas)
    trials = _trials(data, robot)
    notes = checked(trials, "data")
    readings = _readings(penetrometer)
    cells = cells_of(trials, readings)
    with Processes(workers).map() as fit_all:
        found = discovering.discover(
            cells, effects, base=model, max_effects=max_effects, criteria=criteria, fit_all=fit_all, progress=progress
        )
        found = judged_by_gait(found, trials, effects, readings, max_effects=max_effects, fit_all=fit_all)
    found = tried_with_other_gaits(found, trials, readings)
    return Found(found, trials, (*assumed(trials, cells, criteria), *notes, *cells.notes))


def compare(
    data: "Data",
    effects: Sequence[str] = (),
    *,
    model: str = "simple",
    effects_from: Paths = (),
    formulas: Sequence[str] = (),
    penetrometer: str | Path | None = None,
    robot: str | Path | Robot | None = None,
) -> Compared:
    """The base model, then one more of the named ``effects`` per step, fitted to ``data``; else as ``discover``.

    ``formulas`` that are not named come last.
    """
    check_types(compare, locals())
    catalogue = _catalogue(model, effects_from, formulas)
    trials = _trials(data, robot)
    notes = checked(trials, "data")
    names = [*effects, *(name for name in map(name_of, formulas) if name not in effects)]
    cells = cells_of(trials, _readings(penetrometer))
    found = comparing.compare(cells, catalogue, names, base=model)
    return Compared(found, trials, (*assumed(trials, cells), *notes, *cells.notes))


def _catalogue(model: str, effects_from: Paths, formulas: Sequence[str]) -> Mapping[str, Effect]:
    if model not in BASES:
        raise InputError(f"model: {model!r} is not one of {', '.join(BASES)}")
    files = [effects_from] if isinstance(effects_from, str | Path) else effects_from
    try:
        return catalogue([Path(file) for file in files], formulas)
    except InputError as error:
        raise InputError(str(error).replace("--effect ", "formulas: ", 1)) from None


def _trials(data: "Data", robot: str | Path | Robot | None) -> Trials:
    try:
        found = _read(data)
    except InputError as error:
        raise InputError(f"data: {str(error).removeprefix('data: ')}") from None
    if robot is None:
        return found
    return arguments.of_robot(found, robot if isinstance(robot, Robot) else read_robot(Path(robot)), "robot")[0]


def _read(data: "Data") -> Trials:
    if isinstance(data, Trials):
        return data
    if is_frame(data):
        return from_frame(data)
    several = isinstance(data, Sequence) and all(isinstance(part, str | Path) for part in data)
    if not (isinstance(data, str | Path) or several):
        raise InputError(f"{type(data).__name__}; a path, several paths, a DataFrame or Trials is needed")
    return read(data)


def _readings(penetrometer: str | Path | None) -> Readings | None:
    return None if penetrometer is None else read_readings(Path(penetrometer))
