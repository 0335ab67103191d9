"""The plates of the atlas in reading order: the figure of the paper's title result first."""

import io
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from sandbot_common.errors import InputError
from sandbot_common.files import write_json, writing
from sandbot_common.parallel import Map
from sandbot_model.report.atlas import collapse, force, leg, motion, speeds
from sandbot_model.report.atlas.material import ONE_COLUMN_MM, TWO_COLUMNS_MM, Material, Plate
from sandbot_model.report.atlas.style import typography

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PLATES = (
    Plate("1e", "fig1e_speed_phi", ONE_COLUMN_MM, speeds.against_phi),
    Plate("2a", "fig2a_speed_omega", ONE_COLUMN_MM, speeds.against_omega),
    Plate("2bc", "fig2bc_critical", TWO_COLUMNS_MM, collapse.critical),
    Plate("1c", "fig1c_leg_angle", ONE_COLUMN_MM, motion.angles),
    Plate("1d", "fig1d_speed_time", ONE_COLUMN_MM, motion.speeds),
    Plate("3a", "fig3a_leg", ONE_COLUMN_MM, leg.in_the_ground),
    Plate("3b", "fig3b_step_depth", ONE_COLUMN_MM, leg.step_against_depth),
    Plate("3c", "fig3c_force", ONE_COLUMN_MM, force.force),
    Plate("3d", "fig3d_step_omega", ONE_COLUMN_MM, collapse.step_over_radius),
    Plate("4a", "fig4a_full_force", ONE_COLUMN_MM, force.dimensionless),
    Plate("4b", "fig4b_simple_full", ONE_COLUMN_MM, speeds.simple_and_full),
)
FORMATS = ("pdf", "svg", "png")
PNG_DPI = 300
CAPTIONS = "captions.json"


def _save(figure: "Figure", stem: Path, formats: tuple[str, ...]) -> None:
    for kind in formats:
        path = stem.with_suffix(f".{kind}")
        with writing(path):
            figure.savefig(path, dpi=PNG_DPI, metadata={"CreationDate": None} if kind == "pdf" else None)
        # The layout is fixed after the first save, so that all formats are the same.
        figure.set_layout_engine("none")


def as_svg(plate: Plate, material: Material) -> tuple[bytes, str]:
    """One plate in memory, at its own width, and its caption. Raises InputError where these data do not allow it."""
    content = io.BytesIO()
    with typography():
        figure, caption = plate.draw(material, plate.width_mm)
        figure.savefig(content, format="svg", metadata={"Date": None})
    return content.getvalue(), caption


def write(
    folder: Path,
    material: Material,
    width_mm: float | None = None,
    formats: tuple[str, ...] = FORMATS,
    draw_all: Map = map,
) -> Iterator[tuple[Plate, str]]:
    """Draw the plates into a folder; yields each with its caption, or with the reason why it was not drawn.

    ``width_mm`` overrides the plates' own widths. The captions are written at the end. Raises InputError where the
    folder can't be written.
    """
    captions = {}
    found = draw_all(partial(_drawn, folder, material, width_mm, formats), PLATES)
    for plate, (caption, drawn) in zip(PLATES, found, strict=True):
        if drawn:
            captions[plate.stem] = {"figure": plate.number, "caption": caption}
        yield plate, caption
    write_json(folder / CAPTIONS, captions)


def _drawn(
    folder: Path, material: Material, width_mm: float | None, formats: tuple[str, ...], plate: Plate
) -> tuple[str, bool]:
    """(caption, True) of a plate that was drawn, (reason, False) of one that was not."""
    with typography():
        try:
            figure, caption = plate.draw(material, width_mm or plate.width_mm)
        except InputError as error:
            return f"not drawn: {error}", False
        _save(figure, folder / plate.stem, formats)
    return caption, True
