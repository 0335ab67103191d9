"""``journal.jsonl`` of a campaign: what happened and who asked for it, one JSON object per line, append-only."""

import json
import os
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from sandbot_common.errors import InputError
from sandbot_common.files import append_line, writing

Event = Mapping[str, Any]
"""``at`` (ISO 8601, UTC), ``who`` (operator or campaign), ``do`` (one of ``KINDS``), and further keys of that kind."""
KINDS = ("begin", "hold", "pause", "go", "skip", "repeat", "add", "look", "start", "done", "failed", "stopped", "end")


class Journal:
    """``earlier``: the events of the runs before this one; ``events``: those of this run, in order."""

    def __init__(self, path: Path, now_s: Callable[[], float]) -> None:
        """``now_s``: seconds since 1970. Raises InputError if the file is not a journal."""
        self._path, self._now_s = path, now_s
        remove_torn_line(path)
        self.earlier = read_journal(path)
        self.events: list[Event] = []

    def add(self, who: str, do: str, **what: object) -> None:
        """Log an event. Raises ValueError if ``read_journal`` would refuse it, InputError on a full disk."""
        if do not in KINDS:
            raise ValueError(f"{do!r} is not an event; known: {', '.join(KINDS)}")
        at = datetime.fromtimestamp(self._now_s(), UTC).isoformat(timespec="milliseconds")
        event = {"at": at, "who": who, "do": do, **what}
        append_line(self._path, event)
        self.events.append(event)


def read_journal(path: Path) -> list[Event]:
    """The events of a journal, none if there is no file. Raises InputError with the first invalid line."""
    if not path.exists():
        return []
    events = []
    # Not splitlines: a reason may contain other line-ending characters.
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").split("\n")[:-1], start=1):
        try:
            event = json.loads(line)
            known = event["do"] in KINDS
        except (ValueError, KeyError, TypeError):
            known = False
        if not known:
            raise InputError(f"{path}: line {number} is not an event of a campaign: {line[:80]!r}")
        events.append(event)
    return events


def remove_torn_line(path: Path) -> None:
    """Remove an incomplete last line, left by a kill, which would corrupt the next one."""
    if path.exists() and not (content := path.read_bytes()).endswith(b"\n"):
        # Truncated, not rewritten: on a full disk a rewrite could lose everything.
        with writing(path):
            os.truncate(path, content.rfind(b"\n") + 1)
