"""A live trial: the batch's trace from the same set-points, and every frame once, on the robot's own time."""

import numpy as np
import pytest
from rig import QUIET, setpoints
from test_cameras import CAMERAS as FILE

from sandbot_lab.cameras import LabCamera
from sandbot_lab.live_trial import NANO, LiveTrial
from sandbot_lab.robot import START_X_M, simulate
from sandbot_lab.world import null_world

CAMERAS = {name: FILE[name] for name in ("dorsal", "lateral")}
T0_NS = 1_700_000_000_123_456_789


def play(trial, t_s, angles, rates):
    states, frames = [], []
    for t, angle, rate in zip(t_s, angles, rates, strict=True):
        states.append(trial.advance(T0_NS + round(t * NANO), angle, rate))
        frames += trial.frames()
    return states, frames


def test_live_trace_is_the_batch_trace():
    t_s, angles, rates = setpoints(14.0)
    states, frames = play(LiveTrial(null_world(), 0.61, 9, START_X_M, {}, T0_NS), t_s, angles, rates)
    batch = simulate(null_world(), 0.61, t_s, angles, rates, seed=9)
    assert [state.x_m for state in states] == pytest.approx(batch.x_m, abs=1e-9)
    assert [state.z_m for state in states] == pytest.approx(batch.z_m, abs=1e-9)
    assert frames == []


def test_each_frame_is_taken_once_and_shows_the_batch_place():
    t_s, angles, rates = (values[:120] for values in setpoints(14.0))
    _, frames = play(LiveTrial(QUIET, 0.61, 9, START_X_M, CAMERAS, T0_NS), t_s, angles, rates)
    batch = simulate(QUIET, 0.61, t_s, angles, rates, seed=9)
    for name in ("dorsal", "lateral"):
        stamps = [stamp for camera, stamp, _ in frames if camera == name]
        assert stamps == [T0_NS + k * 10_000_000 for k in range(len(stamps))]
        assert len(stamps) == 60
        film = LabCamera(name, CAMERAS[name], 9)
        wanted = [film.film(batch, k * 0.01, k < 5) for k in range(60)]
        taken = [pixels for camera, _, pixels in frames if camera == name]
        assert np.array_equal(taken, wanted)
