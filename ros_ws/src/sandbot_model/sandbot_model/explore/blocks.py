"""Building blocks of pages: tables, figures with captions and buttons, frames of a film."""

from collections.abc import Sequence
from typing import Any

from dash import dcc, html

from sandbot_model.explore.views import Pane
from sandbot_model.report.page import data_uri
from sandbot_model.report.theme import Spec

GRAPH = {"displaylogo": False, "responsive": True, "modeBarButtons": [["zoom2d", "pan2d", "resetScale2d"]]}
FORMATS = ("svg", "png", "csv")


def table(caption: str, head: Sequence[str], rows: Sequence[Sequence[Any]]) -> html.Table:
    """A table with caption and column headings."""
    return html.Table(
        [
            html.Caption(caption),
            html.Thead(html.Tr([html.Th(words, scope="col") for words in head])),
            html.Tbody([html.Tr([html.Td(cell) for cell in row]) for row in rows]),
        ]
    )


def plot(name: str, spec: Spec | None = None, how_to_read: str = "", caption: str = "") -> html.Figure:
    """A figure with instructions for reading it, a caption, and buttons that save it."""
    given = {"figure": spec, "style": height(spec)} if spec else {}
    graph = dcc.Graph(id=name, config=GRAPH, **given)
    buttons = [
        html.Button(
            file_format.upper(),
            type="button",
            **{
                "data-format": file_format,
                "data-figure": name,
                "aria-label": f"Save figure {name} as {file_format.upper()}",
            },
        )
        for file_format in FORMATS
    ]
    return html.Figure(
        [
            html.Div(graph, className="plot", id=f"{name}-box", role="group", **{"aria-labelledby": f"{name}-says"}),
            html.Figcaption(
                [
                    html.P(how_to_read, id=f"{name}-how"),
                    html.P(caption, id=f"{name}-says"),
                    html.P(["Save figure: ", *buttons], className="save"),
                ]
            ),
        ]
    )


def height(spec: Spec) -> dict[str, str]:
    """The CSS height of a graph of ``spec``; a graph of responsive width needs it."""
    return {"height": f"{spec['layout']['height']}px"}


def panes(shown: Sequence[Pane]) -> list[Any]:
    """The figures beside the first one."""
    parts = []
    for i, pane in enumerate(shown):
        body = html.P(pane.caption) if pane.figure is None else plot(f"beside-{i}", pane.figure, caption=pane.caption)
        parts.append(html.Section([html.H2(pane.title), body], className="pane"))
    return parts


def film(strip: Sequence[tuple[bytes, str]]) -> html.Div:
    """Frames of the lateral camera with the tracked marks drawn on them."""
    frames = [
        html.Figure([html.Img(src=data_uri(jpeg, "image/jpeg"), alt=caption), html.Figcaption(caption)])
        for jpeg, caption in strip
    ]
    return html.Div(frames, className="film")
