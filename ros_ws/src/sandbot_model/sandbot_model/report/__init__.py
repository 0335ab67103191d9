"""The report: one self-contained HTML page of what was measured, where the model fails, and which effects explain it.

    write_report(path, discovery, trials, title=…)      the page of ``discover``
    write_comparison(path, fits, trials, title=…)       the page of ``compare``

``view`` holds the data shown and ``curves`` adds the model curves; ``figures``, ``mechanics`` and ``balance`` draw;
``captions`` explains each figure; ``supplement`` describes the origin of the trials and the methods; ``atlas`` draws
the paper's figures; ``content`` assembles the sections, ``page`` renders them and ``writer`` writes the file.
"""

from typing import TYPE_CHECKING

from sandbot_common.lazy import door

if TYPE_CHECKING:
    from sandbot_model.report.writer import write_comparison, write_report

__all__ = ("write_comparison", "write_report")

# Imported lazily: printing a verdict must not load the plotting and bag-reading libraries.
_HOME = {"write_report": ".writer", "write_comparison": ".writer"}
__getattr__, __dir__ = door(__name__, _HOME)
