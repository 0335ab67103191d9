"""The four devices on pseudo-terminals, behind which are the virtual lab's bed, robot and cameras."""

import os
import select
import sys
import threading
import time
import tty
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from sandbot_common.errors import InputError
from sandbot_common.files import read_yaml
from sandbot_common.robot import Robot
from sandbot_hardware import lines
from sandbot_hardware.devices import BedController, LegController
from sandbot_lab.bed import LabBed
from sandbot_lab.cameras import LabCamera
from sandbot_lab.stage import NANO, LiveTrial, warm_up
from sandbot_lab.world import START_X_M, null_world

CAMERAS = ("dorsal", "lateral")
PORTS = ("bed", "legs", *CAMERAS)
TICK_S = 0.005
JPEG_QUALITY = 95
_QUEUED = 400
"""Frames that wait for a host that does not read, before the oldest are dropped."""


class Terminal:
    """One pseudo-terminal under a name; written in a thread of its own, for a host may be slow to read."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.reader = lines.Reader()
        self.master: int | None = None
        self._slave: int | None = None
        self._waiting: deque[Callable[[], bytes]] = deque(maxlen=_QUEUED)
        self._news = threading.Event()
        self.plug()
        threading.Thread(target=self._send, name=path.name, daemon=True).start()

    def plug(self) -> None:
        """Put the cable in."""
        if self.master is not None:
            return
        master, slave = os.openpty()
        tty.setraw(slave)
        # Our own hold on the other end: the terminal stays while no driver has it open.
        self._slave = slave
        new = self._path.with_suffix(".new")
        new.unlink(missing_ok=True)
        new.symlink_to(os.ttyname(slave))
        new.replace(self._path)
        self.master = master

    def pull(self) -> None:
        """Pull the cable out: whoever has it open reads its end."""
        if self.master is None:
            return
        self._path.unlink(missing_ok=True)
        master, self.master = self.master, None
        os.close(master)
        if self._slave is not None:
            os.close(self._slave)

    def say(self, made: Callable[[], bytes]) -> None:
        """Send soon; what takes long to make is made in the terminal's own thread."""
        self._waiting.append(made)
        self._news.set()

    @property
    def idle(self) -> bool:
        """Whether everything has gone out."""
        return not self._waiting

    def _send(self) -> None:
        while self._news.wait():
            self._news.clear()
            while self._waiting:
                self._write(self._waiting.popleft()())

    def _write(self, message: bytes) -> None:
        data = memoryview(message)
        while data and (master := self.master) is not None:
            try:
                _, ready, _ = select.select([], [master], [], 0.1)
                data = data[os.write(master, data[:4096]) :] if ready else data
            except (OSError, ValueError):
                return  # pulled out meanwhile


class Trackway:
    """The devices, and the world behind them."""

    def __init__(self, folder: Path, cameras: Path, robot: Robot, seed: int, phi: float, lease_s: float) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._sections: dict[str, Any] = {name: read_yaml(cameras)[name] for name in CAMERAS}
        self._world, self._robot, self._phi = null_world().walked_by(robot), robot, phi
        warm_up(self._sections)
        self._bed, self._bed_s = LabBed(seed), 0.0
        self._seed = seed
        self._standing = {name: LabCamera(name, self._sections[name], seed, robot) for name in CAMERAS}
        self._trial: LiveTrial | None = None
        self._next: tuple[float, LiveTrial] | None = None
        self._idle_s = 0.0
        self._boot_s = time.monotonic() - 100.0  # each device's clock runs since it was switched on
        self.legs = LegController(len(robot.leg_order), self._walk, self._begin, lease_s)
        self.bed = BedController(self._blow, self._height_m)
        self.ports = {name: Terminal(folder / name) for name in PORTS}

    def now_s(self) -> float:
        """The devices' own time."""
        return time.monotonic() - self._boot_s

    def step(self) -> None:
        """Wait a moment for lines, obey them, and let the watchdogs look."""
        by_file = {port.master: name for name, port in self.ports.items() if port.master is not None}
        ready, _, _ = select.select(list(by_file), [], [], TICK_S)
        for file in ready:
            name = by_file[file]
            try:
                data = os.read(file, 65536)
            except OSError:
                continue  # nobody has it open
            for line in self.ports[name].reader.feed(data):
                self._heard(name, line)
        self._look()

    def _heard(self, name: str, line: lines.Line) -> None:
        was_moving, was_blowing = self.legs.moving, self.bed.level > 0
        device: Any = {"legs": self.legs, "bed": self.bed}.get(name)
        for reply in device.heard(line, self.now_s()) if device else ():
            self.ports[name].say(partial(bytes, reply))
        if self.legs.moving != was_moving:
            print(f"legs: {'moving' if self.legs.moving else 'at rest'}", flush=True)
        if (self.bed.level > 0) != was_blowing:
            print(f"bed: air {'on' if self.bed.level > 0 else 'off'}", flush=True)
        self._show()

    def _look(self) -> None:
        was_moving, was_blowing = self.legs.moving, self.bed.level > 0
        for name, device in (("legs", self.legs), ("bed", self.bed)):
            for said in device.tick(self.now_s()):
                self.ports[name].say(partial(bytes, said))
        if was_moving and not self.legs.moving:
            print(f"legs: at rest by themselves {self.now_s() - self.legs.silence_s:.3f} s after the last set-point")
        if was_blowing and not self.bed.level:
            print(f"bed: air off by itself {self.now_s() - self.bed.silence_s:.3f} s after the last level", flush=True)
        sys.stdout.flush()
        period_s = 1.0 / self._standing["dorsal"].calibration.frame_rate_hz
        if not self.legs.moving and self.now_s() - self._idle_s >= period_s:
            self._idle_s = self.now_s()
            self._prepare()
            for name, camera in self._standing.items():
                if self.ports[name].idle:  # else nobody reads
                    self._film(name, self._idle_s, camera.render(START_X_M, self._robot.axle_height_m))

    def _prepare(self) -> None:
        """Have the next trial at hand: what takes long to draw must not make the legs late."""
        phi = self._phi or self._bed.phi
        if self._next is None or self._next[0] != phi:
            self._next = phi, LiveTrial(self._world, phi, self._seed, START_X_M, self._sections, 0)

    def _begin(self, now_s: float) -> None:
        self._prepare()
        assert self._next is not None
        self._trial, self._next = self._next[1], None
        self._trial.t0_ns = round(now_s * NANO)

    def _walk(self, now_s: float, angles: Sequence[float], rates: Sequence[float]) -> Any:
        if self._trial is None or not any(rates):
            return angles, rates, np.zeros(len(angles))
        state = self._trial.advance(round(now_s * NANO), np.asarray(angles), np.asarray(rates))
        return state.leg_angle_rad, state.leg_rate_rad_s, state.leg_effort_n_m

    def _show(self) -> None:
        if self._trial is not None and self.legs.moving:
            for name, stamp_ns, pixels in self._trial.frames():
                self._film(name, stamp_ns / NANO, pixels)

    def _film(self, name: str, t_s: float, pixels: Any) -> None:
        def made() -> bytes:
            _, jpeg = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
            return lines.encode_block("C", round(t_s * 1e6), jpeg.tobytes())

        self.ports[name].say(made)

    def _pass_time(self, now_s: float) -> None:
        self._bed.advance(max(now_s - self._bed_s, 0.0))
        self._bed_s = now_s

    def _blow(self, level: float, now_s: float) -> None:
        self._pass_time(now_s)
        self._bed.set_blower(level)

    def _height_m(self, now_s: float) -> float:
        self._pass_time(now_s)
        return self._bed.read_height_m()


def obey(trackway: Trackway, order: str) -> None:
    """``pull NAME`` or ``plug NAME``. Raises InputError for anything else."""
    match order.split():
        case ["pull" | "plug" as do, name] if name in PORTS:
            getattr(trackway.ports[name], do)()
            print(f"{name}: {do}ed".replace("pluged", "plugged"), flush=True)
        case []:
            pass
        case _:
            raise InputError(f"{order.strip()!r} is not pull or plug with one of {', '.join(PORTS)}")
