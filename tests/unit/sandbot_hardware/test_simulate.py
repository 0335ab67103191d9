"""The simulated devices: what they can't be made of is answered before there is any."""

import io

import pytest
import yaml

from sandbot_bringup.config import config_folder
from sandbot_common import cli
from sandbot_common.files import read_yaml
from sandbot_hardware import simulate, simulate_command


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

    monkeypatch.setattr(simulate, "Trackway", Devices)
    monkeypatch.setattr("sys.stdin", io.StringIO("pul legs\npull legs\n"))
    assert simulate_command.main([str(tmp_path)]) == cli.INTERRUPTED
    assert pulled == [("pull", "legs")]
    assert "error: 'pul legs' is not pull or plug with one of" in capsys.readouterr().err
