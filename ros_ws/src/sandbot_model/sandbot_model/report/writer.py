"""Assembles and writes the page of a discovery or of fits."""

from collections.abc import Sequence
from pathlib import Path

from sandbot_model.discovery.discover import Discovery
from sandbot_model.fitting.fit import Fit
from sandbot_model.report import atlas_section, page, supplement
from sandbot_model.report.content import comparison_page, discovery_page
from sandbot_model.report.curves import steps
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
    bags = bags_of(data)
    shown = steps(discovery.steps)
    methods = supplement.methods(shown, discovery.criteria)
    content = discovery_page(
        discovery,
        shown,
        provenance(trials, discovery.cells, lost_bags(bags, trials)),
        title=title,
        trials=trials,
        frames=frames,
        opening=(supplement.origin(trials, discovery.cells, bags, command), methods),
        atlas=atlas_section.sections(trials, discovery.steps, bags),
    )
    page.write(path, content)


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
    bags, shown = bags_of(data), steps(fits)
    content = comparison_page(
        shown,
        provenance(trials, fits[0].cells, lost_bags(bags, trials)),
        title=title,
        frames=frames,
        opening=(supplement.origin(trials, fits[0].cells, bags, command), supplement.methods(shown)),
        atlas=atlas_section.sections(trials, fits, bags),
    )
    page.write(path, content)
