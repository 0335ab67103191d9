"""Whether a loop stood still: what was asked of a frozen process starts nothing when it thaws."""

import math
from dataclasses import dataclass

LIMIT_S = 2.0
"""Less than anybody waits for an answer; more than a busy machine keeps a loop from a CPU."""
AWAKE_S = 5.0
"""So long after it goes on again, a loop may still come upon what was asked before: DDS sends anew to whom it could not
reach, every 3 s (measured: 0.6 to 3.07 s after a thaw)."""
OLD = f"held up until just now, and this may be an old request; ask again in {AWAKE_S:g} s"


@dataclass
class Standstill:
    """``turn`` is called at short intervals by the loop, ``refusal`` before it obeys. Times [s] of a monotonic clock.

    Whoever asked has been told that nobody answered, or is gone; who is still there asks again.
    """

    _turned_s: float = math.inf
    _woke_s: float = -math.inf

    def turn(self, now_s: float) -> None:
        """The loop turns."""
        if now_s - self._turned_s > LIMIT_S:
            self._woke_s = now_s
        self._turned_s = now_s

    def refusal(self, now_s: float) -> str:
        """Why nothing may begin; an empty string where the loop did not stand still just before."""
        # What was asked may come before the timer that turns, or after it.
        self.turn(now_s)
        return OLD if now_s - self._woke_s <= AWAKE_S else ""
