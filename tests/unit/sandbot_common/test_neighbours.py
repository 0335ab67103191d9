import pytest

from sandbot_common import neighbours
from sandbot_common.neighbours import LOOK_S, Neighbours


class Process:
    def __init__(self):
        self.fault, self.starved_s = "", 0.0


@pytest.fixture
def hosts(monkeypatch):
    """Processes by the names they tell; any other name is one of another host."""
    known = {}
    monkeypatch.setattr(neighbours.Neighbour, "of", known.get)
    return known


def test_who_died_is_named_and_who_is_elsewhere_is_not_known(hosts):
    here, clock = Neighbours(), hosts.setdefault("a", Process())
    here.meet("clock", "a")
    here.meet("lab", "of another host")
    assert "clock" in here
    assert "lab" not in here
    here.look(1.0)
    assert here.faults == {}
    clock.fault = "is gone"
    here.look(1.0 + LOOK_S / 2)
    assert here.faults == {}  # not asked again so soon
    here.look(1.0 + 2 * LOOK_S)
    assert here.faults == {"clock": "is gone"}
    hosts["b"] = Process()
    here.meet("clock", "b")  # started anew
    here.look(2.0)
    assert here.faults == {}
    hosts["b"].fault = "is gone"
    here.look(3.0)
    here.forget("clock")
    assert here.faults == {}
    here.look(4.0)
    assert here.faults == {}
    assert "clock" not in here


def test_a_second_node_of_a_name_that_is_refused_is_not_taken_for_the_first(hosts):
    here, _, second = Neighbours(), hosts.setdefault("a", Process()), hosts.setdefault("b", Process())
    assert here.meet("clock", "a")
    assert not here.meet("clock", "b")
    assert here.meet("clock", "a")
    assert not here.meet("clock", "of another host")
    assert here.meet("clock", "")  # of another maker, or of an older version
    second.fault = "is gone"
    here.look(1.0)
    assert here.faults == {}


def test_time_without_a_cpu_is_told_once_and_never_negative(hosts):
    here, lab = Neighbours(), hosts.setdefault("a", Process())
    lab.starved_s = 5.0
    here.meet("lab", "a")
    told = []
    for n, starved_s in enumerate((5.0, 5.25, 5.25, 0.0, 0.5)):
        lab.starved_s = starved_s
        told.append(here.look(float(n)).get("lab"))
    assert told == [0.0, 0.25, 0.0, 0.0, 0.5]


def test_of_one_nobody_else_is_asked_and_he_not_too_often(hosts):
    class Unasked(Process):
        fault = property(lambda _: pytest.fail("asked"), lambda *_: None)

    here, clock = Neighbours(), hosts.setdefault("a", Process())
    hosts["b"] = Unasked()
    here.meet("clock", "a")
    here.meet("lab", "b")
    assert here.fault_of("clock", 1.0) == ""
    clock.fault = "is gone"
    assert here.fault_of("clock", 1.0 + LOOK_S / 2) == ""
    assert here.fault_of("clock", 1.0 + 2 * LOOK_S) == "is gone"
    assert here.fault_of("bed", 2.0) == ""  # nobody knows him
    hosts["c"] = Process()
    here.meet("clock", "c")  # started anew
    assert here.fault_of("clock", 1.0 + 2 * LOOK_S) == ""
    here.forget("clock")
    assert here.fault_of("clock", 2.0) == ""
