"""A reflection as bright and as round as the marker never becomes it; the marker itself comes back wherever it went."""

import numpy as np
import pytest

from sandbot_tracking.distractors import Distractors
from sandbot_tracking.marker_tracker import MarkerTracker
from sandbot_tracking.markers import locate

LOST, BACK, FRAMES = 20, 30, 60
FAR = (500.0, 100.0)


def shown(scene, rng, truth, others=()):
    """A tracker that saw frames with its markers at ``truth`` (frames, n, 2), NaN where hidden, and what it found.

    ``others``: places and radii of other discs, and from which frame on each is there.
    """
    tracker, bed, found = MarkerTracker(("com", "rear")[: truth.shape[1]]), scene.grains(rng), []
    for n, markers in enumerate(truth):
        image = bed.copy()
        for place, radius, since in others:
            if n >= since:
                scene.add_disc(image, *place, radius)
        for marker in markers[np.isfinite(markers[:, 0])]:
            scene.add_disc(image, *marker, 7.0)
        found.append(tracker.update(scene.expose(rng, image)).xy_px)
    return tracker, np.array(found)


def walk(step_px=2.0, frames=FRAMES, lost=LOST, back=BACK):
    """A marker that walks along x, hidden for a while."""
    truth = np.array([[(60.0 + step_px * n, 240.0)] for n in range(frames)])
    truth[lost:back] = np.nan
    return truth


@pytest.mark.parametrize(
    "since", [pytest.param(1, id="stood there"), pytest.param(LOST + 3, id="comes while it is hidden")]
)
@pytest.mark.parametrize("radius", [7.0, 6.5])
def test_a_reflection_far_off_never_becomes_the_marker(scene, rng, since, radius):
    truth = walk()
    tracker, found = shown(scene, rng, truth, [(FAR, radius, since)])
    np.testing.assert_allclose(found, truth, atol=0.2)
    assert (tracker.counts.missing, tracker.counts.reacquired) == (BACK - LOST, 1)
    # What stood there is known not to be the marker; what came since is known only to be out of reach.
    assert (tracker.counts.ambiguous > 0) == (since > LOST)


@pytest.mark.parametrize("aside_px", [20.0, 30.0])
def test_what_stood_within_reach_is_not_the_marker_but_what_comes_there_is(scene, rng, aside_px):
    truth = walk()
    place = (60.0 + 2.0 * LOST, 240.0 + aside_px)
    np.testing.assert_allclose(shown(scene, rng, truth, [(place, 7.0, 1)])[1], truth, atol=0.2)
    # The same disc where nothing stood is the marker, pushed aside.
    truth[LOST + 8 :] = place
    np.testing.assert_allclose(shown(scene, rng, truth)[1][LOST + 8 :], truth[LOST + 8 :], atol=0.2)


def test_a_marker_that_stands_is_no_distractor_of_its_own(scene, rng):
    truth = walk(step_px=0.0)
    tracker, found = shown(scene, rng, truth, [(FAR, 7.0, 1)])
    np.testing.assert_allclose(found, truth, atol=0.2)
    assert tracker.counts.reacquired == 1


@pytest.mark.parametrize("step_px", [2.0, 8.0])
def test_a_hidden_marker_is_found_as_far_on_as_it_walked(scene, rng, step_px):
    truth = walk(step_px)
    np.testing.assert_allclose(shown(scene, rng, truth)[1], truth, atol=0.3)


def test_a_robot_carried_elsewhere_is_found_when_it_may_have_come_so_far(scene, rng):
    truth = walk(frames=180, back=160)
    truth[160:] = (480.0, 120.0)
    tracker, found = shown(scene, rng, truth, [((300.0, 400.0), 7.0, 1)])
    np.testing.assert_allclose(found, truth, atol=0.2)
    # At once it can't have come there: a jump is missing until it can.
    truth = walk(frames=180, lost=LOST, back=LOST)
    truth[LOST:] = (480.0, 120.0)
    tracker, found = shown(scene, rng, truth)
    assert np.isnan(found[LOST : LOST + 100]).all()
    np.testing.assert_allclose(found[-20:], truth[-20:], atol=0.2)
    assert tracker.counts.ambiguous > 50


def test_two_reflections_as_far_apart_as_the_axles_are_not_the_axles(scene, rng):
    truth = walk() + np.array([(0.0, 0.0), (100.0, 0.0)])
    reflections = [((400.0, 100.0), 7.0, LOST + 1), ((500.0, 100.0), 7.0, LOST + 1)]
    np.testing.assert_allclose(shown(scene, rng, truth, reflections)[1], truth, atol=0.2)


def test_only_what_was_there_as_bright_and_is_no_marker_stood_there(scene, rng):
    bed = scene.grains(rng)
    marker, screw, glint, came = (100.0, 100.0), (200.0, 100.0), (300.0, 100.0), (400.0, 100.0)
    before = scene.frame(rng, [marker, screw], bed=bed, glints=[glint])
    now = scene.frame(rng, [marker, screw, glint, came], bed=bed)
    rows = np.array([locate(now, *place, 7.0, 5.0) for place in (marker, screw, glint, came)] + [np.full(7, np.nan)])
    distractors = Distractors()
    assert not distractors.among(rows).any()
    distractors.see(before, np.array([marker]))
    # The driver's next frame in the same memory.
    before[:] = now
    assert distractors.among(rows).tolist() == [False, True, False, False, False]


@pytest.mark.parametrize(("told", "found_again"), [(16, True), (1, False)])
def test_a_marker_that_walked_on_while_frames_were_lost_is_found(scene, rng, told, found_again):
    """A busy machine loses 15 frames: who does not know it looks behind the marker for as long as it walks."""
    tracker, bed = MarkerTracker(("com",)), scene.grains(rng)
    seen = []
    for n in [*range(20), *range(35, 60)]:
        image = bed.copy()
        scene.add_disc(image, 60.0 + 6.0 * n, 240.0, 7.0)
        seen.append(tracker.update(scene.expose(rng, image), told if n == 35 else 1).found[0])
    assert all(seen[:20])
    assert all(seen[28:]) == found_again
    assert any(seen[20:]) == found_again
