"""One live trial: set-points in, leg states and frames out, on the robot's own time (no ROS)."""

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbot_common.topics import LEGS
from sandbot_lab.cameras import Frame, LabCamera
from sandbot_lab.robot import BodyState, LabRobot
from sandbot_lab.week import FIRST, Occasion
from sandbot_lab.world import START_X_M, World, null_world

Floats = NDArray[np.float64]
NANO = 1_000_000_000
LED_ON_S = 0.05
"""The synchronisation LED flashes this long from the moment the legs start."""
_REMEMBERED = 64


class RecentMotion:
    """The last moments of the body, as much as a film camera needs of a trace."""

    def __init__(self) -> None:
        """Nothing has moved yet."""
        self._moments: deque[tuple[float, float, float, float]] = deque(maxlen=_REMEMBERED)
        self._legs: deque[Floats] = deque(maxlen=_REMEMBERED)

    def append(self, state: BodyState) -> None:
        """The newest moment."""
        self._moments.append((state.t_s, state.x_m, state.z_m, state.pitch_rad))
        self._legs.append(state.leg_angle_rad)

    def _column(self, index: int) -> Floats:
        return np.array([moment[index] for moment in self._moments])

    @property
    def t_s(self) -> Floats:
        """Time since the legs started, (n,)."""
        return self._column(0)

    @property
    def x_m(self) -> Floats:
        """Place of the com along the track, (n,)."""
        return self._column(1)

    @property
    def z_m(self) -> Floats:
        """Axle height, (n,)."""
        return self._column(2)

    @property
    def pitch_rad(self) -> Floats:
        """Nose-up pitch, (n,)."""
        return self._column(3)

    @property
    def leg_angle_rad(self) -> Floats:
        """Shaft angles of the legs, (n, legs)."""
        return np.array(self._legs)


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
    ) -> None:
        """``cameras``: sections of cameras.yaml by name; none for a trial without images. Raises InputError."""
        self.t0_ns = t0_ns
        self._robot = LabRobot(world.at(occasion), phi - world.week.phi_zero, seed, start_x_m)
        self._week, self._start_x_m = world.week, start_x_m
        self._sunk_m = world.week.lift_offset_m(occasion)
        self._cameras = {
            name: LabCamera(name, camera, seed, world.body, world.film) for name, camera in cameras.items()
        }
        self._taken = dict.fromkeys(cameras, 0)
        self._motion = RecentMotion()

    def advance(self, t_ns: int, angles: Floats, rates: Floats) -> BodyState:
        """The robot at a set-point's time. Raises InputError if time runs backwards or a value isn't finite."""
        state = self._robot.advance((t_ns - self.t0_ns) / NANO, angles, rates)
        # As the cameras see it (`as_seen`): off their scale, and a lift read too high began too low.
        x_m = self._week.seen_x_m(state.x_m, self._start_x_m)
        self._motion.append(replace(state, x_m=x_m, z_m=state.z_m - self._sunk_m))
        self._sunk_m = 0.0
        return state

    def frames(self) -> Iterator[tuple[str, int, Frame]]:
        """Camera, stamp [ns] and pixels of every frame whose exposure has ended since the last call."""
        if not self._taken:
            return
        now_s = float(self._motion.t_s[-1])
        for name, camera in self._cameras.items():
            while (t_s := camera.instant_s(self._taken[name])) + camera.calibration.exposure_s / 2 <= now_s:
                come, self._taken[name] = camera.comes(self._taken[name]), self._taken[name] + 1
                frame = camera.film(self._motion, t_s, t_s < LED_ON_S)
                for _ in range(come):
                    yield name, self.t0_ns + round(t_s * NANO), frame


def warm_up(cameras: Mapping[str, Mapping[str, Any]]) -> None:
    """Compile what a live trial runs (seconds, once a machine), so that no leg waits for it."""
    trial = LiveTrial(null_world(), 0.6, 0, START_X_M, cameras, 0)
    for t_ns in (0, 10_000_000):
        trial.advance(t_ns, np.zeros(len(LEGS)), np.zeros(len(LEGS)))
        list(trial.frames())
