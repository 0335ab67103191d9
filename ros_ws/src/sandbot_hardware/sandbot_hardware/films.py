"""The two simulated cameras, in their own process: rendering must not delay the legs.

It receives the same set-points as the robot and simulates the same robot with the same random seed. Frames carry the
devices' time, so transmission delays don't matter.
"""

import signal
import time
from collections.abc import Mapping
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from sandbot_common import topics
from sandbot_common.process import ask_for_real_time
from sandbot_common.robot import Robot
from sandbot_hardware import lines
from sandbot_hardware.pseudo_terminal import Terminal
from sandbot_lab.cameras import LabCamera
from sandbot_lab.live_trial import NANO, LiveTrial, warm_up
from sandbot_lab.world import START_X_M, null_world

CAMERAS = tuple(topics.VIEWS)
JPEG_QUALITY = 95
PRIORITY = 1
"""Real time, as a real camera keeps its rate however busy the host is; but below all nodes that command."""
BEHIND_S = 0.1
"""Frames of a standing robot catch up on delays up to this; after a walk, or a longer delay, their times restart."""


def film(
    folder: Path, sections: Mapping[str, Any], robot: Robot, seed: int, boot_s: float, orders: "Connection[Any, Any]"
) -> None:
    """Film until the orders end: (pull or plug, camera), (begin, φ, t0, seed), (walk, t, angles, rates), (rest,).

    ``boot_s``: the monotonic time at which the devices' time is 0; orders carry device time [ns].
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches it, too, but the devices end together
    warm_up(sections)
    ask_for_real_time(PRIORITY)
    films = _Films(folder, sections, robot, seed, boot_s)
    orders.send("ready")
    try:
        while True:
            if orders.poll(films.due_s):
                films.obey(*orders.recv())
            else:
                films.stand()
    except EOFError:
        return


class _Films:
    def __init__(self, folder: Path, sections: Mapping[str, Any], robot: Robot, seed: int, boot_s: float) -> None:
        self._sections, self._robot, self._seed, self._boot_s = sections, robot, seed, boot_s
        self._world = null_world().walked_by(robot)
        self._standing = {name: LabCamera(name, sections[name], seed, robot) for name in CAMERAS}
        self._period_s = 1.0 / self._standing["dorsal"].calibration.frame_rate_hz
        self._trial: LiveTrial | None = None
        self._filmed_s = 0.0
        self._ports = {name: Terminal(folder / name) for name in CAMERAS}

    @property
    def due_s(self) -> float | None:
        """Time until the next frame of a standing robot; None while it walks, when set-points trigger the frames."""
        return None if self._trial else max(self._filmed_s + self._period_s - self._now_s(), 0.0)

    def obey(self, order: str, *given: Any) -> None:
        """Execute one order."""
        match order:
            case "pull" | "plug":
                getattr(self._ports[given[0]], order)()
            case "begin":
                phi, t0_ns, seed = given
                self._trial = LiveTrial(self._world, phi, seed, START_X_M, self._sections, t0_ns, scene=self._seed)
            case "walk" if self._trial:
                self._trial.advance(*given)
                for name, stamp_ns, pixels in self._trial.frames():
                    self._send(name, stamp_ns / NANO, pixels)
            case "rest":
                self._trial = None

    def stand(self) -> None:
        """Send a frame of the robot at its starting position."""
        now_s, due_s = self._now_s(), self._filmed_s + self._period_s
        self._filmed_s = due_s if now_s - due_s < BEHIND_S else now_s
        for name, camera in self._standing.items():
            if self._ports[name].idle:  # otherwise nobody reads
                self._send(name, self._filmed_s, camera.render(START_X_M, self._robot.axle_height_m))

    def _now_s(self) -> float:
        return time.monotonic() - self._boot_s

    def _send(self, name: str, t_s: float, pixels: Any) -> None:
        def message() -> bytes:
            _, jpeg = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
            return lines.encode_block("C", round(t_s * 1e6), np.asarray(jpeg).tobytes())

        self._ports[name].say(message)
