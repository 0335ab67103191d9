"""Run a campaign in batch: trials in parallel, with progress, resumable, stopped cleanly by Ctrl-C."""

import errno
import time
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, Future
from dataclasses import dataclass, field
from pathlib import Path

from tqdm import tqdm

from sandbot_bringup.plan import PlannedTrial
from sandbot_common.parallel import Workers
from sandbot_common.workers import Finished

Job = Callable[[PlannedTrial, int], Path]
"""Runs one trial, given its wall-clock start [ns], and returns its bag."""

_TAKES_NOTHING = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EROFS})
"""Errors of a full or write-protected disk, which the next trials would meet only after all their work."""


@dataclass(frozen=True)
class Outcome:
    """The finished trials, and those that failed with the reason."""

    finished: tuple[str, ...]
    failed: tuple[tuple[str, str], ...]
    cut_short: bool = False
    """Whether any failed for lack of a worker or of disk space, and so may succeed if run again."""


def run(trials: Sequence[PlannedTrial], job: Job, workers: Workers) -> Outcome:
    """Run ``job`` on every trial. A failing trial does not stop the others, unless the disk takes nothing more.

    On Ctrl-C the trials under way are finished, no new one is begun, and KeyboardInterrupt propagates to the caller.
    """
    progress = _Progress(list(reversed(trials)))
    done = Finished()
    with (
        workers.executor() as executor,
        tqdm(total=len(trials), unit="trial", desc="campaign", mininterval=0.5, delay=0.5) as bar,
    ):
        try:
            while progress.waiting or progress.running:
                # Only what the workers can start soon is submitted, so that Ctrl-C has little to wait for.
                while progress.waiting and len(progress.running) < 2 * workers.size:
                    future = executor.submit(job, progress.waiting[-1], time.time_ns())
                    progress.running[future] = progress.waiting.pop()
                    done.announce(future)
                progress.take(done.next())
                bar.update()
        except KeyboardInterrupt:
            executor.shutdown(wait=True, cancel_futures=True)
            raise
        except BrokenExecutor:
            progress.lose(f"{workers.lost}; resume to run it")
    return Outcome(tuple(progress.finished), tuple(progress.failed), progress.cut_short)


@dataclass
class _Progress:
    """The trials that wait, the next one last, those that run, and what became of the others."""

    waiting: list[PlannedTrial]
    running: dict[Future[Path], PlannedTrial] = field(default_factory=dict)
    finished: list[str] = field(default_factory=list)
    failed: list[tuple[str, str]] = field(default_factory=list)
    cut_short: bool = False

    def take(self, future: Future[Path]) -> None:
        """A trial that ran has ended. Raises BrokenExecutor if it was lost with its worker."""
        if future.cancelled() or isinstance(future.exception(), BrokenExecutor):
            raise BrokenExecutor
        trial, error = self.running.pop(future), future.exception()
        if error is None:
            self.finished.append(trial.trial_id)
            return
        self.cut_short = self.cut_short or isinstance(error, OSError)
        no_room = _no_room(error)
        self.failed.append((trial.trial_id, no_room or f"{type(error).__name__}: {error}"))
        if no_room:
            self.failed += [(each.trial_id, no_room) for each in reversed(self.waiting)]
            self.waiting.clear()

    def lose(self, why: str) -> None:
        """The workers are gone, and all trials that ran or waited with them."""
        self.failed += [(trial.trial_id, why) for trial in (*self.running.values(), *reversed(self.waiting))]
        self.cut_short = True


def _no_room(error: BaseException) -> str:
    """Why nothing can be written any more; empty for other errors."""
    if isinstance(error, OSError) and error.errno in _TAKES_NOTHING:
        return f"can't be written: {error.strerror}; resume to run it"
    return ""
