"""One trial on one clock: what the model's leg does, what is drawn of it, and the clip."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import av
import cv2
import numpy as np
import pytest
from made_up import PACE, served

from sandbot_common.errors import InputError
from sandbot_model.explore import clip, scene_figures, trial_page
from sandbot_model.explore.scene import phases, scene_of
from sandbot_model.explore.trial_page import TrialPage
from sandbot_model.physics.observables import Observable
from sandbot_model.report.theme import DARK, LIGHT


def test_a_leg_that_holds_carries_the_axle_by_the_lift_of_the_model(scene, fit):
    """Straight below the axle a leg lifts the body by Δz; at the ends of a stance, and while none holds, by nothing."""
    lift = fit.predicted[scene.cell, Observable.lift]
    assert scene.axle_m.min() == pytest.approx(scene.axle_height_m)
    assert scene.axle_m.max() - scene.axle_height_m == pytest.approx(lift, rel=0.01)
    none = ~scene.holds.any(axis=1)
    assert none.any()
    assert scene.axle_m[none] == pytest.approx(scene.axle_height_m)
    moving = scene.model_m_s > 0
    assert np.array_equal(moving, scene.holds.any(axis=1) & (scene.waveform.leg_time_s >= 0))


def test_a_swimmer_has_no_leg_that_holds(trials, bags, fit):
    swims = scene_of(trials, bags, fit, list(bags)[-1])
    assert swims.reach_rad == 0
    assert not swims.holds.any()
    assert np.ptp(swims.axle_m) == 0
    assert "swims" in scene_figures.records_caption(swims)


def test_replicates_are_laid_over_each_other_by_phase(scene):
    """v_x was made a function of the leg's angle: one curve, whichever the turn."""
    longer = replace(
        scene.waveform, leg_time_s=np.arange(0, 3, 0.01), leg_angle_rad=np.tile(PACE * np.arange(0, 3, 0.01), (6, 1)).T,
        time_s=np.arange(0, 3, 0.013), speed_m_s=0.1 + 0.05 * np.sin(2 * PACE * np.arange(0, 3, 0.013)),
    )  # fmt: skip
    phase, speed = phases(longer, 0)
    seen = np.isfinite(speed)
    assert speed[seen] == pytest.approx(0.1 + 0.05 * np.sin(2 * phase[seen]), abs=1e-6)
    assert np.isnan(speed).sum() == np.sum(np.diff(phase) < 0) > 1
    # What the camera sees once the legs have stopped belongs to no phase.
    stopped = replace(longer, leg_time_s=longer.leg_time_s[:200], leg_angle_rad=longer.leg_angle_rad[:200])
    assert len(phases(stopped, 0)[0]) == np.sum(longer.time_s <= 1.99) - np.sum(
        longer.time_s < longer.time_s[-len(phase)]
    )
    drawn = scene_figures.over_phase(replace(scene, waveform=longer, model_m_s=longer.leg_time_s), [longer], DARK)
    assert [trace["name"] for trace in drawn["data"]] == ["model", longer.trial_id]


def test_the_records_have_no_line_back_from_one_turn_to_the_next(scene):
    spec = scene_figures.records(scene, LIGHT)
    names = [trace["name"] for trace in spec["data"]]
    assert names == ["model", "measured", "tripod A", "tripod B"]
    for trace in spec["data"][2:]:
        known = np.array([np.nan if y is None else y for y in trace["y"]])
        assert np.nanmax(np.abs(np.diff(known))) < 90


def codec(path):
    """What a player needs to know of it."""
    with av.open(str(path)) as found:
        (stream,) = found.streams.video
        return stream.codec_context.name, stream.codec_context.pix_fmt


def test_the_clip_has_a_picture_for_each_moment_and_the_film_above(scene, tmp_path):
    grey = np.full((144, 640, 3), 90, np.uint8)
    film = SimpleNamespace(time_s=np.arange(0, 1, 0.01), picture=lambda i: grey)
    for name, above in (("legs.mp4", None), ("film.mp4", film)):
        path = tmp_path / name
        clip.write_clip(path, scene, above)
        video = cv2.VideoCapture(str(path))
        assert codec(path) == ("h264", "yuv420p")
        meant = (scene.end_s - scene.waveform.time_s[0]) / clip.PACE * clip.RATE_HZ
        assert video.get(cv2.CAP_PROP_FRAME_COUNT) == pytest.approx(meant, abs=1)
        ok, picture = video.read()
        assert ok
        assert picture.shape == (clip.HEIGHT + (216 if above else 0), clip.WIDTH, 3)
        if above:
            assert abs(int(picture[100, 400].mean()) - 90) < 8


def test_a_leg_is_coloured_only_while_it_holds(scene):
    def coloured(i):
        picture = clip.legs_at(scene, float(scene.waveform.leg_time_s[i])).astype(int)
        return bool((np.abs(picture - clip.NEW).sum(axis=2) < 30).sum() > 40)

    holding = scene.holds.any(axis=1)
    assert coloured(int(np.flatnonzero(holding)[3]))
    assert not coloured(int(np.flatnonzero(~holding)[3]))


@pytest.mark.parametrize(("radius_m", "belly"), [(0.0355, 0.7), (0.5, 0.7), (0.01, 0.0), (0.2, 1.99)])
def test_every_robot_fits_into_its_picture(scene, radius_m, belly):
    """Nothing of the legs touches the edge, and a leg is drawn the larger the more of its picture it may fill."""
    robot = replace(scene, radius_m=radius_m, axle_height_m=belly * radius_m)
    for t in scene.waveform.leg_time_s[::7]:
        legs = clip.legs_at(robot, float(t)).astype(int)
        drawn = (legs < 150).all(axis=2) | (np.abs(legs - clip.NEW).sum(axis=2) < 30)
        drawn[np.flatnonzero(drawn.all(axis=1))] = False  # the surface
        assert not np.concatenate([drawn[[0, -1]].ravel(), drawn[:, [0, -1]].ravel()]).any()
        assert np.ptp(np.flatnonzero(drawn.any(axis=1))) > clip.HEIGHT / 5


def test_the_leg_drawn_has_the_arc_of_the_robot(scene):
    """From the hip, clockwise as seen with +x to the right; SandBot's is 225° long."""
    assert np.degrees(scene.arc_rad) == pytest.approx(225)
    ends, pixels, arcs = [], [], np.pi * np.array([1, 1.25, 1.75])
    for arc_rad in arcs:
        robot = replace(scene, arc_rad=arc_rad)
        path = re.search(r'id="leg-0" class="arc" d="M0 0 A1 1 0 1 1 (\S+) (\S+)"', trial_page._leg(robot))
        ends.append((float(path[1]), float(path[2])))
        pixels.append(int((clip.legs_at(robot, 0.0) < 60).all(axis=2).sum()))
    assert ends == [
        pytest.approx((np.sin(arc), 1 - np.cos(arc)), abs=1e-3) for arc in np.pi * np.array([1, 1.25, 1.75])
    ]
    assert pixels == sorted(set(pixels))


@pytest.fixture(scope="module")
def client(session, trials, bags):
    return served(TrialPage(session, trials, bags))


def test_the_page_has_everything_on_one_clock(client, bags, scene):
    name = next(iter(bags))
    page = client.get(f"/trial?trial={name}&effect=leg_slip").text
    held = json.loads(re.search(r'id="scene">(.*?)</script>', page)[1])
    assert held["frames"] == []
    assert len(held["scene"]["legTime"]) == len(held["scene"]["axle"]) == len(held["scene"]["model"])
    assert set(held["figures"]) == {"records", "phase"}
    assert 'href="/?effect=leg_slip"' in page
    assert "simple model + leg slip. Other trials" in page
    assert f"/trial/clip.mp4?trial={name}&amp;effect=leg_slip" in page
    assert 'id="film"' not in page


def test_the_model_has_the_values_held_by_hand_and_links_keep_them(client, bags, scene):
    name, other = list(bags)[:2]
    query = "view=lock&amp;hold=delta_t_s%3D0.2"
    page = client.get(f"/trial?trial={name}&view=lock&hold=delta_t_s%3D0.2").text
    shown = json.loads(re.search(r'id="scene">(.*?)</script>', page)[1])["scene"]
    fitted = json.loads(re.search(r'id="scene">(.*?)</script>', client.get(f"/trial?trial={name}").text)[1])["scene"]
    assert shown["model"] != fitted["model"]
    assert "simple model, held by hand: delta_t_s = 0.2. Other trials" in page
    assert f'href="/?{query}"' in page
    assert f"/trial?trial={other}&amp;{query}" in page


@pytest.mark.parametrize(
    ("address", "said"),
    [
        ("/trial?trial=t00&hold=nonsense%3D1", "nonsense"),
        ("/trial?trial=absent", "no trial of that name"),
        ("/trial", "no trial of that name"),
        ("/trial?trial=t00&effect=nonsense", "nonsense"),
        ("/trial/clip.mp4?trial=absent", "no trial of that name"),
    ],
)
def test_what_can_not_be_shown_is_refused_in_a_line(client, address, said):
    answer = client.get(address)
    assert answer.status_code == 400
    assert said in answer.text
    assert len(answer.text.splitlines()) == 1


def test_a_trial_without_legs_says_so(trials, bags, fit, client):
    without = list(bags)[1]
    with pytest.raises(InputError, match="no leg states"):
        scene_of(trials, bags, fit, without)
    assert client.get(f"/trial/frame/{without}/0.jpg").status_code == 404
