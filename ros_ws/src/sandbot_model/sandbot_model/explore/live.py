"""The explorer with changing data: a campaign that is still running, or a table dropped on the page.

A server holds a fixed data set; for a new one, another server is made in the background and then replaces it at once.
"""

import hashlib
import json
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from flask import Flask, Response, request

from sandbot_common.errors import InputError

FOLLOW_S = 2.0
"""Interval between checks of a campaign's folder."""
MAX_BYTES = 50_000_000
"""Largest size of a dropped table."""
MAX_NAME = 60
"""Characters kept of its name: at most four bytes each, and file systems allow 255 bytes."""
Make = Callable[[Path | None], Flask]
"""(dropped table) → a server for the current data, with that table as second data set, and for its own page only (see
``loopback``). Raises InputError."""


class Live:
    """A WSGI application that delegates to the current server."""

    def __init__(self, make: Make, first: Flask, folder: Path, campaigns: Sequence[Path]) -> None:
        """``folder`` stores dropped tables; ``campaigns`` are the folders to watch."""
        self._make, self._campaigns = make, tuple(campaigns)
        self._dropped: Path | None = None
        self._folder = folder
        self._lock = threading.Lock()
        self._seen = completed_recordings(self._campaigns)
        self._version = 0
        self._server = self._prepared(first)

    def __call__(self, environ: dict[str, Any], start_response: Any) -> Iterable[bytes]:
        """Delegate to the current server."""
        return self._server(environ, start_response)

    def follow(self, ended: threading.Event, every_s: float = FOLLOW_S) -> None:
        """Check for new trials until ``ended`` is set."""
        while not ended.wait(every_s):
            self.look()

    def look(self) -> bool:
        """Reload the data if the folders have changed; False if they have not, or can't be used yet."""
        try:
            seen = completed_recordings(self._campaigns)
            if seen == self._seen:
                return False
            self._replace()
        except InputError:
            # A bag is still being written, or none can be used yet: the next check tries again.
            return False
        except Exception as error:  # nothing else reports failures in this thread
            traceback.print_exception(error)
            return False
        self._seen = seen
        return True

    def drop(self) -> Response:
        """Use a table sent by the page as second data set, or refuse it with a one-line reason."""
        name, size = Path(request.args.get("name", "table.csv")).name, request.content_length
        if size is None or size > MAX_BYTES or Path(name).suffix.lower() != ".csv":
            return Response(f"{name}: a trials CSV of at most 50 MB is needed", 400, mimetype="text/plain")
        content = request.get_data(cache=False)
        path = self._folder / hashlib.sha256(content).hexdigest()[:16] / _stored(name)
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)
        try:
            self._replace(path)
        except InputError as error:
            message = str(error).replace(f"{path.parent}/", "").removeprefix("--beside ")
            return Response(message, 400, mimetype="text/plain")
        return Response("", 204)

    def _replace(self, dropped: Path | None = None) -> None:
        """Serve the current data, beside the present dropped table if no new one is given; unchanged on any error."""
        with self._lock:
            dropped = dropped or self._dropped
            made = self._make(dropped)
            self._version += 1
            self._dropped, self._server = dropped, self._prepared(made)

    def _prepared(self, server: Flask) -> Flask:
        state = json.dumps({"version": self._version, "follows": bool(self._campaigns)})
        server.add_url_rule("/live", "live", lambda: Response(state, mimetype="application/json"))
        server.add_url_rule("/drop", "drop", self.drop, methods=["POST"])
        return server


def _stored(name: str) -> str:
    """A name valid on every file system and close to the table's own, since it is the title of its figures."""
    stem = "".join(sign if sign.isprintable() else "_" for sign in Path(name).stem)
    return f"{stem[:MAX_NAME]}.csv"


def completed_recordings(campaigns: Sequence[Path]) -> frozenset[tuple[str, int]]:
    """The completed recordings of campaigns, with their modification times [ns]."""
    return frozenset(recording for folder in campaigns for recording in _completed(folder))


def _completed(campaign: Path) -> Iterator[tuple[str, int]]:
    for path in (campaign / "trials").glob("[!.]*/metadata.yaml"):
        with suppress(FileNotFoundError):  # a bag that the campaign is moving away
            yield str(path), path.stat().st_mtime_ns
