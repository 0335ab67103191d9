"""One live trial: set-points in, leg states and frames out, in the robot's own time (no ROS)."""

import math
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice, takewhile
from typing import Any

import numpy as np

from sandbot_common.arrays import Floats, Frame
from sandbot_common.topics import LEGS
from sandbot_lab.cameras import LabCamera
from sandbot_lab.robot import BodyState, LabRobot
from sandbot_lab.week import FIRST, Occasion, seen_x_m
from sandbot_lab.world import START_X_M, World, null_world

NANO = 1_000_000_000
LED_ON_S = 0.05
"""The synchronisation LED flashes this long from the moment the legs start."""
_REMEMBERED = 64


@dataclass(frozen=True)
class Moments:
    """A piece of the body's motion as a camera needs it (``cameras.Motion``): (n,), and (n, legs) the legs."""

    t_s: Floats
    x_m: Floats
    z_m: Floats
    pitch_rad: Floats
    leg_angle_rad: Floats


class RecentMotion:
    """The motion that no frame has shown yet, with the last moments before it."""

    def __init__(self) -> None:
        """Empty."""
        self._states: deque[BodyState] = deque()

    def append(self, state: BodyState) -> None:
        """Append the newest moment."""
        self._states.append(state)

    @property
    def newest_s(self) -> float:
        """Time of the newest moment; -inf before the first."""
        return self._states[-1].t_s if self._states else -math.inf

    def until(self, t_s: float) -> Moments:
        """The moments up to the first one at or after ``t_s``; much older ones are discarded."""
        count = 1 + sum(1 for _ in takewhile(lambda state: state.t_s < t_s, self._states))
        for _ in range(count - _REMEMBERED):
            self._states.popleft()
        shown = list(islice(self._states, min(count, _REMEMBERED)))
        t, x, z, pitch = np.array([(state.t_s, state.x_m, state.z_m, state.pitch_rad) for state in shown]).T
        return Moments(t, x, z, pitch, np.array([state.leg_angle_rad for state in shown]))


class LiveTrial:
    """The robot from the first moving set-point on, and the frames its cameras take at t0 + k / frame rate."""

    def __init__(
        self,
        world: World,
        phi: float,
        seed: int,
        start_x_m: float,
        cameras: Mapping[str, Mapping[str, Any]],
        t0_ns: int,
        occasion: Occasion = FIRST,
        scene: int | None = None,
    ) -> None:
        """``cameras``: sections of cameras.yaml by name; none for a trial without images. ``scene``: the random seed of
        what they show beside the robot, by default the trial's own. Raises InputError.
        """
        self.t0_ns = t0_ns
        self._robot = LabRobot(world.at(occasion), phi - world.week.phi_zero, seed, start_x_m)
        self._start_x_m, self._scale_error = start_x_m, world.week.scale_error(occasion)
        self._sunk_m = world.week.lift_offset_m(occasion)
        self._cameras = {
            name: LabCamera(name, camera, seed if scene is None else scene, world.body, world.film)
            for name, camera in cameras.items()
        }
        self._taken = dict.fromkeys(cameras, 0)
        self._motion = RecentMotion()

    def advance(self, t_ns: int, angles: Floats, rates: Floats) -> BodyState:
        """The robot at a set-point's time. Raises InputError if time runs backwards or a value isn't finite."""
        state = self._robot.advance((t_ns - self.t0_ns) / NANO, angles, rates)
        # As the cameras see it (`as_seen`): with a scale error, and an offset of the starting height.
        if self._cameras:
            x_m = seen_x_m(state.x_m, self._start_x_m, self._scale_error)
            self._motion.append(replace(state, x_m=x_m, z_m=state.z_m - self._sunk_m))
        self._sunk_m = 0.0
        return state

    @property
    def due(self) -> bool:
        """Whether a frame can be taken: its exposure has ended."""
        return bool(self._cameras) and self._next()[1] <= self._motion.newest_s

    def frames(self) -> Iterator[tuple[str, int, Frame]]:
        """Every frame that is due, the earliest first."""
        while self.due:
            yield from self.take()

    def take(self) -> list[tuple[str, int, Frame]]:
        """Camera, stamp [ns] and pixels of the earliest frame due, repeated as many times as it is sent."""
        name, end_s = self._next()
        camera, number = self._cameras[name], self._taken[name]
        self._taken[name] += 1
        t_s = camera.instant_s(number)
        frame = camera.film(self._motion.until(end_s), t_s, t_s < LED_ON_S)
        return [(name, self.t0_ns + round(t_s * NANO), frame)] * camera.comes(number)

    def _next(self) -> tuple[str, float]:
        """The camera whose next exposure ends first, and when [s since the legs started]."""
        ends = {
            name: camera.instant_s(self._taken[name]) + camera.calibration.exposure_s / 2
            for name, camera in self._cameras.items()
        }
        name = min(ends, key=ends.__getitem__)
        return name, ends[name]


def warm_up(cameras: Mapping[str, Mapping[str, Any]]) -> None:
    """Compile the functions of a live trial (seconds, once per machine), so that no leg waits for it."""
    trial = LiveTrial(null_world(), 0.6, 0, START_X_M, cameras, 0)
    for t_ns in (0, 10_000_000):
        trial.advance(t_ns, np.zeros(len(LEGS)), np.zeros(len(LEGS)))
        list(trial.frames())
