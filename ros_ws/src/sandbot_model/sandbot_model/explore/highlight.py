"""Highlights the chosen cell in any figure whose points carry the cell's index (the end of ``customdata``)."""

from sandbot_model.report.theme import Spec, Theme

SIZE, WIDTH = 14, 3
"""Diameter of the chosen point, and width of the line around it or around its square of a map."""


def mark(spec: Spec, cell: int | None, theme: Theme) -> Spec:
    """Draw a ring around the chosen cell's point, or a frame around its square of a map; changes ``spec`` in place."""
    if cell is None:
        return spec
    for trace in spec["data"]:
        rows = trace.get("customdata", [])
        if trace["type"] == "heatmap":
            frames = [(x, y) for y, row in enumerate(rows) for x, data in enumerate(row) if data[-1] == cell]
            spec["layout"].setdefault("shapes", []).extend(_frame(trace, x, y, theme) for x, y in frames)
        elif "marker" in trace and any(_cell_index(data) == cell for data in rows):
            _ring(trace, [_cell_index(data) == cell for data in rows], theme)
    return spec


def _cell_index(data: object) -> object:
    return data[-1] if isinstance(data, list) and data else None


def _ring(trace: Spec, chosen: list[bool], theme: Theme) -> None:
    marker = trace["marker"]
    size, line = marker.get("size", 8), marker.get("line", {})
    usual = (line.get("color", theme.paper), line.get("width", 1))
    lines = [(theme.ink, WIDTH) if is_chosen else usual for is_chosen in chosen]
    colours, widths = zip(*lines, strict=True)
    sizes = [SIZE if is_chosen else size for is_chosen in chosen]
    trace["marker"] = marker | {"size": sizes, "line": {"color": list(colours), "width": list(widths)}}


def _frame(trace: Spec, x: int, y: int, theme: Theme) -> Spec:
    """Frame of a square; on the axes of a map, categories are numbered from 0."""
    return {
        "type": "rect", "xref": trace["xaxis"], "yref": trace["yaxis"], "line": {"color": theme.ink, "width": WIDTH},
        "x0": x - 0.5, "x1": x + 0.5, "y0": y - 0.5, "y1": y + 0.5,
    }  # fmt: skip
