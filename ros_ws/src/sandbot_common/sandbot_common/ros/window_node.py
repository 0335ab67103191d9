"""Flow control: large messages are sent no faster than they are read."""

import time
from collections.abc import Sequence

from rclpy.duration import Duration
from rclpy.publisher import Publisher

PATIENCE_S = 1.0
_AT_ONCE = Duration(seconds=0)


class Window:
    """Whether there is room for one more message: at most ``most`` messages of some publishers are unacknowledged.

    Reliable delivery does not throttle the sender. A reader that gets no CPU leaves shared memory full, and then every
    topic of the sender loses messages (decision 6). A reader that takes nothing for ``PATIENCE_S`` has died or is
    frozen, and is not waited for until it has caught up.
    """

    def __init__(self, publishers: Sequence[Publisher], most: int) -> None:
        self._outlets, self._most = publishers, most
        self._sent, self._full_s = 0, 0.0

    @property
    def open(self) -> bool:
        """Whether to send. Asked before each message."""
        if all(publisher.wait_for_all_acked(_AT_ONCE) for publisher in self._outlets):
            self._sent = 0
        return self._sent < self._most or time.monotonic() - self._full_s > PATIENCE_S

    @property
    def unread(self) -> int:
        """The most messages that can have been unacknowledged at the last check."""
        return self._sent

    def sent(self) -> None:
        """One more message has been sent."""
        self._sent += 1
        if self._sent == self._most:
            self._full_s = time.monotonic()
