"""Marks the cell that was chosen, in any figure whose points say which cell they are (the end of ``customdata``)."""

from sandbot_model.report.theme import Spec, Theme

SIZE, WIDTH = 14, 3
"""Diameter of the chosen point, and of the line about it or its square of a map."""


def mark(spec: Spec, cell: int | None, theme: Theme) -> Spec:
    """The figure with a ring about the chosen cell's point, or a frame about its square; changed in place."""
    if cell is None:
        return spec
    for trace in spec["data"]:
        rows = trace.get("customdata", [])
        if trace["type"] == "heatmap":
            frames = [(x, y) for y, row in enumerate(rows) for x, told in enumerate(row) if told[-1] == cell]
            spec["layout"].setdefault("shapes", []).extend(_frame(trace, x, y, theme) for x, y in frames)
        elif "marker" in trace and any(_last(told) == cell for told in rows):
            _ring(trace, [_last(told) == cell for told in rows], theme)
    return spec


def _last(told: object) -> object:
    return told[-1] if isinstance(told, list) and told else None


def _ring(trace: Spec, chosen: list[bool], theme: Theme) -> None:
    marker = trace["marker"]
    size, line = marker.get("size", 8), marker.get("line", {})
    usual = (line.get("color", theme.paper), line.get("width", 1))
    lines = [(theme.ink, WIDTH) if one else usual for one in chosen]
    colours, widths = zip(*lines, strict=True)
    sizes = [SIZE if one else size for one in chosen]
    trace["marker"] = marker | {"size": sizes, "line": {"color": list(colours), "width": list(widths)}}


def _frame(trace: Spec, x: int, y: int, theme: Theme) -> Spec:
    """Categories are numbered from 0 on the axes of the map."""
    return {
        "type": "rect", "xref": trace["xaxis"], "yref": trace["yaxis"], "line": {"color": theme.ink, "width": WIDTH},
        "x0": x - 0.5, "x1": x + 0.5, "y0": y - 0.5, "y1": y + 0.5,
    }  # fmt: skip
