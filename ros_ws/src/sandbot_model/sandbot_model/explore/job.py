"""A queue of the discoveries requested by pages, run one at a time in a thread."""

import threading
import traceback
from dataclasses import dataclass, field

from sandbot_common.errors import InputError
from sandbot_model.discovery.result import Discovery
from sandbot_model.discovery.selection import Selection
from sandbot_model.explore.session import Session

BEGIN = ("the base model", 0, 1)
Question = tuple[str, tuple[str, ...]]
"""The base model and the formulas, on which a discovery depends; the effects switched on do not matter."""


def question_of(selection: Selection) -> Question:
    """The question posed by a selection."""
    return selection.model, selection.formulas


@dataclass
class Job:
    """The discoveries running, queued and finished, by question."""

    session: Session
    stage: tuple[str, int, int] = BEGIN
    """(current stage, number done, total number)."""
    _asked: list[Selection] = field(default_factory=list)
    """The running one, then those queued."""
    _found: dict[Question, Discovery] = field(default_factory=dict)
    _failed: dict[Question, str] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def running(self) -> Selection | None:
        """The selection of the running discovery."""
        with self._lock:
            return self._asked[0] if self._asked else None

    def start(self, selection: Selection) -> threading.Thread | None:
        """Request a discovery for the selection's question; None if it needs no new thread.

        It is queued while another is running, and not repeated if its result is known: the data of a job never change.
        """
        with self._lock:
            question = question_of(selection)
            if question in self._found or question in map(question_of, self._asked):
                return None
            self._failed.pop(question, None)
            self._asked.append(selection)
            if len(self._asked) > 1:
                return None
            self.stage = BEGIN
        thread = threading.Thread(target=self._run, name="suggest", daemon=True)
        thread.start()
        return thread

    def pending(self, selection: Selection) -> bool:
        """Whether the discovery for the selection's question is running or queued."""
        with self._lock:
            return question_of(selection) in map(question_of, self._asked)

    def found_for(self, selection: Selection) -> Discovery | None:
        """The result for the same base model and formulas, if there is one."""
        return self._found.get(question_of(selection))

    def failed_for(self, selection: Selection) -> str:
        """Why the discovery for the same question failed; empty if it did not."""
        return self._failed.get(question_of(selection), "")

    def _run(self) -> None:
        while (selection := self.running) is not None:
            self._try(selection)
            with self._lock:
                self._asked.pop(0)
                self.stage = BEGIN

    def _try(self, selection: Selection) -> None:
        try:
            self._found[question_of(selection)] = self.session.suggest(selection, self._progress)
        except Exception as error:  # nothing else reports failures in this thread
            if not isinstance(error, InputError):
                traceback.print_exception(error)
            self._failed[question_of(selection)] = f"No suggestion: {error}"

    def _progress(self, stage: str, done: int, total: int) -> None:
        self.stage = (stage, done, total)
