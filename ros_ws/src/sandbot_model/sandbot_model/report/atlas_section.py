"""The paper's figures, drawn from the trials of the report, as a section in the order of the atlas."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from sandbot_common.errors import InputError
from sandbot_model.fitting.fit import Fit
from sandbot_model.report.atlas.collect import collect
from sandbot_model.report.atlas.material import ONE_COLUMN_MM
from sandbot_model.report.atlas.plates import PLATES, as_svg
from sandbot_model.report.page import Picture, Section, data_uri
from sandbot_model.report.view import frequencies
from sandbot_record.trials.table import Trials

HEADING = "The figures of Li et al. 2009 from these trials"


def sections(trials: Trials, fits: Sequence[Fit], bags: Mapping[str, Path]) -> list[Section]:
    """Every plate possible with these data, and a line on those that are not; no section for a single φ or ω."""
    cells = fits[0].cells
    if min(len(cells.level_phi), len(frequencies(cells)[0])) < 2:
        return []
    material = collect(trials, fits, bags)
    pictures, missing = [], []
    for plate in PLATES:
        try:
            content, caption = as_svg(plate, material)
        except InputError as error:
            missing.append(f"{plate.number}: {error}")
        else:
            caption, wide = f"Fig. {plate.number} of the paper. {caption}", plate.width_mm > ONE_COLUMN_MM
            pictures.append(Picture(data_uri(content, "image/svg+xml"), caption, wide))
    lines = (f"Not drawn: {'; '.join(missing)}.",) if missing else ()
    return [Section("atlas", HEADING, text=lines, pictures=tuple(pictures))]
