"""The console over HTTP: one page, its state on request, two pictures, and the operator's commands. No ROS.

Loopback only, and it obeys only its own page: the Host must be this host (against DNS rebinding), and a header is
required that another site's page can't send. The header holds the time of the state on which the page acts, so that a
request delayed by a frozen process or page starts nothing. Another header names the page by a random number, so that
legs and air end with the page that started them; what has no such name is never open.
"""

import json
import socket
import threading
import time
from collections.abc import Callable, Collection, Mapping
from importlib.resources import files
from typing import Any, Protocol
from urllib.parse import urlsplit

from flask import Flask, Response, abort, jsonify, request
from plotly.offline import get_plotlyjs
from werkzeug.serving import BaseWSGIServer, WSGIRequestHandler, make_server

from sandbot_common.errors import InputError

HOST = "127.0.0.1"
OLD_S = 2.0
"""A request for motion or air must be based on a state of the trackway no older than this."""
_OWN_HEADER, _PAGE_HEADER = "X-Trackway", "X-Trackway-Page"
AT_ONCE = ("abort", "halt", "pause")
"""Actions that end something are carried out however late."""


class Source(Protocol):
    """What the page needs from the node; called from the server's threads."""

    actions: Collection[str]
    """The actions that ``call`` accepts."""

    def snapshot(self, page: str) -> Mapping[str, Any]:
        """The state to draw, for the page of that name; empty if it has none."""

    def picture(self, camera: str) -> bytes | None:
        """The latest JPEG of a camera, None before the first."""

    def stop(self) -> tuple[bool, str]:
        """End motion and air and hold the campaign: whether all is at rest, and what was seen."""

    def call(self, action: str, page: str) -> tuple[bool, str]:
        """Carry out one of ``actions`` for a page: success and message."""

    def order(self, what: Mapping[str, Any]) -> tuple[bool, str]:
        """Change the campaign's queue: success and message."""

    def acknowledge(self) -> tuple[bool, str]:
        """The operator has seen an overlap of air and motion."""


def _texts() -> dict[str, tuple[str, str]]:
    """The page's files by path: text and type. The base style is the explorer's."""
    own, shared = files("sandbot_bringup") / "page", files("sandbot_model.explore") / "assets"
    return {
        "": (own.joinpath("console.html").read_text(encoding="utf-8"), "text/html"),
        "base.css": (shared.joinpath("base.css").read_text(encoding="utf-8"), "text/css"),
        "console.css": (own.joinpath("console.css").read_text(encoding="utf-8"), "text/css"),
        "console.js": (own.joinpath("console.js").read_text(encoding="utf-8"), "text/javascript"),
        "plotly.js": (get_plotlyjs(), "text/javascript"),
    }


def app(source: Source, now_s: Callable[[], float] = time.monotonic) -> Flask:
    """The WSGI application. No response is endless: each would occupy a browser connection that STOP may need."""
    page = Flask("sandbot_bringup.console", static_folder=None)

    @page.before_request
    def own_page_only() -> None:
        if urlsplit(f"//{request.host}").hostname not in (HOST, "localhost"):
            abort(403)
        if request.method != "GET" and request.headers.get(_OWN_HEADER) is None:
            abort(403)

    _show(page, source, now_s)
    _obey(page, source, now_s)
    return page


def _show(page: Flask, source: Source, now_s: Callable[[], float]) -> None:
    texts = _texts()

    @page.get("/")
    @page.get("/<path:name>")
    def text(name: str = "") -> Response:
        if name not in texts:
            abort(404)
        content, kind = texts[name]
        return Response(content, mimetype=kind, headers={"Cache-Control": "no-cache"})

    @page.get("/state")
    def state() -> Response:
        content = json.dumps({**source.snapshot(_name()), "at_s": now_s()}, allow_nan=False)
        return Response(content, mimetype="application/json", headers={"Cache-Control": "no-store"})

    @page.get("/camera/<camera>.jpg")
    def picture(camera: str) -> Response:
        jpeg = source.picture(camera)
        if jpeg is None:
            abort(404)
        return Response(jpeg, mimetype="image/jpeg", headers={"Cache-Control": "no-store"})


def _obey(page: Flask, source: Source, now_s: Callable[[], float]) -> None:
    at_once = {"stop": source.stop, "acknowledge": source.acknowledge}

    def late() -> str:
        """Why it is too late to start anything; an empty string if it is not."""
        age_s = now_s() - request.headers.get(_OWN_HEADER, 0.0, type=float)
        return "" if abs(age_s) <= OLD_S else f"what the page knew when it asked is {age_s:.0f} s old; ask again"

    @page.post("/<any(stop, acknowledge):what>")
    def simple(what: str) -> Response:
        return _answer(at_once[what]())

    @page.post("/call/<action>")
    def call(action: str) -> Response:
        if action not in source.actions:
            abort(404)
        if action not in AT_ONCE and (refusal := late()):
            return _answer((False, refusal))
        return _answer(source.call(action, _name()))

    @page.post("/order")
    def order() -> Response:
        what = request.get_json()
        if not isinstance(what, dict):
            abort(400)
        if refusal := late():
            return _answer((False, refusal))
        return _answer(source.order(what))


def _name() -> str:
    return request.headers.get(_PAGE_HEADER, "")


def _answer(result: tuple[bool, str]) -> Response:
    return jsonify(success=result[0], message=result[1])


def serve(source: Source, port: int) -> BaseWSGIServer:
    """Serve in a separate thread; ``shutdown()`` of the returned server ends it. Raises InputError on a taken port."""
    try:
        # Bound here, because on a taken port werkzeug prints its own advice and exits.
        listening = socket.create_server((HOST, port))
    except OSError:
        raise InputError(f"console: port {port} of {HOST} is taken; set another, e.g. -p port:={port + 1}") from None
    with listening:
        server = make_server(
            HOST, listening.getsockname()[1], app(source), threaded=True, request_handler=_Quiet, fd=listening.fileno()
        )
    threading.Thread(target=server.serve_forever, name="console page", daemon=True).start()
    return server


class _Quiet(WSGIRequestHandler):
    """Does not log five states and ten pictures a second."""

    def log_request(self, code: int | str = "-", size: int | str = "-") -> None:
        """Log nothing; errors are logged elsewhere."""
