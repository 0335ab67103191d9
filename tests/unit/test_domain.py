"""Live tests that run at once never share a DDS domain."""

import os

import pytest


def test_nobody_else_gets_a_domain_that_is_taken_and_it_is_free_again_after(own_domain):
    with own_domain(5) as first:
        with own_domain(5) as second, own_domain(5) as third:
            assert len({first, second, third}) == 3
            assert all(0 < number <= 101 for number in (first, second, third))
        with own_domain(first - 1) as other:
            assert other != first
    with own_domain(first - 1) as again:
        assert again == first


def test_a_test_and_its_processes_are_in_its_domain(domain):
    assert os.environ["ROS_DOMAIN_ID"] == str(domain)


@pytest.mark.ros
def test_what_held_once_is_awaited_and_what_never_holds_is_not(beside):
    """A condition that was asked once more after it held failed a test in which it tells of an event."""
    answers = iter([False, True])
    assert beside.wait(lambda: next(answers, False), 60.0)
    assert not beside.wait(lambda: False, 0.05)
