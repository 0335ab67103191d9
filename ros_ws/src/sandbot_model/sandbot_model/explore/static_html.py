"""Static parts of the page, each rendered as a single Dash element.

At each update Dash checks every one of its elements for changes: a table of symbols or the text of an effect, built of
Dash elements, would delay a click by more than its figure does.
"""

from html import escape
from typing import Any

from dash import html
from dash.development.base_component import Component

ATTRIBUTES = {"className": "class", "htmlFor": "for", "tabIndex": "tabindex"}
"""React's name of an attribute → its name in HTML."""
VOID = {"br", "img"}
"""Elements without an end tag."""


def static(*parts: Any, **attributes: Any) -> html.Span:
    """One element with the HTML of the parts in an attribute, from which explore.js inserts it."""
    return html.Span(**attributes, **{"data-html": to_html(parts)})


def to_html(part: Any) -> str:
    """HTML of Dash elements, of text, and of lists of these."""
    if part is None:
        return ""
    if isinstance(part, list | tuple):
        return "".join(map(to_html, part))
    if not isinstance(part, Component):
        return escape(str(part))
    element = part.to_plotly_json()
    tag, given = element["type"].lower(), element["props"]
    inner = to_html(given.get("children")) if "data-html" not in given else given["data-html"]
    attributes = "".join(
        f' {ATTRIBUTES.get(name, name)}="{escape(str(value))}"'
        for name, value in given.items()
        if name not in {"children", "data-html"} and value is not None
    )
    return f"<{tag}{attributes}>" + ("" if tag in VOID else f"{inner}</{tag}>")
