"""The report: one self-contained HTML page of what was measured, where the model fails and what repairs it.

    write_report(path, discovery, trials, title=…)      the page of ``discover``
    write_comparison(path, fits, trials, title=…)       the page of ``compare``

``view`` is what is shown, ``curves`` adds the model curves; ``figures``, ``mechanics`` and ``balance`` draw,
``captions`` says how to read a figure and what it shows, ``content`` puts the sections together, ``page`` renders.
"""

from collections.abc import Sequence
from pathlib import Path

from sandbot_model.discovery.discover import Discovery
from sandbot_model.fitting.fit import Fit
from sandbot_model.report import page
from sandbot_model.report.content import Frames, comparison_page, discovery_page
from sandbot_model.report.curves import steps
from sandbot_model.report.provenance import bags_of, lost_bags, provenance
from sandbot_record.trials.table import Trials


def write_report(
    path: Path,
    discovery: Discovery,
    trials: Trials,
    *,
    title: str,
    frames: Frames = (),
    truth_line: str | None = None,
    data: Sequence[Path] = (),
) -> None:
    """Write the page of a discovery to ``path``, whole or not at all.

    ``frames`` are (JPEG or PNG bytes, caption) of tracked video; ``truth_line`` says, for a blind campaign of the
    virtual lab, whether the sealed truth agrees. Recordings in ``data`` that gave no trial are listed with the reason.
    """
    content = discovery_page(
        discovery,
        steps(discovery.steps),
        provenance(trials, discovery.cells, lost_bags(bags_of(data), trials)),
        title=title,
        trials=trials,
        frames=frames,
        truth_line=truth_line,
    )
    page.write(path, content)


def write_comparison(
    path: Path, fits: Sequence[Fit], trials: Trials, *, title: str, frames: Frames = (), data: Sequence[Path] = ()
) -> None:
    """Write the page of one or more fits to the same trials, in the order given, whole or not at all.

    ``frames`` and ``data`` as in ``write_report``.
    """
    known = provenance(trials, fits[0].cells, lost_bags(bags_of(data), trials))
    page.write(path, comparison_page(steps(fits), known, title=title, frames=frames))
