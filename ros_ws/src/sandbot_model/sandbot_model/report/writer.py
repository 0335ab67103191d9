"""Assembles and writes the page of a discovery or of fits."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from sandbot_model.discovery.criteria import Criteria
from sandbot_model.discovery.result import Discovery
from sandbot_model.fitting.fit import Fit
from sandbot_model.report import atlas_section, page, supplement
from sandbot_model.report.content import comparison_page, discovery_page
from sandbot_model.report.curves import steps
from sandbot_model.report.in_words import steps_shown
from sandbot_model.report.provenance import bags_of, lost_bags, provenance
from sandbot_model.report.table_sections import Frames
from sandbot_record.trials.table import Trials


def write_report(
    path: Path,
    discovery: Discovery,
    trials: Trials,
    *,
    title: str,
    frames: Frames = (),
    data: Sequence[Path] = (),
    command: str = "",
) -> None:
    """Write the page of a discovery to ``path``, atomically.

    ``frames`` are (JPEG or PNG bytes, caption) of tracked video. Recordings in ``data`` that yielded no trial are
    listed with the reason. ``command`` is the command line as typed.
    """
    of_steps = partial(discovery_page, discovery, trials=trials, title=title, frames=frames)
    page.write(path, _page(of_steps, steps_shown(discovery), trials, data, command, discovery.criteria))


def write_comparison(
    path: Path,
    fits: Sequence[Fit],
    trials: Trials,
    *,
    title: str,
    frames: Frames = (),
    data: Sequence[Path] = (),
    command: str = "",
) -> None:
    """Write the page of one or more fits to the same trials, in the order given, atomically.

    ``frames``, ``data`` and ``command`` as in ``write_report``.
    """
    of_steps = partial(comparison_page, title=title, frames=frames)
    page.write(path, _page(of_steps, fits, trials, data, command))


def _page(
    of_steps: Callable[..., page.Page],
    fits: Sequence[Fit],
    trials: Trials,
    data: Sequence[Path],
    command: str,
    criteria: Criteria | None = None,
) -> page.Page:
    """The page that ``of_steps`` makes of fits, where their trials come from, and what pages of all fits have."""
    bags, shown, cells = bags_of(data), steps(fits), fits[0].cells
    return of_steps(
        shown,
        provenance(trials, cells, lost_bags(bags, trials)),
        opening=(supplement.origin(trials, cells, bags, command, criteria), supplement.methods(shown, criteria)),
        atlas=atlas_section.sections(trials, fits, bags),
    )
