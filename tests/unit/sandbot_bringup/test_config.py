"""The files that a plan names: which are taken, and that the virtual lab can film with them."""

import pytest
import yaml

from sandbot_bringup.config import config_folder, files_of
from sandbot_bringup.folder import CampaignFolder
from sandbot_bringup.plan import Plan, trials_of
from sandbot_bringup.tools import campaign
from sandbot_common.errors import InputError
from sandbot_common.yaml_text import load_yaml, read_yaml
from sandbot_lab.cameras import check_cameras

PLAN = Plan(name="tiny", phi=(0.6,), omega_rad_s=(8.0,), cameras="mine.yaml", robot="robot.yaml")


@pytest.fixture
def write(tmp_path):
    """Writes the cameras of the plan, the dorsal one with a key changed; its robot has a byte order mark."""
    cameras = read_yaml(config_folder() / "cameras.yaml")
    (tmp_path / "robot.yaml").write_text((config_folder() / "robot.yaml").read_text("utf-8"), "utf-16")
    (tmp_path / "plan.yaml").write_text(
        "name: tiny\nphi: [0.6]\nomega_rad_s: [8]\ncameras: mine.yaml\nrobot: robot.yaml\n"
    )

    def write(**changed):
        text = yaml.safe_dump(cameras | {"dorsal": cameras["dorsal"] | changed})
        (tmp_path / "mine.yaml").write_text(text)
        return text

    return write


def test_the_files_of_the_plan_hold_until_a_trial_is_finished(tmp_path, write):
    folder = CampaignFolder(tmp_path / "tiny")
    first = write(exposure_s=0.003)
    folder.adopt(PLAN, files_of(PLAN, tmp_path, folder.path))
    repaired = write(exposure_s=0.004)
    assert files_of(PLAN, tmp_path, folder.path)["cameras.yaml"] == repaired
    # Who resumes the folder itself has repaired what is in it.
    assert files_of(PLAN, folder.path, folder.path)["cameras.yaml"] == first
    bag = folder.bag(trials_of(PLAN)[0])
    bag.mkdir(parents=True)
    (bag / "metadata.yaml").touch()
    assert files_of(PLAN, tmp_path, folder.path)["cameras.yaml"] == first


@pytest.mark.parametrize(
    ("key", "value", "said"), [("plane", {"normal": "y", "offset_m": 0.1}, "normal is z"), ("width", 8, "width: 8")]
)
def test_cameras_that_the_lab_cant_film_with_are_refused_before_anything_is_written(
    tmp_path, write, capsys, key, value, said
):
    write(**{key: value}, led_region=None)
    assert campaign.main([str(tmp_path / "plan.yaml"), "--batch"]) == 2
    error = capsys.readouterr().err
    assert "error: mine.yaml: camera dorsal: " in error
    assert said in error
    assert not (tmp_path / "tiny").exists()


@pytest.mark.parametrize(("key", "value"), [("exposure_s", 0.008), ("distortion", [0.1, 0.0, 0.0, 0.0])])
def test_what_the_tracker_reads_the_lab_films_with(tmp_path, write, key, value):
    write(**{key: value})
    check_cameras(load_yaml(files_of(PLAN, tmp_path, tmp_path / "none")["cameras.yaml"]), "mine.yaml")


def test_three_numbers_are_no_lens(tmp_path, write):
    write(distortion=[0.1, 0.0, 0.0])
    with pytest.raises(InputError, match="has 3 numbers"):
        files_of(PLAN, tmp_path, tmp_path / "none")
