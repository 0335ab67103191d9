"""The trials of a cell on the page: a table, waveforms with the model's, tracked video, links to bags."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any
from urllib.parse import quote

from dash import html

from sandbot_common.errors import InputError
from sandbot_model.explore import blocks
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.observables import CM, Observable
from sandbot_model.report import waveforms
from sandbot_model.report.theme import Theme
from sandbot_record.trials import film_strip
from sandbot_record.trials.cache import file_state
from sandbot_record.trials.table import Trials

COLUMNS = (
    ("φ", "phi", 1.0),
    ("ω (rad/s)", "omega_rad_s", 1.0),
    *((observable.heading, observable.column, CM) for observable in Observable),
    ("status", "status", 1.0),
)
"""(heading, column of the trials table, factor from SI to the heading's unit)."""


def parts(trials: Trials, bags: Mapping[str, Path], fit: Fit, cell: int, theme: Theme, query: str = "") -> list[Any]:
    """Everything known about the trials of one cell, and a line for each item that is missing."""
    rows = waveforms.trials_of(trials, fit.cells, cell)
    ids = [str(trials.trial_id[i]) for i in rows]
    lines = [
        [
            link(name, bags),
            *watch(name, bags, query),
            *(_cell(getattr(trials, column)[row], scale) for _, column, scale in COLUMNS),
        ]
        for name, row in zip(ids, rows, strict=True)
    ]
    head = ["trial", *(["legs and film"] if bags else []), *(heading for heading, _, _ in COLUMNS)]
    shown: list[Any] = [blocks.table("Trials of this condition", head, lines)]
    found, missing = waveforms.read(bags, ids)
    if found:
        figure = waveforms.figure(found, fit, cell, theme)
        shown.append(blocks.plot("waveforms", figure, caption=waveforms.caption(found, fit, cell)))
        shown += film(bags, [trial.trial_id for trial in found])
    return [*shown, *(html.P(line, className="soft") for line in missing)]


def film(bags: Mapping[str, Path], ids: Sequence[str]) -> list[Any]:
    """Tracked video of the first trial with stored frames, or a line that there is none."""
    for name in ids:
        try:
            if strip := film_of(bags[name], file_state(bags[name])):
                return [html.H3(f"Lateral video of {name}, tracked axles marked"), blocks.film(strip)]
        except InputError as error:
            return [html.P(f"Video of {name}: {error}", className="soft")]
    return [html.P("No video: the camera frames of these trials were not kept.", className="soft")]


def link(trial_id: str, bags: Mapping[str, Path]) -> Any:
    """The trial's name, as a link to its recording where there is one (see ``Explorer.send_bag``)."""
    names = list(waveforms.files_of(bags[trial_id])) if trial_id in bags else []
    if not names:
        return trial_id
    where = f"/bag/{quote(trial_id)}/{quote(names[0])}"
    return html.A(trial_id, href=where, title=f"save the recording {bags[trial_id]}", download=names[0])


def watch(trial_id: str, bags: Mapping[str, Path], query: str) -> list[Any]:
    """A table entry with the link to the trial's ``/trial`` page; blank if only other trials have bags."""
    if trial_id not in bags:
        return [""] if bags else []
    address = f"/trial?trial={quote(trial_id)}{query.replace('?', '&')}"
    return [html.A("watch", href=address, **{"aria-label": f"watch {trial_id}"})]


def _cell(value: Any, scale: float) -> str:
    if isinstance(value, float):
        return f"{scale * value:.4g}" if value == value else "–"
    return str(value)


@lru_cache(maxsize=16)
def film_of(bag: Path, _state: str) -> tuple[tuple[bytes, str], ...]:
    """Tracked lateral frames of one bag as (JPEG, caption); empty if no frames were stored. Raises InputError."""
    return tuple(film_strip.of_bag(bag))
