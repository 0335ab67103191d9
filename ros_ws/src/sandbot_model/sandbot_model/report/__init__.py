"""The report: one self-contained HTML page of what was measured, where the model fails and what repairs it.

    write_report(path, discovery, trials, title=…)      the page of ``discover``
    write_comparison(path, fits, trials, title=…)       the page of ``compare``

``view`` is what is shown, ``curves`` adds the model curves; ``figures``, ``mechanics`` and ``balance`` draw,
``captions`` says how to read a figure and what it shows, ``supplement`` where the trials come from and how they were
analysed, ``atlas`` draws the paper's figures, ``content`` puts the sections together, ``page`` renders and ``written``
writes the file.
"""

from typing import TYPE_CHECKING

from sandbot_common.lazy import door

if TYPE_CHECKING:
    from sandbot_model.report.written import write_comparison, write_report

__all__ = ("write_comparison", "write_report")

# What draws figures and reads bags is loaded for a page, not for the words of a verdict.
_HOME = {"write_report": ".written", "write_comparison": ".written"}
__getattr__, __dir__ = door(__name__, _HOME)
