"""Whether a trial's camera data can be trusted, by what the tracker reports of its cameras.

A campaign hears it live, and a bag holds it on /diagnostics: the same is found in a bag recorded without a campaign, or
of frames that `replay` played into a tracker.
"""

from collections.abc import Mapping

from sandbot_common import health, topics
from sandbot_record.bags.reader import Bag

TRACKER = "tracker"
_MARK = TRACKER.encode() + b"\0"

MARKERS = {"dorsal": 1, "lateral": 2}
"""How many each camera shows."""

Values = Mapping[str, str]


def camera_fault(before: Values, after: Values) -> str:
    """Why a trial's camera data can't be trusted, from the tracker's health before and after it; empty if they can.

    A camera that has seen the LED in an earlier trial must see it in this one. A camera that never saw it has no LED in
    view, or films only from the flash on, as the virtual lab's do in the first trial.
    """
    for camera in topics.VIEWS:
        edges, edges_after, jumps, jumps_after, moved_px = (
            health.figure(values, health.of_camera(camera, what))
            for what, values in (
                (health.LED_EDGES, before),
                (health.LED_EDGES, after),
                (health.CLOCK_JUMPS, before),
                (health.CLOCK_JUMPS, after),
                (health.MOVED_PX, after),
            )
        )
        if moved_px > 0:
            return f"the {camera} camera moved by {moved_px:.1f} px during the trial (moved_px)"
        if jumps_after > jumps:
            return f"the {camera} camera's clock jumped, or disagrees with the LED (clock_jumps)"
        if edges and edges_after == edges:
            return f"the {camera} camera did not see the LED, so its clock is uncertain"
    return _unplaced(before, after) or _blind(before, after)


def _unplaced(before: Values, after: Values) -> str:
    """The camera of whose frames no time is known: a frame that arrives late looks like one of a clock that is off."""
    for camera in topics.VIEWS:
        frames = health.of_camera(camera, health.FRAMES)
        if after.get(health.of_camera(camera, health.CLOCK)) != health.UNPLACED:
            continue
        if health.figure(after, frames) > health.figure(before, frames):
            behind_s = health.figure(after, health.of_camera(camera, health.BEHIND_MS)) * 1e-3
            off = f"frames arrive {behind_s:.1f} s late, or its clock is off by that,"
            off = off if behind_s > 0 else f"clock is {-behind_s:.1f} s ahead of the robot's"
            return f"the {camera} camera's {off} and its frames did not show the LED go on"
    return ""


def _blind(before: Values, after: Values) -> str:
    """The camera in none of whose frames any marker was found; an empty string if there is none."""
    for camera, markers in MARKERS.items():
        frames, missing = (
            health.figure(after, name) - health.figure(before, name)
            for name in (health.of_camera(camera, what) for what in (health.FRAMES, health.MISSING))
        )
        if 0 < frames * markers <= missing:
            return f"the {camera} camera shows no marker in any frame: is it covered, or exchanged with the other one?"
    return ""


def fault(bag: Bag) -> str:
    """The same from a bag: of a tracker that was already running when the LED went on."""
    led_ns = int(bag.columns(topics.SYNC_LED.name).log_time_ns[0])
    before, after = _reported(bag, led_ns)
    return camera_fault(before, after) if before else ""


def _reported(bag: Bag, led_ns: int) -> tuple[Values, Values]:
    """The tracker's last figures before the LED's edge, and its last of all; empty if there are none."""
    before: Values = {}
    after: Values = {}
    if topics.DIAGNOSTICS.name not in bag.topics:
        return before, after
    for message in bag.messages([topics.DIAGNOSTICS.name]):
        if _MARK not in bytes(message.data):
            continue  # of another node: to decode all takes long
        for status in message.decode().status:
            if status.name == TRACKER and not health.has_ended(status.message):
                after = {pair.key: pair.value for pair in status.values}
                before = after if message.log_time_ns <= led_ns else before
    return before, after
