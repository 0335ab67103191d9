"""A ground of another kind, which shares no formula with lab or model: nothing of the catalogue is named."""

import pytest

import second_ground
from sandbot_lab.direct import direct_trials
from sandbot_lab.resistive import ResistiveGround
from sandbot_lab.world import World
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.discover import discover
from sandbot_model.physics.catalogue import catalogue
from sandbot_record.trials.table import Row, from_rows

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


def test_nothing_is_named_on_a_ground_of_another_kind():
    rows = direct_trials(
        World(resistive=ResistiveGround()), [0.58, 0.605, 0.633], [4, 8, 12, 16, 24], "UNIFORM", 2, seed=2
    )
    few = {name: catalogue()[name] for name in ("disturbed_ground", "exact_vertical_acceleration", "leg_slip")}
    verdict = discover(cells_of(from_rows([Row(**row) for row in rows])), few, max_effects=2).verdict
    assert (verdict.status, verdict.effects) == ("unexplained", ())


@pytest.mark.whole
@pytest.mark.parametrize(("seen", "noise"), [("all four", 0.005), ("speed alone", 0.005), ("speed alone", 0.01)])
def test_with_the_whole_catalogue_as_well(seen, noise):
    said = second_ground.analyse(second_ground.Case("as the lab has it", seen, noise, 11))
    assert (said["status"], said["effects"]) == ("unexplained", [])
