"""Whether a loop stood still: requests to a frozen process must start nothing once it resumes."""

import math
from dataclasses import dataclass

LIMIT_S = 2.0
"""Shorter than any client's timeout; longer than a busy machine keeps a loop from a CPU."""
AWAKE_S = 5.0
"""For this long after it resumes, a loop may still receive old requests: DDS resends to unreachable readers every 3 s
(measured: 0.6 to 3.07 s after it resumed)."""
OLD = f"held up until just now, and this may be an old request; ask again in {AWAKE_S:g} s"


@dataclass
class Standstill:
    """The loop calls ``turn`` at short intervals, and ``refusal`` before it obeys. Times [s] of a monotonic clock.

    The client of an old request has timed out or is gone; if it is still there, it asks again.
    """

    woke_s: float = -math.inf
    held_s: float = 0.0
    """When it last resumed, and how long it had stood still."""
    _turned_s: float = math.inf

    def turn(self, now_s: float) -> bool:
        """The loop turns; returns whether it had stood still."""
        stood_s, self._turned_s = now_s - self._turned_s, now_s
        if woke := stood_s > LIMIT_S:
            self.woke_s, self.held_s = now_s, stood_s
        return woke

    def refusal(self, now_s: float) -> str:
        """Why nothing may begin; an empty string unless the loop stood still just before."""
        # After a standstill the request may be handled before the timer that calls ``turn``.
        self.turn(now_s)
        return OLD if now_s - self.woke_s <= AWAKE_S else ""
