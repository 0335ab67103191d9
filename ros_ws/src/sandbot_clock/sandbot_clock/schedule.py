"""A periodic task at absolute instants: no drift; missed instants are skipped and counted, never caught up."""

from collections.abc import Callable
from dataclasses import dataclass

NANO = 1_000_000_000


@dataclass(frozen=True)
class Schedule:
    """The instants ``start_ns + n / rate_hz``, each rounded to a nanosecond separately so that no error accumulates."""

    start_ns: int
    rate_hz: float

    def instant(self, n: int) -> int:
        """The n-th instant [ns]."""
        return self.start_ns + round(n * NANO / self.rate_hz)

    def after(self, n: int, now_ns: int) -> int:
        """The next instant after number ``n``: n + 1, or the latest already due if whole periods were lost."""
        return max(n + 1, int((now_ns - self.start_ns) * self.rate_hz / NANO))


def keep(
    schedule: Schedule,
    duty: Callable[[int], bool],
    now_ns: Callable[[], int],
    sleep_s: Callable[[float], None],
    missed: Callable[[int], None],
) -> None:
    """Call ``duty(instant_ns)`` at each instant until it returns False, and ``missed`` with the number skipped."""
    n = 0
    while True:
        instant = schedule.instant(n)
        if (wait := instant - now_ns()) > 0:
            sleep_s(wait / NANO)
        if not duty(instant):
            return
        upcoming = schedule.after(n, now_ns())
        if upcoming > n + 1:
            missed(upcoming - n - 1)
        n = upcoming


TOO_OFTEN = 0.01
"""Fraction of missed instants above which a warning is given."""


def missed_warning(missed: int, kept: int) -> str:
    """A warning if more than 1 % of a run's instants were missed, else an empty string."""
    due = missed + kept
    return f"{missed} of {due} set-points of this run were missed" if missed > TOO_OFTEN * due else ""
