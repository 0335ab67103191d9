"""Centres at the camera's noise bound, with and without a bed that is known, and what a wrong bed costs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pictures import Film

from sandbot_tracking.bed import MAX_FRAMES, MIN_FRAMES, StillBed, background
from sandbot_tracking.marker_tracker import LEARN_EVERY, MarkerTracker
from sandbot_tracking.markers import NO_BED, Appearance, detect, follow

pytestmark = pytest.mark.slow  # together seconds

RADIUS, MIDDLE = 8.0, 24.0
BOUND_PX, GRAINS_PX = 0.0109, 0.0184
"""Cramér–Rao bounds for Film() and a disc of 8 px: benchmarks/tracking.py computes them."""


def scenes(film, count, seed=1):
    """Centres, beds and exposed frames of single discs."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        centre, bed = MIDDLE + rng.uniform(-0.5, 0.5, 2), film.bed(rng)
        image = bed.copy()
        film.add(image, *centre, RADIUS)
        yield rng, centre, bed, image


def measure(frame, near, bed=NO_BED):
    return follow(frame, np.array([near]), np.array([RADIUS]), np.array([8.0]), bed)[0]


def errors(film, count, bed_of, light=1.0):
    """Errors (count, 2) [px] and stated variances of discs with the bed that ``bed_of(rng, film, bed)`` knows."""
    off, variance = [], []
    for rng, centre, bed, image in scenes(film, count):
        frame = film.expose(rng, np.clip(light * image, 0, 255))
        row = measure(frame, centre + rng.uniform(-3, 3, 2), bed_of(rng, film, bed))
        off.append(row[:2] - centre)
        variance.append(row[2:4])
    return np.array(off), np.array(variance)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def unknown(_rng, _film, _bed):
    return NO_BED


def empty_frames(rng, film, bed):
    return background(film.expose(rng, bed) for _ in range(25))


def stirred_up(rng, film, _bed):
    return empty_frames(rng, film, film.bed(rng))


def half_stirred_up(rng, film, bed):
    """Right of the middle the grains lie anew."""
    other = bed.copy()
    other[:, int(MIDDLE) :] = film.bed(rng)[:, int(MIDDLE) :]
    return empty_frames(rng, film, other)


def with_a_footprint(rng, film, bed):
    """A dark print under the disc's rim that was not there when the bed was learnt."""
    before = bed.copy()
    before[20:30, 10:20] += 35.0
    return empty_frames(rng, film, before)


def with_the_marker(rng, film, bed):
    """The marker stood there, unnoticed, while the bed was learnt."""
    other = bed.copy()
    film.add(other, MIDDLE + 3.0, MIDDLE, RADIUS)
    return empty_frames(rng, film, other)


def test_a_known_bed_gives_the_camera_noise_bound():
    off, variance = errors(Film(), 300, empty_frames)
    assert rms(off) < 1.13 * BOUND_PX  # 600 values: 3 % of chance
    assert 0.85 < np.mean(off**2 / variance) < 1.25
    assert np.abs(off.mean(axis=0)).max() < 3 * BOUND_PX / np.sqrt(300)


def test_without_a_bed_grains_are_weighed_down():
    off, variance = errors(Film(), 300, unknown)
    assert BOUND_PX * 1.3 < rms(off) < 1.3 * GRAINS_PX
    assert 0.75 < np.mean(off**2 / variance) < 1.25


@pytest.mark.parametrize("bed", [stirred_up, half_stirred_up, with_a_footprint, with_the_marker])
def test_a_bed_that_has_changed_is_hardly_worse_than_none(bed):
    without, _ = errors(Film(), 150, unknown)
    off, variance = errors(Film(), 150, bed)
    assert rms(off) < 1.15 * rms(without)
    assert np.mean(off**2 / variance) < 1.6


@pytest.mark.parametrize("light", [0.8, 1.05])
def test_flickering_light_costs_nothing_but_its_own_noise(light):
    off, variance = errors(Film(), 200, empty_frames, light)
    assert rms(off) * light < 1.2 * BOUND_PX
    assert np.mean(off**2 / variance) < 1.35


def test_a_body_behind_the_disc_is_no_bed():
    """The bed's grains are known, but a plain body hides them: they must not be put on its picture."""
    film = Film(grain=0.0, grey=45.0)
    on_body, _ = errors(film, 150, lambda rng, _film, _bed: empty_frames(rng, Film(), Film().bed(rng)))
    plain, _ = errors(film, 150, unknown)
    assert rms(on_body) < 1.05 * rms(plain)


def test_centres_are_not_locked_to_pixels():
    """Mean errors over the fraction of a pixel are chance; those of a hard threshold are not."""
    film, found, hard, truth = Film(grain=0.0, lens=0.3), [], [], []
    rng = np.random.default_rng(5)
    for fraction in np.linspace(-0.5, 0.5, 200, endpoint=False):
        image = np.full(film.shape, film.grey)
        film.add(image, MIDDLE + fraction, MIDDLE, 5.0)
        frame = film.expose(rng, image)
        found.append(follow(frame, np.array([[MIDDLE, MIDDLE]]), np.array([5.0]), np.array([5.0]))[0, 0])
        hard.append(np.mean(np.nonzero(frame > film.grey + film.contrast / 2)[1]))
        truth.append(MIDDLE + fraction)
    ours, theirs = (np.abs((np.array(x) - truth).reshape(10, 20).mean(axis=1)).max() for x in (found, hard))
    assert ours < 3.5 * 0.012 / np.sqrt(20)
    assert theirs > 2 * ours


@settings(max_examples=40, deadline=None)
@given(st.floats(3.6, 11.5), st.floats(30, 130), st.floats(30, 90), st.integers(0, 1000))
def test_detect_finds_a_disc_of_any_size_anywhere(radius, x, y, seed):
    rng, film = np.random.default_rng(seed), Film(shape=(120, 160))
    image = film.bed(rng)
    film.add(image, x, y, radius)
    found = detect(film.expose(rng, image), Appearance())
    assert found.xy_px.shape == (1, 2)
    assert np.hypot(*(found.xy_px[0] - (x, y))) < 0.2
    assert abs(found.radius_px[0] - radius) < 0.25


def test_detect_finds_discs_in_uneven_light():
    """Light that falls from 150 to 30 grey levels: no one threshold has the grains below and both discs above."""
    rng, film = np.random.default_rng(3), Film(shape=(240, 640), contrast=95.0)
    ramp = np.linspace(150, 30, 640)[None, :] + np.zeros((240, 1))
    image = ramp + 5 * rng.standard_normal(ramp.shape)
    places = [(60.0, 120.0), (580.0, 120.0)]
    for x, y in places:
        film.add(image, x, y, RADIUS, grey=ramp[0, int(x)] + 105)
    found = detect(film.expose(rng, image), Appearance())
    np.testing.assert_allclose(found.xy_px[np.argsort(found.xy_px[:, 0])], places, atol=0.15)


def test_a_glare_is_no_disc_and_hides_none():
    rng, film = np.random.default_rng(4), Film(shape=(240, 320))
    image = film.bed(rng)
    image[20:200, 10:90] = 250.0
    film.add(image, 200.3, 100.7, RADIUS)
    found = detect(film.expose(rng, image), Appearance())
    np.testing.assert_allclose(found.xy_px, [(200.3, 100.7)], atol=0.1)


def test_a_bed_is_learnt_around_markers_and_forgotten():
    bed, none = StillBed(), np.empty((0, 2))
    frame = np.full((60, 80), 50, np.uint8)
    for _ in range(MIN_FRAMES):
        bed.see(frame, np.array([[40.0, 30.0]]), np.array([5.0]))
    assert np.isnan(bed.picture[30, 40])
    assert bed.picture[30, 60] == 50.0
    for _ in range(3 * MAX_FRAMES):
        bed.see(np.full((60, 80), 90, np.uint8), none, np.empty(0))
    assert bed.picture[30, 40] == 90.0
    assert bed.picture[30, 60] == pytest.approx(90.0, abs=4.0)


def test_a_tracker_learns_the_bed_its_marker_walks_into():
    """The film itself is enough: after a while of standing, steps onto ground seen before are at the camera's bound."""
    rng, film = np.random.default_rng(8), Film(shape=(64, 240), grain=14.0)
    bed, tracker, off = film.bed(rng), MarkerTracker(("com",)), []
    x = np.concatenate((np.full(LEARN_EVERY * MIN_FRAMES + 4, 40.0), 40.0 + np.linspace(0, 150, 120)))
    for place in x:
        image = bed.copy()
        film.add(image, place, 32.0, RADIUS)
        off.append(tracker.update(film.expose(rng, image)).xy_px[0, 0] - place)
    standing, walking = off[: LEARN_EVERY * MIN_FRAMES], off[-100:]
    assert abs(np.mean(standing)) < 0.08
    assert rms(walking) < 1.3 * BOUND_PX
    without = [off for place in x[-100:] for off in _alone(film, rng, bed, place)]
    assert rms(without) > 1.5 * rms(walking)


def _alone(film, rng, bed, place):
    image = bed.copy()
    film.add(image, place, 32.0, RADIUS)
    yield measure(film.expose(rng, image), (place, 32.0))[0] - place
