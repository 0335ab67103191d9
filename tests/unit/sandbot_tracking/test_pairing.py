"""Two views brought to common times, whatever happens to frames on the way."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_tracking.pairing import NEAR, PATIENCE, Pairing

PERIOD = 10_000_000
CAMERAS = ("dorsal", "lateral")
STREAMS = st.tuples(
    st.integers(0, 2**32 - 1),
    st.floats(0, 1),
    st.floats(0, 0.1),
    st.floats(0, 0.4),
    st.integers(5, 60),
    st.integers(0, 8),
)
"""Seed, phase of the second camera and jitter [periods], share of frames lost, frames, how far frames change places."""


def streams(seed, phase, jitter, lost, count, mixed):
    """Stamps of both cameras as they arrive: (camera, stamp)."""
    rng = np.random.default_rng(seed)
    arriving = []
    for name, start in (("dorsal", 0.0), ("lateral", phase)):
        t = (np.arange(count) + start + jitter * rng.uniform(-1, 1, count)) * PERIOD
        order = np.arange(count) + mixed * rng.uniform(0, 1, count)
        arriving += [(order[n], name, int(t[n])) for n in range(count) if rng.uniform() >= lost]
    return [(name, t) for _, name, t in sorted(arriving)]


def run(arriving, tolerance=PERIOD // 2):
    """The stamps themselves are what was seen, so what is joined can be held against the instant."""
    pairing = Pairing(CAMERAS, tolerance)
    return pairing, [instant for name, t in arriving for instant in pairing.add(t, name, t)]


@given(STREAMS)
def test_instants_come_in_order_each_once_and_views_are_joined_at_their_time(drawn):
    arriving = streams(*drawn)
    _, given = run(arriving)
    stamps = [instant.t_ns for instant in given]
    assert stamps == sorted(set(stamps))
    sent = {name: {t for camera, t in arriving if camera == name} for name in CAMERAS}
    for instant in given:
        assert (instant.t_ns if instant.first is None else instant.first) == instant.t_ns
        assert instant.t_ns in sent["lateral" if instant.first is None else "dorsal"]
        if instant.second is not None:
            before, after, weight = instant.second
            assert {before, after} <= sent["lateral"]
            assert 0 <= weight <= 1 + NEAR
            # A frame that stands by itself is off by no more than one that is carried on may be.
            off = abs((1 - weight) * before + weight * after - instant.t_ns)
            assert off < 1 or (before == after and off <= NEAR * PERIOD / 2)
            assert after - before <= 2.5 * PERIOD


@given(STREAMS)
def test_a_frame_that_is_not_given_is_late_or_still_waits(drawn):
    seed, phase, jitter, lost, count, mixed = drawn
    arriving = streams(seed, phase, jitter, lost, count, mixed)
    pairing, given = run(arriving)
    firsts = sum(camera == "dorsal" for camera, _ in arriving)
    seconds = [t for camera, t in arriving if camera == "lateral"]
    waits = sum(camera == "dorsal" and t > max(seconds, default=-1) for camera, t in arriving)
    assert sum(instant.first is not None for instant in given) >= firsts - pairing.late - waits
    if not mixed:
        assert pairing.late == 0


@given(st.integers(0, 2**32 - 1), st.floats(0, 1), st.floats(0, 0.1), st.integers(5, 60))
def test_where_nothing_is_lost_every_frame_between_the_others_has_its_view(seed, phase, jitter, count):
    _, given = run(streams(seed, phase, jitter, 0.0, count, 0))
    inside = [instant for instant in given if instant.first is not None][2:-2]
    assert all(instant.second is not None for instant in inside)


def test_equal_stamps_are_one_instant_at_once():
    pairing, given = run([("dorsal", 1), ("dorsal", 2), ("lateral", 2)], 5)
    assert [(one.t_ns, one.first, one.second) for one in given] == [(1, 1, None), (2, 2, (2, 2, 0.0))]
    assert pairing.add(1, "dorsal", 1) == []
    assert pairing.late == 1


def test_a_camera_that_falls_silent_is_not_waited_for_for_ever():
    _, given = run([("dorsal", n * PERIOD) for n in range(PATIENCE + 3)])
    assert [instant.t_ns // PERIOD for instant in given] == [0, 1, 2]
    _, given = run([("lateral", n * PERIOD) for n in range(PATIENCE + 3)])
    assert [(instant.t_ns // PERIOD, instant.first) for instant in given] == [(0, None), (1, None), (2, None)]


def test_one_camera_alone_waits_for_nobody():
    pairing = Pairing(("dorsal",), PERIOD // 2)
    assert [one.t_ns for n in range(3) for one in pairing.add(n, "dorsal", n)] == [0, 1, 2]


def test_time_that_goes_back_begins_anew():
    pairing = Pairing(("dorsal",), PERIOD // 2)
    pairing.add(10**10, "dorsal", 0)
    assert [one.t_ns for one in pairing.add(5, "dorsal", 0)] == [5]


def test_across_two_lost_frames_nothing_is_made_up():
    """Negative control of the joining: the body does not move in straight lines for 30 ms."""
    first = [("dorsal", n * PERIOD + PERIOD // 5) for n in range(5)]
    second = [("lateral", n * PERIOD) for n in (0, 1, 4, 5)]
    _, given = run(sorted(first + second, key=lambda one: one[1]))
    assert [instant.second is not None for instant in given] == [True, False, False, False, True]


def test_a_view_taken_a_little_earlier_is_carried_on_and_the_next_is_not_waited_for():
    early = round(0.04 * PERIOD)
    pairing, _ = run([("lateral", -early), ("dorsal", 0), ("lateral", PERIOD - early)])
    (instant,) = pairing.add(PERIOD, "dorsal", PERIOD)
    before, after, weight = instant.second
    assert (before, after) == (-early, PERIOD - early)
    assert (1 - weight) * before + weight * after == pytest.approx(PERIOD, abs=1)
    # With nothing before it, it stands for itself.
    assert run([("lateral", -early), ("dorsal", 0)])[1][0].second == (-early, -early, 0.0)


def test_a_view_taken_earlier_by_more_waits_for_the_one_after():
    """Negative control: a straight line reaches no further."""
    early = round(0.06 * PERIOD)
    pairing, given = run([("lateral", -early), ("dorsal", 0)])
    assert given == []
    (instant,) = pairing.add(PERIOD - early, "lateral", PERIOD - early)
    assert instant.second == (-early, PERIOD - early, pytest.approx(0.06))
