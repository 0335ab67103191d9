import pytest
from made_up import Inline, made_up_trials

from sandbot_model.data.conditions import cells_of
from sandbot_model.explore.session import Session


@pytest.fixture(scope="module")
def trials():
    return made_up_trials()


@pytest.fixture(scope="module")
def session(trials):
    return Session(cells_of(trials), Inline())
