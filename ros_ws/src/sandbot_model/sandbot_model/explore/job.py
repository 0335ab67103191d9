"""The discoveries that pages asked for: one at a time, in a thread of its own; others wait for their turn."""

import threading
import traceback
from dataclasses import dataclass, field

from sandbot_common.errors import InputError
from sandbot_model.discovery.choice import Selection
from sandbot_model.discovery.discover import Discovery
from sandbot_model.explore.session import Session

BEGIN = ("the base model", 0, 1)
Question = tuple[str, tuple[str, ...]]
"""What a discovery is asked of: base model and formulas. The effects that are on change nothing."""


def question_of(selection: Selection) -> Question:
    """The question that a selection asks."""
    return selection.model, selection.formulas


@dataclass
class Job:
    """The discoveries that are running, wait or have run, by their question."""

    session: Session
    stage: tuple[str, int, int] = BEGIN
    """What is tried, how many of these are done, and how many there are."""
    _asked: list[Selection] = field(default_factory=list)
    """The one that is running, then those that wait."""
    _found: dict[Question, Discovery] = field(default_factory=dict)
    _failed: dict[Question, str] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def running(self) -> Selection | None:
        """What is tried now."""
        with self._lock:
            return self._asked[0] if self._asked else None

    def start(self, selection: Selection) -> threading.Thread | None:
        """Ask for one over the selection's base model and formulas; None where no new thread is needed for it.

        It waits while another is running, and is not made again where it was found: the data of a job never change.
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
        """Whether the selection's question is being tried, or waits."""
        with self._lock:
            return question_of(selection) in map(question_of, self._asked)

    def found_for(self, selection: Selection) -> Discovery | None:
        """What was found, if it was asked of the same base model and with the same formulas."""
        return self._found.get(question_of(selection))

    def failed_for(self, selection: Selection) -> str:
        """Why nothing was found for the same question; empty where it did not fail."""
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
        except Exception as error:  # nothing else reports what fails in this thread
            if not isinstance(error, InputError):
                traceback.print_exception(error)
            self._failed[question_of(selection)] = f"No suggestion: {error}"

    def _progress(self, stage: str, done: int, total: int) -> None:
        self.stage = (stage, done, total)
