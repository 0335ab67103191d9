"""The console over HTTP: one page, a stream of snapshots, two pictures, four buttons. No ROS here.

Loopback only, and the buttons obey this page alone: the Host must be this host (a name that was rebound to it is not)
and a header is asked for that another site's page can't send.
"""

import json
import socket
import threading
from collections.abc import Callable, Iterator, Mapping
from importlib.resources import files
from typing import Any, Protocol
from urllib.parse import urlsplit

from flask import Flask, Response, abort, jsonify, request
from plotly.offline import get_plotlyjs
from werkzeug.serving import BaseWSGIServer, WSGIRequestHandler, make_server

from sandbot_bringup.console import ACTIONS
from sandbot_common.errors import InputError

HOST = "127.0.0.1"
PERIOD_S = 0.2
_OWN_HEADER = "X-Trackway"


class Source(Protocol):
    """What the page needs of the node; called from the server's threads."""

    def snapshot(self) -> Mapping[str, Any]:
        """What to draw."""

    def picture(self, camera: str) -> bytes | None:
        """The latest JPEG of a camera, None before the first."""

    def call(self, service: str) -> tuple[bool, str]:
        """Call a Trigger service: success and what it said."""


def app(source: Source, closing: threading.Event) -> Flask:
    """The WSGI application; its streams end when ``closing`` is set."""
    page = Flask("sandbot_bringup.console", static_folder=None)
    html = files("sandbot_bringup").joinpath("console.html").read_text(encoding="utf-8")
    library = get_plotlyjs()

    @page.before_request
    def own_host() -> None:
        if urlsplit(f"//{request.host}").hostname not in (HOST, "localhost"):
            abort(403)

    @page.get("/")
    def index() -> Response:
        return Response(html, mimetype="text/html")

    @page.get("/plotly.js")
    def plotly_js() -> Response:
        return Response(library, mimetype="text/javascript", headers={"Cache-Control": "max-age=86400"})

    @page.get("/stream")
    def stream() -> Response:
        return Response(_events(source.snapshot, closing), mimetype="text/event-stream")

    @page.get("/camera/<camera>.jpg")
    def picture(camera: str) -> Response:
        jpeg = source.picture(camera)
        if jpeg is None:
            abort(404)
        return Response(jpeg, mimetype="image/jpeg", headers={"Cache-Control": "no-store"})

    @page.post("/call/<action>")
    def call(action: str) -> Response:
        if request.headers.get(_OWN_HEADER) is None:
            abort(403)
        if action not in ACTIONS:
            abort(404)
        success, message = source.call(ACTIONS[action])
        return jsonify(success=success, message=message)

    return page


def serve(source: Source, port: int, closing: threading.Event) -> BaseWSGIServer:
    """Serve in a thread of its own; InputError where the port is taken. ``shutdown()`` of what is returned ends it."""
    try:
        # Bound here: werkzeug answers a taken port with advice of its own and an exit.
        listening = socket.create_server((HOST, port))
    except OSError:
        raise InputError(f"console: port {port} of {HOST} is taken; set another, e.g. -p port:={port + 1}") from None
    with listening:
        server = make_server(
            HOST,
            listening.getsockname()[1],
            app(source, closing),
            threaded=True,
            request_handler=_Quiet,
            fd=listening.fileno(),
        )
    threading.Thread(target=server.serve_forever, name="console page", daemon=True).start()
    return server


class _Quiet(WSGIRequestHandler):
    """Ten pictures a second are not news."""

    def log_request(self, code: int | str = "-", size: int | str = "-") -> None:
        """Say nothing of requests that went well; errors are logged elsewhere."""


def _events(snapshot: Callable[[], Mapping[str, Any]], closing: threading.Event) -> Iterator[str]:
    while True:
        yield f"data: {json.dumps(snapshot(), allow_nan=False)}\n\n"
        if closing.wait(PERIOD_S):
            return
