"""The simulated devices: what they can't be made of is answered before there is any."""

import contextlib
import io
import os
import queue
import signal
import subprocess
import sys
from functools import partial
from subprocess import PIPE
from types import SimpleNamespace

import psutil
import pytest
import yaml

from sandbot_bringup.config import config_folder
from sandbot_common import cli
from sandbot_common.errors import InputError
from sandbot_common.yaml_text import read_yaml
from sandbot_hardware import simulate, simulate_command
from sandbot_hardware.simulate import Trackway


@pytest.mark.parametrize(
    ("dorsal", "said"),
    [
        ({"fx": -1.0}, "camera dorsal: fx: -1"),
        ({"plane": {"normal": "y", "offset_m": 0.1}}, "normal is z"),
        (None, "no 'dorsal' camera in it"),
    ],
)
def test_cameras_that_cant_film_leave_no_devices(tmp_path, capsys, dorsal, said):
    cameras, file = read_yaml(config_folder() / "cameras.yaml"), tmp_path / "bad.yaml"
    file.write_text(yaml.safe_dump(cameras | {"dorsal": None if dorsal is None else cameras["dorsal"] | dorsal}))
    assert simulate_command.main([str(tmp_path / "dev"), "--cameras", str(file)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"error: {file}: " in line
    assert said in line
    assert not (tmp_path / "dev").exists()


def test_what_one_device_cannot_do_is_printed_and_ends_no_other(capsys):
    def fails(_now_s):
        raise InputError("set-points: a leg would turn at 4e+04 rad/s")

    trackway, said = object.__new__(Trackway), []
    trackway._boot_s = 0.0
    ports = {name: partial(lambda name, make: said.append((name, make())), name) for name in ("legs", "bed")}
    trackway.ports = {name: SimpleNamespace(say=say) for name, say in ports.items()}
    trackway._say("legs", fails)
    trackway._say("bed", lambda now_s: [b"H"])
    assert said == [("bed", b"H")]
    assert capsys.readouterr().out == "legs: set-points: a leg would turn at 4e+04 rad/s\n"


@pytest.mark.parametrize(("given", "different"), [(0, 3), (7, 1)])
def test_legs_and_films_of_a_trial_share_its_seed_and_no_other_trial_has_it(monkeypatch, given, different):
    walked = []
    monkeypatch.setattr(simulate, "LiveTrial", lambda world, phi, seed, *more: walked.append(seed))
    devices = object.__new__(Trackway)
    devices._world, devices._phi, devices._seed = None, 0.61, 1
    devices._every_seed, devices._trials, devices._orders = given, 0, queue.SimpleQueue()
    for at_s in (1.0, 2.0, 3.0):
        devices._begin(at_s)
    assert len(set(walked)) == different
    assert [devices._orders.get()[-1] for _ in walked] == walked


def test_a_mistyped_order_is_told_and_the_devices_go_on(tmp_path, monkeypatch, capsys):
    pulled = []

    class Devices:
        def __init__(self, *_):
            pass

        def step(self):
            if pulled:
                raise KeyboardInterrupt

        def cable(self, do, name):
            pulled.append((do, name))

        def close(self):
            pulled.append("closed")

    monkeypatch.setattr(simulate, "Trackway", Devices)
    monkeypatch.setattr("sys.stdin", io.StringIO("pul legs\npull legs\n"))
    assert simulate_command.main([str(tmp_path)]) == cli.INTERRUPTED
    assert pulled == [("pull", "legs"), "closed"]
    assert "error: 'pul legs' is not pull or plug with one of" in capsys.readouterr().err


@pytest.fixture
def devices(tmp_path):
    """The simulated devices, and the process of their cameras."""
    command = [sys.executable, "-m", "sandbot_hardware.simulate_command", str(tmp_path / "devices")]
    process = subprocess.Popen(command, stdout=PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True)
    assert process.stdout.readline().startswith("devices: ")
    (cameras,) = [one for one in psutil.Process(process.pid).children() if "--multiprocessing-fork" in one.cmdline()]
    yield process, cameras
    for one in (process, cameras):
        with contextlib.suppress(psutil.NoSuchProcess):
            one.kill()
    process.communicate()


def test_devices_end_with_the_process_of_their_cameras(devices):
    """They went on, and their cameras were silent for no reason that anybody told."""
    process, cameras = devices
    cameras.kill()
    said = process.communicate(timeout=60)[0]
    assert said.endswith("error: the process of the simulated cameras has ended; start all devices again\n")
    assert process.returncode == 2


@pytest.mark.parametrize("frozen", [False, True])
def test_ctrl_c_ends_all_devices_in_one_line(devices, frozen):
    """Frozen cameras kept all of them from ending."""
    process, cameras = devices
    if frozen:
        cameras.suspend()
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    said = process.communicate(timeout=60)[0]
    assert said.splitlines() == ["simulate_command.py: interrupted; what was finished is kept"]
    assert process.returncode == cli.INTERRUPTED
    cameras.wait(timeout=60)
