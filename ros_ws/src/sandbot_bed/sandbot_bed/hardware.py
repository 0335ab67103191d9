"""What the bed's driver must offer: a blower and a height sensor.

A real driver is one class, handed to the node:

    class SerialBed:
        def __init__(self, port: str) -> None:
            self._port = serial.Serial(port, timeout=0.05, write_timeout=0.05)

        def set_blower(self, level: float) -> None:
            self._port.write(f"B{level:.3f}\\n".encode())

        def read_height_m(self) -> float:
            self._port.write(b"H\\n")
            answer = self._port.readline()
            try:
                return float(answer) / 1000
            except ValueError:  # nothing, or half an answer
                return math.nan

    def main(argv=None) -> int:
        return node.run(lambda: BedNode(SerialBed("/dev/ttyUSB0")), argv)

Both calls must return at once (the node makes them at its rate), or raise: a call that blocks on an unresponsive device
keeps the node from turning the air off. The blower's own controller should switch the air off when it receives nothing
for half a second: a crashed program can't.
"""

from typing import Protocol


class BedHardware(Protocol):
    """A blower and a height sensor."""

    def set_blower(self, level: float) -> None:
        """Set the air flow: 0 off, 1 full."""

    def read_height_m(self) -> float:
        """The latest height of the bed's surface above its floor [m]; NaN if there is no reading."""
