"""What a campaign begins with."""

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from sandbot_model.design.start import VISITS, start

levels = st.lists(st.floats(0.57, 0.64), min_size=1, max_size=9, unique=True)
frequencies = st.lists(st.floats(1.0, 60.0), min_size=1, max_size=9, unique=True)


@given(levels, frequencies)
def test_every_level_and_every_frequency_is_visited_and_nothing_twice(phi, omega):
    chosen = start(phi, omega)
    assert len(set(chosen)) == len(chosen) <= VISITS * (len(phi) + len(omega))
    for values, others, axis in ((phi, omega, 0), (omega, phi, 1)):
        visits = Counter(one[axis] for one in chosen)
        assert set(visits) == set(values)
        assert min(visits.values()) >= min(VISITS, len(others))


@given(levels, frequencies)
def test_the_same_plan_begins_alike(phi, omega):
    assert start(phi, omega) == start(phi, omega)


def test_it_is_spread_and_no_row_of_the_grid():
    chosen = start([0.58, 0.6, 0.61, 0.62, 0.633], [4.0, 8.0, 12.0, 16.0, 20.0, 24.0, 30.0])
    visits = Counter(phi for phi, _ in chosen)
    assert len(chosen) == 14
    assert max(visits.values()) - min(visits.values()) <= 1
