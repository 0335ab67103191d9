"""Run a campaign in batch: trials over a crew, with progress, resumable, stopped cleanly by Ctrl-C."""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from sandbot_bringup.plan import PlannedTrial
from sandbot_common.crew import Crew

Job = Callable[[PlannedTrial, int], Path]
"""Runs one trial, started at a wall-clock instant [ns], and returns its bag."""


@dataclass(frozen=True)
class Outcome:
    """What became of the trials: finished ones, and those that failed with the reason."""

    finished: tuple[str, ...]
    failed: tuple[tuple[str, str], ...]
    cut_short: bool = False
    """Whether any failed for want of a worker or of room on the disk: run again they would not."""


def run(trials: Sequence[PlannedTrial], job: Job, crew: Crew) -> Outcome:
    """Run ``job`` on every trial. A failing trial does not stop the others.

    On Ctrl-C the trials under way are finished, no new one is begun, and KeyboardInterrupt goes on to the caller.
    """
    finished: list[str] = []
    failed: list[tuple[str, str]] = []
    cut_short = False
    with crew.executor() as hands, tqdm(total=len(trials), unit="trial", desc="campaign", mininterval=0.5) as bar:
        waiting = list(reversed(trials))
        running: dict[Future[Path], PlannedTrial] = {}
        try:
            while waiting or running:
                # Only what they can start on now is handed over, so that Ctrl-C has little to wait for.
                while waiting and len(running) < 2 * crew.size:
                    running[hands.submit(job, waiting[-1], time.time_ns())] = waiting[-1]
                    waiting.pop()
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    if future.cancelled() or isinstance(future.exception(), BrokenExecutor):
                        raise BrokenExecutor
                    trial = running.pop(future)
                    if (error := future.exception()) is not None:
                        cut_short = cut_short or isinstance(error, OSError)
                        failed.append((trial.trial_id, f"{type(error).__name__}: {error}"))
                    else:
                        finished.append(trial.trial_id)
                    bar.update()
        except KeyboardInterrupt:
            hands.shutdown(wait=True, cancel_futures=True)
            raise
        except BrokenExecutor:
            lost = [*running.values(), *reversed(waiting)]
            failed += [(trial.trial_id, f"{crew.lost}; resume to run it") for trial in lost]
            cut_short = True
    return Outcome(tuple(finished), tuple(failed), cut_short)
