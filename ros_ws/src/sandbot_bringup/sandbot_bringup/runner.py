"""Run a campaign in batch: trials in parallel, with progress, resumable, stopped cleanly by Ctrl-C."""

import errno
import time
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, Future
from dataclasses import dataclass
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
    finished: list[str] = []
    failed: list[tuple[str, str]] = []
    cut_short = False
    with (
        workers.executor() as executor,
        tqdm(total=len(trials), unit="trial", desc="campaign", mininterval=0.5, delay=0.5) as bar,
    ):
        waiting = list(reversed(trials))
        running: dict[Future[Path], PlannedTrial] = {}
        done = Finished()
        try:
            while waiting or running:
                # Only what the workers can start soon is submitted, so that Ctrl-C has little to wait for.
                while waiting and len(running) < 2 * workers.size:
                    future = executor.submit(job, waiting[-1], time.time_ns())
                    running[future] = waiting.pop()
                    done.announce(future)
                future = done.next()
                if future.cancelled() or isinstance(future.exception(), BrokenExecutor):
                    raise BrokenExecutor
                trial = running.pop(future)
                if (error := future.exception()) is not None:
                    cut_short = cut_short or isinstance(error, OSError)
                    no_room = _no_room(error)
                    failed.append((trial.trial_id, no_room or f"{type(error).__name__}: {error}"))
                    if no_room:
                        failed += [(each.trial_id, no_room) for each in reversed(waiting)]
                        waiting.clear()
                else:
                    finished.append(trial.trial_id)
                bar.update()
        except KeyboardInterrupt:
            executor.shutdown(wait=True, cancel_futures=True)
            raise
        except BrokenExecutor:
            lost = [*running.values(), *reversed(waiting)]
            failed += [(trial.trial_id, f"{workers.lost}; resume to run it") for trial in lost]
            cut_short = True
    return Outcome(tuple(finished), tuple(failed), cut_short)


def _no_room(error: BaseException) -> str:
    """Why nothing can be written any more; empty for other errors."""
    if isinstance(error, OSError) and error.errno in _TAKES_NOTHING:
        return f"can't be written: {error.strerror}; resume to run it"
    return ""
