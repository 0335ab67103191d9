"""What the explorer's further pages share: their head, their addresses, and the selection requested by an address."""

from collections.abc import Callable, Mapping
from html import escape
from itertools import chain
from urllib.parse import urlencode

from flask import Flask, Response, request

from sandbot_common.errors import InputError
from sandbot_model.discovery.selection import Selection, from_query
from sandbot_model.report.page import source

Handler = Callable[..., Response]
"""Answers the requests for one address."""

HEAD = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark"><link rel="icon" href="data:,">
<title>{title}</title><style>{style}</style></head>
<body><header><p class="kind"><a href="/{query}">Back to the explorer</a></p>"""


def head(title: str, query: str) -> str:
    """The start of a page, with a link back to the explorer at the selection of ``query``."""
    return HEAD.format(title=escape(title), style=source("report.css"), query=escape(query))


def serve(server: Flask, *routes: Mapping[str, Handler]) -> None:
    """Register pages by their addresses; a request that can't be answered (InputError) is refused with one line."""
    server.register_error_handler(InputError, lambda error: Response(str(error), 400, mimetype="text/plain"))
    for address, handler in chain.from_iterable(some.items() for some in routes):
        server.add_url_rule(address, address, handler)


def requested_selection(*others: str) -> Selection:
    """The complete selection in the address, so that links back restore the same state.

    ``others`` are keys specific to the page. Raises InputError.
    """
    return from_query(f"?{urlencode([pair for pair in request.args.items(multi=True) if pair[0] not in others])}")


def model_only(asked: Selection) -> Selection:
    """Only the model requested, without values held by hand and without view, for pages that show fits."""
    return Selection(asked.model, asked.effects, asked.formulas)


def held_values(asked: Selection) -> str:
    """The parameters held by hand with their values, as text; empty if there are none."""
    return ", ".join(f"{name} = {value:.5g}" for name, value in asked.by_hand)


def held_values_note(asked: Selection) -> str:
    """A note that a page of fits ignores the values held by hand; empty if there are none."""
    held = held_values(asked)
    return f"Values held by hand are ignored here ({held}): this page shows the fit." if held else ""
