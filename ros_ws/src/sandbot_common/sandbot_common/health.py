"""What nodes say on /diagnostics that other nodes act on: names of figures, and the words of an orderly end.

What only people read is named where it is measured.
"""

from collections.abc import Mapping

from sandbot_common.typed import number_or_nan

PROCESS = "process"
"""Of every node: which process it is, for nodes on the same host (``process.Neighbour``)."""
TIMELESS = "timeless"
"""Of every node: why its stamps show no time, if they don't."""
AIR_STOPS = "air_stops"
"""Of a blower's driver: how often it has turned the air off by itself, against its orders."""
LOST_FRAMES = "lost_frames"
"""Of the tracker: views without a partner."""
CALIBRATION = "calibration"
"""Of the tracker: the checksum of its cameras' calibration."""
LEGS_STOPPED = "legs stopped: "
"""How a robot's driver begins the text that says why it has brought the legs to rest."""

FRAMES, PERIOD_MS, CALIBRATED_MS = "frames", "period_ms", "calibrated_ms"
"""Of a camera: new frames, and their period as stamped and as calibrated [ms]."""
CLOCK, BY_THE_LED, UNPLACED = "clock", "by the LED", "unknown"
BEHIND_MS = "behind_robot_ms"
"""Of a camera: how its clock was set to the robot's time, and the one way that is exact."""
LED_EDGES, CLOCK_JUMPS = "led_edges", "clock_jumps"
"""Of a camera: flashes seen, and how often its clock disagreed with them."""
MISSING = "missing"
"""Of a camera: markers that were not found, those of all frames together."""
MOVED_PX = "moved_px"
"""Of a camera: how far it has moved since the legs of this trial began to walk [px]; 0 if it stands still."""

_ENDED = "ended: "


def of_camera(camera: str, figure: str) -> str:
    """The name of a camera's figure among those of the tracker."""
    return f"{camera}_{figure}"


def figure(values: Mapping[str, str], name: str) -> float:
    """A figure of a node's status: 0 before it has one, NaN if it is not a number, which exceeds nothing."""
    return number_or_nan(values.get(name, 0))


def ending(why: str) -> str:
    """The last text of a node that ends in order."""
    return f"{_ENDED}{why}"


def has_ended(text: str) -> bool:
    """Whether this is the last text of a node."""
    return text.startswith(_ENDED)
