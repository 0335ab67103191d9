"""The world of a batch campaign: a file, a drawn one, or a drawn effect beside those of a file."""

import pytest

from sandbot_bringup.batch import check_film, choose_world
from sandbot_bringup.config import config_folder
from sandbot_bringup.folder import CampaignFolder
from sandbot_bringup.plan import Plan
from sandbot_common.errors import InputError
from sandbot_common.robot import SANDBOT
from sandbot_lab.film import Film
from sandbot_lab.world import World, draw_additional, draw_world, null_world, write_world

GIVEN = World(delta_t_s=0.18, effects={"belly_coast": {"mu_b": 0.35}})


@pytest.fixture
def file(tmp_path):
    write_world(GIVEN, tmp_path / "world.yaml")
    return tmp_path / "world.yaml"


def test_a_seed_hides_an_effect_in_the_null_world_or_in_that_of_a_file(tmp_path, file):
    folder = CampaignFolder(tmp_path / "new")
    assert choose_world(folder, SANDBOT, None, None) == null_world()
    assert choose_world(folder, SANDBOT, None, 7) == draw_world(7)
    assert choose_world(folder, SANDBOT, file, None) == GIVEN
    assert choose_world(folder, SANDBOT, file, 7) == draw_additional(GIVEN, 7)
    assert len(draw_additional(GIVEN, 7).effects) == 2


def test_a_campaign_without_a_truth_is_of_another_ground(tmp_path):
    """A real bed's, say: simulated bags among the measured ones are no campaign."""
    folder = CampaignFolder(tmp_path / "live")
    folder.adopt(Plan(name="live", phi=(0.6,), omega_rad_s=(8.0,)), {})
    with pytest.raises(InputError, match=r"has a campaign and no truth/world\.yaml"):
        choose_world(folder, SANDBOT, None, None)


def test_a_film_that_the_cameras_can_not_take_is_refused_before_anything_is_written():
    files = {"cameras.yaml": (config_folder() / "cameras.yaml").read_text(encoding="utf-8")}
    check_film(World(film=Film(jitter_s=0.004)), files)
    with pytest.raises(InputError, match="film: jitter_s: 1 s is too much at 100 frames/s"):
        check_film(World(film=Film(jitter_s=1.0)), files)
