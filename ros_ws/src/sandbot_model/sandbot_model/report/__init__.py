"""The report: one self-contained HTML page of what was measured, where the model fails, and which effects explain it.

    write_report(path, discovery, trials, title=…)      the page of ``discover``
    write_comparison(path, fits, trials, title=…)       the page of ``compare``

writer     writes the file; page: renders sections as HTML; content: puts the sections in order
argument   the argument for a verdict, one figure per step
sections   figure_sections, table_sections, data_section, atlas_section, model_difference, and supplement:
           the origin of the trials and the methods
figures    for the page (Plotly): speed, lift and errors; print_figures: for print (Matplotlib)
  of a model      mechanics, balance, lock, stages; profiles: of its parameters; rivals: several models
  over φ × ω      residual_map, fingerprint_map; map_text: labels on cells
  of trials       run_order, waveforms; provenance: which are used
captions   how to read each figure; text: numbers for readers
atlas      the paper's figures
view       the data shown; curves: with the models'; effect_facts, drawings: an effect in words and as a drawing;
           in_words: a verdict and the effects that it names
theme      colours and layout
"""

from typing import TYPE_CHECKING

from sandbot_common.lazy import attach

if TYPE_CHECKING:
    from sandbot_model.report.writer import write_comparison, write_report

__all__ = ("write_comparison", "write_report")

# Imported lazily: printing a verdict must not load the plotting and bag-reading libraries.
_MODULES = {"write_report": ".writer", "write_comparison": ".writer"}
__getattr__, __dir__ = attach(__name__, _MODULES)
