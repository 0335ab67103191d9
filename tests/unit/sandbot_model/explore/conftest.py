import numpy as np
import pytest
from inline import Inline
from made_up import PACE, made_up_trials, walking_bag

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.selection import Selection
from sandbot_model.explore.scene import scene_of
from sandbot_model.explore.session import Session
from sandbot_model.physics.observables import Observable


@pytest.fixture(scope="module")
def trials():
    return made_up_trials()


@pytest.fixture(scope="module")
def session(trials):
    return Session(cells_of(trials), Inline())


@pytest.fixture(scope="module")
def bags(tmp_path_factory, trials, session):
    """Two trials of a condition that walks, one of them without legs, and one that swims."""
    folder = tmp_path_factory.mktemp("bags")
    walks = replicates_of(trials, session, walking=True)
    swims = replicates_of(trials, session, walking=False)
    made = {name: walking_bag(folder / name, v_x=lambda t: 0.1 + 0.05 * np.sin(2 * PACE * t)) for name in walks[:1]}
    made[walks[1]] = walking_bag(folder / walks[1], v_x=lambda t: 0.1, legs=False)
    made[swims[0]] = walking_bag(folder / swims[0], v_x=lambda t: 0.02)
    return made


def replicates_of(trials, session, *, walking):
    lift = session.step(Selection()).fit.predicted[:, Observable.lift]
    cell = int(lift.argmax() if walking else np.flatnonzero(lift <= 0)[0])
    cells = session.cells
    near = (np.abs(trials.omega_rad_s - cells.omega[cell]) < 0.1) & (np.abs(trials.phi - cells.phi[cell]) < 0.003)
    return [str(name) for name in trials.trial_id[near]]


@pytest.fixture(scope="module")
def fit(session):
    return session.step(Selection()).fit


@pytest.fixture(scope="module")
def scene(trials, bags, fit):
    return scene_of(trials, bags, fit, next(iter(bags)))
