"""The four devices on pseudo-terminals, connected to the virtual lab's bed, robot and cameras."""

import multiprocessing
import os
import queue
import select
import sys
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sandbot_common.errors import InputError
from sandbot_common.files import writing
from sandbot_common.process import ask_for_real_time
from sandbot_common.robot import Robot
from sandbot_common.yaml_text import read_yaml
from sandbot_hardware.devices import BedController, LegController
from sandbot_hardware.films import CAMERAS, film
from sandbot_hardware.lines import Line
from sandbot_hardware.pseudo_terminal import Terminal
from sandbot_lab.bed import LabBed
from sandbot_lab.cameras import check_cameras
from sandbot_lab.live_trial import NANO, LiveTrial, warm_up
from sandbot_lab.week import trial_seed
from sandbot_lab.world import START_X_M, null_world

CONTROLLERS = ("bed", "legs")
PORTS = (*CONTROLLERS, *CAMERAS)
TICK_S = 0.005
PRIORITY = 10
"""Real-time priority of the controllers: a real one has a processor to itself."""


class Trackway:
    """The devices, and the world behind them."""

    def __init__(
        self, folder: Path, cameras: Path, robot: Robot, seed: int, phi: float, lease_s: float, every_seed: int = 0
    ) -> None:
        """``every_seed``: the random seed of every trial; 0: another one each time."""
        sections: dict[str, Any] = read_yaml(cameras)
        check_cameras(sections, str(cameras))
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
        self._world, self._phi = null_world().walked_by(robot), phi
        self._seed, self._every_seed, self._trials = seed, every_seed, 0
        warm_up({})
        self._bed, self._bed_s = LabBed(seed), 0.0
        self._trial: LiveTrial | None = None
        self._boot_s = time.monotonic() - 100.0  # each device's clock runs since it was switched on
        self.legs = LegController(len(robot.leg_order), self._walk, self._begin, lease_s)
        self.bed = BedController(self._blow, self._height_m)
        self.ports = {name: Terminal(folder / name) for name in CONTROLLERS}
        # Spawned, as there are threads by now; it ends with this process, when the pipe closes.
        context = multiprocessing.get_context("spawn")
        self._films, orders = context.Pipe()
        self._orders: queue.SimpleQueue[tuple[Any, ...]] = queue.SimpleQueue()
        filmed = {name: sections[name] for name in CAMERAS}  # the file may have other sections, such as accuracy
        self._filming = context.Process(
            target=film, args=(folder, filmed, robot, seed, self._boot_s, orders), daemon=True
        )
        self._filming.start()
        orders.close()
        self._films.recv()
        # Before the thread, which inherits it: cameras that learn of the first step late still show the LED dark.
        ask_for_real_time(PRIORITY)
        threading.Thread(target=self._direct, name="films", daemon=True).start()

    def close(self) -> None:
        """End the cameras' process, a frozen one as well, for which an ordinary exit would wait."""
        self._filming.kill()

    def now_s(self) -> float:
        """The devices' time."""
        return time.monotonic() - self._boot_s

    def step(self) -> None:
        """Wait briefly for lines, obey them, and run the watchdogs. Raises InputError if the cameras' process ended."""
        by_file = {port.master: name for name, port in self.ports.items() if port.master is not None}
        cameras = self._filming.sentinel
        ready, _, _ = select.select([*by_file, cameras], [], [], TICK_S)
        if cameras in ready:
            raise InputError("the process of the simulated cameras has ended; start all devices again")
        for file in ready:
            name = by_file[file]
            try:
                data = os.read(file, 65536)
            except OSError:
                continue  # nobody has it open
            for line in self.ports[name].reader.feed(data):
                self._heard(name, line)
        self._look()

    def cable(self, order: str, name: str) -> None:
        """``pull`` or ``plug`` a device's cable."""
        if name in self.ports:
            getattr(self.ports[name], order)()
        else:
            self._orders.put((order, name))

    def _heard(self, name: str, line: Line) -> None:
        was_moving, was_blowing = self.legs.moving, self.bed.level > 0
        device: Any = {"legs": self.legs, "bed": self.bed}[name]
        self._say(name, partial(device.heard, line))
        if self.legs.moving != was_moving:
            print(f"legs: {'moving' if self.legs.moving else 'at rest'}", flush=True)
        if (self.bed.level > 0) != was_blowing:
            print(f"bed: air {'on' if self.bed.level > 0 else 'off'}", flush=True)
        self._rest(was_moving)

    def _look(self) -> None:
        was_moving, was_blowing = self.legs.moving, self.bed.level > 0
        for name, device in (("legs", self.legs), ("bed", self.bed)):
            self._say(name, device.tick)
        if was_moving and not self.legs.moving:
            print(f"legs: at rest by themselves {self.now_s() - self.legs.obeyed_s:.3f} s after the last set-point")
        if was_blowing and not self.bed.level:
            print(f"bed: air off by itself {self.now_s() - self.bed.obeyed_s:.3f} s after the last level", flush=True)
        sys.stdout.flush()
        self._rest(was_moving)

    def _say(self, name: str, act: Callable[[float], list[bytes]]) -> None:
        """Send what a device says now. What it can't do is printed, and ends neither it nor the others."""
        try:
            said = act(self.now_s())
        except InputError as error:
            print(f"{name}: {error}", flush=True)
            return
        for message in said:
            self.ports[name].say(partial(bytes, message))

    def _direct(self) -> None:
        # In a thread: slow rendering fills the pipe, which must not delay the legs.
        while True:
            self._films.send(self._orders.get())

    def _begin(self, now_s: float) -> None:
        phi, t0_ns = self._phi or self._bed.phi, round(now_s * NANO)
        seed = self._every_seed or trial_seed(self._seed, self._trials)
        self._trials += 1
        self._trial = LiveTrial(self._world, phi, seed, START_X_M, {}, t0_ns)
        self._orders.put(("begin", phi, t0_ns, seed))

    def _walk(self, now_s: float, angles: Sequence[float], rates: Sequence[float]) -> Any:
        if self._trial is None or not any(rates):
            return angles, rates, np.zeros(len(angles))
        moved = round(now_s * NANO), np.asarray(angles), np.asarray(rates)
        self._orders.put(("walk", *moved))
        state = self._trial.advance(*moved)
        return state.leg_angle_rad, state.leg_rate_rad_s, state.leg_effort_n_m

    def _rest(self, was_moving: bool) -> None:
        if was_moving and not self.legs.moving:
            self._orders.put(("rest",))

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
            trackway.cable(do, name)
            print(f"{name}: {do}ed".replace("pluged", "plugged"), flush=True)
        case []:
            pass
        case _:
            raise InputError(f"{order.strip()!r} is not pull or plug with one of {', '.join(PORTS)}")
