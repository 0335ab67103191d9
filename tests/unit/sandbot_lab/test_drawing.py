"""Discs and boxes anywhere, also where the robot has left the picture: grey levels, and nothing outside is touched."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sandbot_lab.drawing import draw_box, draw_disc

ROWS, COLUMNS, GROUND, GREY = 48, 64, 40, 200.0
places = st.lists(st.floats(-1e6, 1e6) | st.floats(-80, 80), min_size=1, max_size=4).map(np.array)
lengths = st.floats(0.0, 500.0)


def ground():
    return np.full((ROWS, COLUMNS), GROUND, np.uint8)


@given(places, places, lengths, lengths)
def test_a_box_anywhere_changes_only_what_it_covers(left, top, width, height):
    left, top = np.resize(left, 4), np.resize(top, 4)
    image = ground()
    draw_box(image, left, left + width, top, top + height, GREY)
    assert ((image >= GROUND) & (image <= GREY)).all()
    rows, columns = np.nonzero(image != GROUND)
    if rows.size:
        assert columns.min() >= left.min() - 1
        assert columns.max() <= (left + width).max() + 1
        assert rows.min() >= top.min() - 1
        assert rows.max() <= (top + height).max() + 1


@given(places, places, st.floats(0.5, 20.0))
def test_a_disc_anywhere_changes_only_what_it_covers(u, v, radius):
    u, v = np.resize(u, 4), np.resize(v, 4)
    image = ground()
    draw_disc(image, u, v, radius, GREY)
    assert ((image >= GROUND) & (image <= GREY)).all()
    rows, columns = np.nonzero(image != GROUND)
    assert all(np.hypot(u - column, v - row).min() <= radius + 1 for row, column in zip(rows, columns, strict=True))


def test_a_box_within_the_picture_is_drawn_whole():
    image, one = ground(), np.ones(1)
    draw_box(image, 9.5 * one, 19.5 * one, 4.5 * one, 14.5 * one, GREY)
    assert (image[5:15, 10:20] == GREY).all()
    assert (image == GREY).sum() == 100
