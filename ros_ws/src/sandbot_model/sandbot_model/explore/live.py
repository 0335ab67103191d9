"""The explorer while its data change: a campaign that is still growing, a table dropped on the page.

The pages know one data set each; for another one a new server is made beside the old one, and takes its place at once.
"""

import hashlib
import json
import threading
import traceback
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from flask import Flask, Response, request

from sandbot_common.errors import InputError

FOLLOW_S = 2.0
"""How often a campaign's folder is looked at."""
MAX_BYTES = 50_000_000
"""Of a table that is dropped."""
MAX_NAME = 60
"""Characters of its name that are kept: four bytes each at most, where a file system takes 255 bytes."""
Make = Callable[[Path | None], Flask]
"""A server for the data as they are now, with a table beside them if one was dropped. Raises InputError."""


class Live:
    """What is served now: a WSGI application."""

    def __init__(self, make: Make, first: Flask, folder: Path, campaigns: Sequence[Path] = ()) -> None:
        """``folder`` takes the tables that are dropped; ``campaigns`` are the folders that are followed."""
        self._make, self._campaigns = make, tuple(campaigns)
        self._dropped: Path | None = None
        self._folder = folder
        self._lock = threading.Lock()
        self._seen = completed_recordings(self._campaigns)
        self._version = 0
        self._server = self._prepared(first)

    def __call__(self, environ: dict[str, Any], start_response: Any) -> Iterable[bytes]:
        """Answer as the server of the moment does."""
        return self._server(environ, start_response)

    def follow(self, ended: threading.Event, every_s: float = FOLLOW_S) -> None:
        """Look for new trials until ``ended`` is set."""
        while not ended.wait(every_s):
            self.look()

    def look(self) -> bool:
        """Take the data as they are now, should the folders have changed; whether they had."""
        seen = completed_recordings(self._campaigns)
        if seen == self._seen:
            return False
        try:
            self._replace()
        except InputError:
            # A bag that is being written, or none that can be used yet: the next look will tell.
            return False
        except Exception as error:  # nothing else reports what fails in this thread
            traceback.print_exception(error)
        self._seen = seen
        return True

    def drop(self) -> Response:
        """A table sent by the page is set beside the data, or refused in a line."""
        if request.headers.get("Origin") not in (None, f"http://{request.host}"):
            return Response("only this page may send a table", 403, mimetype="text/plain")
        name = Path(request.args.get("name", "table.csv")).name
        content = request.get_data(cache=False)
        if len(content) > MAX_BYTES or Path(name).suffix.lower() != ".csv":
            return Response(f"{name}: a trials CSV of at most 50 MB is needed", 400, mimetype="text/plain")
        path = self._folder / hashlib.sha256(content).hexdigest()[:16] / _stored(name)
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)
        before, self._dropped = self._dropped, path
        try:
            self._replace()
        except InputError as error:
            self._dropped = before
            said = str(error).replace(f"{path.parent}/", "").removeprefix("--beside ")
            return Response(said, 400, mimetype="text/plain")
        return Response("", 204)

    def _replace(self) -> None:
        with self._lock:
            made = self._make(self._dropped)
            self._version += 1
            self._server = self._prepared(made)

    def _prepared(self, server: Flask) -> Flask:
        told = json.dumps({"version": self._version, "follows": bool(self._campaigns)})
        server.add_url_rule("/live", "live", lambda: Response(told, mimetype="application/json"))
        server.add_url_rule("/drop", "drop", self.drop, methods=["POST"])
        return server


def _stored(name: str) -> str:
    """A name that every file system takes, near enough to the table's own, since it is the title of its figures."""
    stem = "".join(sign if sign.isprintable() else "_" for sign in Path(name).stem)
    return f"{stem[:MAX_NAME]}.csv"


def completed_recordings(campaigns: Sequence[Path]) -> frozenset[tuple[str, int]]:
    """The recordings of campaigns that are complete, with the time of their last change."""
    done = (path for folder in campaigns for path in (folder / "trials").glob("[!.]*/metadata.yaml"))
    return frozenset((str(path), path.stat().st_mtime_ns) for path in done)
