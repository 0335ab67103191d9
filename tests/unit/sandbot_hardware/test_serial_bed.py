"""Levels as anybody may send them, at the driver of the blower: without a graph or a line."""

from types import SimpleNamespace

from sandbot_common import messages
from sandbot_common.lease import Lease
from sandbot_hardware.nodes.serial_bed_node import SerialBed


def test_of_two_commanders_neither_is_obeyed_and_then_one_only_after_a_level_of_zero():
    bed, written = object.__new__(SerialBed), []
    bed._lease, bed._level, bed._lapsed, bed._stops = Lease(60.0), 0.0, False, 0
    bed._partners, bed._health = SimpleNamespace(begin=lambda _: None), SimpleNamespace(publish=lambda: None)
    bed._rivals, bed.rivals = SimpleNamespace(fault=lambda: bed.rivals), ""
    bed._port, bed.get_logger = SimpleNamespace(opened=1, write=written.append), lambda: SimpleNamespace(error=str)

    def blows(level):
        bed._on_blower(messages.float64(level))
        return bed._level

    assert blows(0.5) == 0.5
    bed.rivals = "bed and stranger both publish /bed/blower"
    assert [blows(level) for level in (0.7, 0.0, 0.7)] == [0.0] * 3
    assert (bed._stops, len(written)) == (1, 5)  # the controller's watchdog hears every level
    bed.rivals = ""
    assert [blows(level) for level in (0.7, 0.0, 0.7)] == [0.0, 0.0, 0.7]
