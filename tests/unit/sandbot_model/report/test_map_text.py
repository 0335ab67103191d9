"""Words on a map can be read on every colour it has."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_model.report.map_text import BLACK, WHITE, cell_labels, colour_at, contrast, ink
from sandbot_model.report.theme import DARK, LIGHT

THEMES = st.sampled_from([LIGHT, DARK])
READABLE = 4.5
"""Of text of this size (WCAG 2.2, 1.4.3)."""


def heat(theme, z=((0.0,),)):
    scale = theme.residual_scale()
    return {"x": ["4"] * len(z[0]), "y": ["φ"] * len(z), "z": z, "zmin": -8.0, "zmax": 8.0, "colorscale": scale}


@given(THEMES, st.one_of(st.none(), st.floats(-20, 20)))
def test_words_stand_out_from_every_colour(theme, value):
    colour = theme.empty if value is None else colour_at(value, heat(theme))
    assert contrast(ink(value, heat(theme), theme), colour) >= READABLE


@pytest.mark.parametrize("theme", [LIGHT, DARK])
def test_one_ink_would_not_do_for_all(theme):
    """The other way round: black alone and white alone fail somewhere on the scale."""
    for one in (BLACK, WHITE):
        assert min(contrast(one, colour_at(value, heat(theme))) for value in (-8.0, 0.0, 8.0)) < READABLE


def test_the_scale_is_plotlys():
    below, equal, above = LIGHT.diverging
    assert [colour_at(value, heat(LIGHT)) for value in (-9.0, 0.0, 8.0)] == [below, equal, above]
    assert contrast(BLACK, WHITE) == pytest.approx(21.0)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.01)


def test_cells_without_words_have_none():
    drawn = cell_labels(heat(LIGHT, [[-8.0, 1.0, None]]), [["▼ 9", "", "–"]], LIGHT)
    assert (drawn["text"], drawn["x"]) == (["▼ 9", "–"], ["4", "4"])
    assert drawn["hoverinfo"] == "skip"
    assert cell_labels(heat(LIGHT), [[""]], LIGHT)["text"] == []
