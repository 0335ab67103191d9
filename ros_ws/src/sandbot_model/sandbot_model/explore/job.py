"""The discovery that a page asked for: one at a time, in a thread of its own."""

import threading
import traceback
from dataclasses import dataclass, field

from sandbot_common.errors import InputError
from sandbot_model.discovery.choice import Selection
from sandbot_model.discovery.discover import Discovery
from sandbot_model.explore.session import Session

BEGIN = ("the base model", 0, 1)


@dataclass
class Job:
    """The discovery that is running or has run."""

    session: Session
    stage: tuple[str, int, int] = BEGIN
    """What is tried, how many of these are done, and how many there are."""
    asked: Selection | None = None
    found: Discovery | None = None
    failed: str = ""
    running: bool = False
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def start(self, selection: Selection) -> threading.Thread | None:
        """Start one over the selection's base model and formulas; None while another is running."""
        with self._lock:
            if self.running:
                return None
            self.running, self.asked, self.found, self.failed, self.stage = True, selection, None, "", BEGIN
        thread = threading.Thread(target=self._run, args=(selection,), name="suggest", daemon=True)
        thread.start()
        return thread

    def found_for(self, selection: Selection) -> Discovery | None:
        """What was found, if it was asked of the same base model and with the same formulas."""
        asked, found = self.asked, self.found
        same = asked is not None and (asked.model, asked.formulas) == (selection.model, selection.formulas)
        return found if same else None

    def _run(self, selection: Selection) -> None:
        try:
            self.found = self.session.suggest(selection, self._progress)
        except Exception as error:  # nothing else reports what fails in this thread
            if not isinstance(error, InputError):
                traceback.print_exception(error)
            self.failed = f"No suggestion: {error}"
        finally:
            self.running = False

    def _progress(self, stage: str, done: int, total: int) -> None:
        self.stage = (stage, done, total)
