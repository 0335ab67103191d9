"""Markers found to a hundredth of a pixel, followed, lost, found again, never swapped."""

import numpy as np
import pytest

from sandbot_common.errors import InputError
from sandbot_tracking.led import LedEdge
from sandbot_tracking.marker_tracker import MarkerTracker
from sandbot_tracking.markers import Appearance, detect, locate


@pytest.mark.parametrize("radius", [5.0, 6.5, 8.0])
def test_the_centre_is_unbiased_and_its_variance_honest(scene, rng, radius):
    off, variance = [], []
    for _ in range(200):
        image, centre = scene.grains(rng, (40, 40)), rng.uniform(18, 22, 2)
        scene.add_disc(image, *centre, radius)
        row = locate(scene.expose(rng, image), *(centre + rng.uniform(-3, 3, 2)), radius, 5.0)
        off.append(row[:2] - centre)
        variance.append(row[2:4])
    assert np.sqrt(np.mean(np.square(off))) < 0.024
    assert np.abs(np.mean(off, axis=0)).max() < 0.005
    assert 0.5 < np.mean(np.square(off) / variance) < 1.6


def test_nothing_is_found_where_nothing_is(scene, rng):
    frame = scene.frame(rng, [], glints=[(100, 100), (400, 300)])
    assert len(detect(frame, Appearance()).xy_px) == 0
    cut = scene.frame(rng, [(3.0, 200.0)])
    assert np.isnan(locate(cut, 3.0, 200.0, 7.0, 8.0)).all()


def test_detect_finds_discs_among_glints(scene, rng):
    discs = [(100.3, 200.7), (350.6, 80.2)]
    found = detect(scene.frame(rng, discs, glints=[(200, 300), (500, 400)]), Appearance())
    np.testing.assert_allclose(found.xy_px[np.argsort(found.xy_px[:, 0])], discs, atol=0.1)


def run(tracker, scene, rng, places, bed=None):
    bed = scene.grains(rng) if bed is None else bed
    return [tracker.update(scene.frame(rng, discs, bed=bed)) for discs in places]


def test_a_marker_that_jumps_five_pixels_a_frame_is_held(scene, rng):
    x = 100 + np.cumsum([0, 0, 5, 5, 5, 0, 0, 0, 5, 5, 0])
    marks = run(MarkerTracker(("com",)), scene, rng, [[(value, 200.0)] for value in x])
    np.testing.assert_allclose([m.xy_px[0, 0] for m in marks], x, atol=0.08)


def test_loss_is_nan_and_counted_and_the_marker_comes_back(scene, rng):
    tracker = MarkerTracker(("com",))
    places = [[(100 + 2 * n, 200)] if not 4 <= n < 14 else [] for n in range(20)]
    marks = run(tracker, scene, rng, places)
    assert [bool(m.found[0]) for m in marks] == [bool(p) for p in places]
    assert np.isnan(marks[5].xy_px).all()
    assert np.isnan(marks[5].var_px2).all()
    counts = tracker.counts
    assert (counts.missing, counts.lost, counts.reacquired) == (10, 1, 1)


def test_a_glint_is_never_taken_for_a_lost_marker(scene, rng):
    tracker = MarkerTracker(("com",))
    bed = scene.grains(rng)
    scene.add_disc(bed, 112, 200, 7, contrast=60)
    marks = run(tracker, scene, rng, [[(100 + 2 * n, 200)] if n < 4 else [] for n in range(15)], bed)
    assert not any(m.found[0] for m in marks[4:])


def test_half_hidden_markers_are_not_measured(scene, rng):
    tracker, bed = MarkerTracker(("com",)), scene.grains(rng)
    for _ in range(3):
        tracker.update(scene.frame(rng, [(200, 200)], bed=bed))
    frame = scene.frame(rng, [(200, 200)], bed=bed)
    frame[:, 200:230] = 60
    assert not tracker.update(frame).found[0]


def test_axles_keep_their_names_through_losses_in_turn(scene, rng):
    tracker = MarkerTracker(("rear", "front"), spacing_px=100.0)
    truth, places = [], []
    for n in range(60):
        pair = [(100 + 3 * n, 200.0), (200 + 3 * n, 200.0)]
        shown = [n % 20 not in range(5, 14) or n >= 40, n % 20 not in range(10, 17)]
        truth.append(pair)
        places.append([p for p, show in zip(pair, shown, strict=True) if show])
    for marks, pair in zip(run(tracker, scene, rng, places), truth, strict=True):
        off = np.abs(marks.xy_px - pair)
        assert (np.isnan(off) | (off < 0.1)).all()
    assert tracker.counts.reacquired >= 4


def test_three_equal_candidates_without_spacing_are_ambiguous(scene, rng):
    tracker = MarkerTracker(("rear", "front"))
    marks = run(tracker, scene, rng, [[(100, 200), (200, 200), (300, 200)]])[0]
    assert not marks.found.any()
    assert tracker.counts.ambiguous == 2
    led = MarkerTracker(("rear", "front"), ignore_px=[(290, 190, 20, 20)])
    assert run(led, scene, rng, [[(100, 200), (200, 200), (300, 200)]])[0].found.all()


def test_bad_frames_and_names_are_refused():
    with pytest.raises(InputError, match="mono8"):
        MarkerTracker(("com",)).update(np.zeros((10, 10, 3), np.uint8))
    with pytest.raises(InputError, match="different"):
        MarkerTracker(("a", "a"))


def test_the_led_edge_is_seen_once(scene, rng):
    led = LedEdge((8, 8, 24, 24))
    seen = [led.update(scene.frame(rng, [(20, 20)] if 3 <= n < 6 else [])) for n in range(8)]
    assert [n for n, edge in enumerate(seen) if edge] == [3]
    with pytest.raises(InputError, match="outside"):
        LedEdge((630, 0, 24, 24)).update(np.zeros((480, 640), np.uint8))
