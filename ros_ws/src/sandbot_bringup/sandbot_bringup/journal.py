"""``journal.jsonl`` of a campaign: what happened and who asked for it, one JSON object a line, only ever appended."""

import json
import os
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from sandbot_common.errors import InputError
from sandbot_common.files import writing

Event = Mapping[str, Any]
"""``at`` (ISO 8601, UTC), ``who`` (operator or campaign), ``do`` (of ``KINDS``), and what belongs to it."""
KINDS = ("begin", "hold", "pause", "go", "skip", "repeat", "add", "look", "start", "done", "failed", "stopped", "end")


class Journal:
    """``earlier``: the events of the runs before this one; ``events``: those of this run, in order."""

    def __init__(self, path: Path, now_s: Callable[[], float]) -> None:
        """``now_s``: seconds since 1970. InputError where the file is no journal."""
        self._path, self._now_s = path, now_s
        end_torn_line(path)
        self.earlier = read_journal(path)
        self.events: list[Event] = []

    def add(self, who: str, do: str, **what: object) -> None:
        """Write an event down. ValueError for one that ``read_journal`` would refuse, InputError on a full disk."""
        if do not in KINDS:
            raise ValueError(f"{do!r} is no event; known: {', '.join(KINDS)}")
        at = datetime.fromtimestamp(self._now_s(), UTC).isoformat(timespec="milliseconds")
        event = {"at": at, "who": who, "do": do, **what}
        # Half a character, which JSON may hold and UTF-8 may not, is written as JSON escapes it.
        with writing(self._path), self._path.open("a", encoding="utf-8", errors="backslashreplace") as file:
            file.write(json.dumps(event, ensure_ascii=False, allow_nan=False) + "\n")
        self.events.append(event)


def read_journal(path: Path) -> list[Event]:
    """The events of a journal, none where there is no file. InputError with the line that is none."""
    if not path.exists():
        return []
    events = []
    # Not splitlines: a reason may hold other characters that end a line.
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").split("\n")[:-1], start=1):
        try:
            event = json.loads(line)
            known = event["do"] in KINDS
        except (ValueError, KeyError, TypeError):
            known = False
        if not known:
            raise InputError(f"{path}: line {number} is no event of a campaign: {line[:80]!r}")
        events.append(event)
    return events


def end_torn_line(path: Path) -> None:
    """Remove what a kill left of a file's last line: it would spoil the one that comes next."""
    if path.exists() and not (content := path.read_bytes()).endswith(b"\n"):
        # Cut, not written anew: on a full disk all that came before it would be lost.
        with writing(path):
            os.truncate(path, content.rfind(b"\n") + 1)
