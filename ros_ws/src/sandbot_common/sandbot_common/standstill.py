"""Requests that may be older than a stop, or than the process that receives them, must start nothing. Pure."""

import math
from dataclasses import dataclass, field

LIMIT_S = 2.0
"""Shorter than any client's timeout; longer than a busy machine keeps a loop from a CPU."""
AWAKE_S = 5.0
"""For this long after it resumes, a loop may still receive old requests: DDS resends to unreachable readers every 3 s
(measured: 0.6 to 3.07 s after it resumed)."""
STOPPED_S = 3.0
"""For this long a start may be under way when a stop overtakes it: a page's request is up to 2 s old, and then waits up
to 1 s for its lease."""
BEGUN_S = 1.0
"""For this long a new process may receive what its predecessor was asked."""
OLD, BEGUN, STOPPED = (
    f"{why}, and this may be an old request; ask again in {seconds:g} s"
    for why, seconds in (
        ("held up until just now", AWAKE_S),
        ("only just begun", BEGUN_S),
        ("stopped just now", STOPPED_S),
    )
)
RAN = "stopped"
"""The answer of /clock/stop if the clock ran until then."""
REFUSED_S = {OLD: AWAKE_S, BEGUN: BEGUN_S, STOPPED: STOPPED_S}
"""For how long nothing may begin, by the reason."""


@dataclass
class Standstill:
    """The loop calls ``turn`` at short intervals, ``stop`` at each stop that is asked of it, and ``refusal`` before it
    starts anything. Times [s] of a monotonic clock.

    The client of an old request has timed out or is gone; if it is still there, it asks again.
    """

    _turned_s: float = math.nan
    _until_s: dict[str, float] = field(default_factory=dict)
    """Until when nothing may begin, by the reason: one that lasts longer must not be reported as the other."""
    woke_s: float = -math.inf
    held_s: float = 0.0
    """When it last resumed, and how long it had stood still."""

    def turn(self, now_s: float) -> bool:
        """The loop turns; returns whether it had stood still."""
        stood_s, self._turned_s = now_s - self._turned_s, now_s
        if woke := stood_s > LIMIT_S:
            self.woke_s, self.held_s = now_s, stood_s
        if woke or math.isnan(stood_s):
            self._refuse(OLD if woke else BEGUN, now_s)
        return woke

    def stop(self, now_s: float) -> None:
        """A stop was asked for: whatever was asked before it must not start any more."""
        self.turn(now_s)
        self._refuse(STOPPED, now_s)

    def refusal(self, now_s: float) -> str:
        """Why nothing may begin (OLD, BEGUN or STOPPED); an empty string if it may."""
        # After a standstill the request may be handled before the timer that calls ``turn``.
        self.turn(now_s)
        # A stop first: a campaign that is told of it asks whether it was by hand.
        return next((why for why in (STOPPED, OLD, BEGUN) if now_s <= self._until_s.get(why, -math.inf)), "")

    def _refuse(self, why: str, now_s: float) -> None:
        self._until_s[why] = now_s + REFUSED_S[why]
