"""Conversion between clocks: from a device's to the host's, and within the device the other way round.

A message arrives later than it was sent, by a delay that is never negative. So the smallest difference between arrival
and device time is the best estimate of the clocks' offset; it may grow no faster than two clocks drift apart. So the
host's clock must be one that nobody sets forward.
"""

_DRIFT = 1e-4
_REBOOT_NS = 1_000_000_000
"""A device whose time goes back by more than this has been restarted."""


class DeviceClock:
    """Fed with the device time and arrival time of each message [ns]."""

    def __init__(self) -> None:
        self._offset_ns: int | None = None
        self._last_ns = self._received_ns = 0

    def host_ns(self, device_ns: int, received_ns: int) -> int:
        """When the device sent the message, on the clock of ``received_ns``, which nobody may set."""
        gap_ns = received_ns - device_ns
        if self._offset_ns is None or device_ns < self._last_ns - _REBOOT_NS:
            self._offset_ns = gap_ns
        else:
            drifted_ns = round(_DRIFT * max(received_ns - self._received_ns, 0))
            self._offset_ns = min(gap_ns, self._offset_ns + drifted_ns)
        self._last_ns, self._received_ns = device_ns, received_ns
        return device_ns + self._offset_ns
