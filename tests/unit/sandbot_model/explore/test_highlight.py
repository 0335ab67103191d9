"""The chosen cell is marked wherever a point says that it is that cell."""

from sandbot_model.explore.highlight import SIZE, mark
from sandbot_model.report.theme import LIGHT


def spec():
    points = {
        "type": "scatter", "marker": {"size": 8, "line": {"color": "white", "width": 1}},
        "customdata": [[3, 4], [3, 5]],
    }  # fmt: skip
    curve = {"type": "scatter", "line": {}}
    squares = {
        "type": "heatmap",
        "xaxis": "x2",
        "yaxis": "y2",
        "customdata": [[[0.1, 4], [0.2, None]], [[0.3, 5], [1, 6]]],
    }
    return {"data": [points, curve, squares], "layout": {}}


def test_a_ring_about_its_point_and_a_frame_about_its_square():
    found = mark(spec(), 5, LIGHT)
    assert found["data"][0]["marker"]["size"] == [8, SIZE]
    assert found["data"][0]["marker"]["line"]["color"] == ["white", LIGHT.ink]
    (frame,) = found["layout"]["shapes"]
    assert (frame["xref"], frame["x0"], frame["x1"], frame["y0"], frame["y1"]) == ("x2", -0.5, 0.5, 0.5, 1.5)


def test_without_a_cell_or_with_one_that_is_not_there_nothing_is_marked():
    assert mark(spec(), None, LIGHT) == spec()
    found = mark(spec(), 99, LIGHT)
    assert found["data"] == spec()["data"]
    assert not found["layout"].get("shapes")
