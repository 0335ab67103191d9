"""README's first picture, Figs 1e and 2a with the paper's effect off and on: ``python tools/headline.py runs/demo``."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting.fit import fit
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_model.physics.observables import CM
from sandbot_model.report.atlas.collect import collect
from sandbot_model.report.atlas.speeds import omega_panel, phi_panel
from sandbot_model.report.atlas.style import MM_PER_INCH, typography
from sandbot_model.report.print_figures import matplotlib
from sandbot_record.trials.read import read

OUT = Path(__file__).resolve().parent.parent / "docs" / "images" / "discovery.png"
WIDTH_MM, HEIGHT_MM, DPI = 178.0, 140.0, 200
OFF, ON = ("slow_phase_speed", "belly_coast"), ("slow_phase_speed", "belly_coast", "disturbed_ground")


def main(data: Path) -> int:
    """Fit without and with disturbed ground, and draw both side by side."""
    trials = read(data)
    cells = cells_of(trials.select(trials.usable))
    fits = [fit(model_of("simple", names, catalogue(), cells.robot), cells) for names in (OFF, ON)]
    with typography():
        figure = matplotlib("headline")[1](
            figsize=(WIDTH_MM / MM_PER_INCH, HEIGHT_MM / MM_PER_INCH), layout="constrained"
        )
        panels = figure.subplots(2, 2, sharey=True)
        drawn = collect(trials, fits[:1], {})
        for column, (found, words) in zip(panels.T, zip(fits, ("without", "with"), strict=True), strict=True):
            material = replace(drawn, fits=(found,))
            phi_panel(column[0], material, loc="upper left")
            omega_panel(column[1], material)
            column[0].set_title(f"{words} disturbed ground: error {CM * found.cv_rmse_m_s:.1f} cm/s out of sample")
        for panel in np.ravel(panels):
            panel.spines[["top", "right"]].set_visible(False)
        for panel in panels[:, 1]:
            panel.set_ylabel("")
            panel.get_legend().remove()
        top = 1.1 * CM * float(np.nanmax(trials.speed_m_s))
        panels[0, 0].set_ylim(0, top)
        figure.savefig(OUT, dpi=DPI)
    return 0


if __name__ == "__main__":
    raise SystemExit(main(Path(sys.argv[1])))
