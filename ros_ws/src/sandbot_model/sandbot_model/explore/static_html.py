"""Parts of the page in which nothing changes by itself, as one element each.

Dash asks every element of its own, at every change of any other, whether it has changed, too: a table of symbols or
the words of an effect, made of such elements, cost more of a click than its figure.
"""

from html import escape
from typing import Any

from dash import html
from dash.development.base_component import Component

ATTRIBUTES = {"className": "class", "htmlFor": "for", "tabIndex": "tabindex"}
"""What HTML calls an attribute for which React has a name of its own."""
VOID = {"br", "img"}
"""Elements without an end."""


def static(*parts: Any, **attributes: Any) -> html.Span:
    """One element that holds the parts; explore.js puts them there."""
    return html.Span(**attributes, **{"data-html": to_html(parts)})


def to_html(part: Any) -> str:
    """HTML of Dash's elements, of words, and of lists of these."""
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
