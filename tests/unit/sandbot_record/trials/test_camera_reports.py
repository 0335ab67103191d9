"""What the tracker reports of its cameras, as a campaign hears it and as a bag of whoever recorded it holds it."""

import bags
import pytest

from sandbot_common import messages, topics
from sandbot_record.trials.camera_reports import camera_fault
from sandbot_record.trials.from_bags import row_from_bag


def eyes(edges, jumps=0, moved_px=0.0):
    lateral = {"led_edges": edges, "clock_jumps": jumps, "moved_px": moved_px}
    return {"dorsal_led_edges": "3", "dorsal_clock_jumps": "0", "dorsal_moved_px": "0.0"} | {
        f"lateral_{what}": str(value) for what, value in lateral.items()
    }


SAW = {"dorsal_led_edges": "4"}


def test_cameras_must_see_the_led_of_each_trial_once_they_have_seen_one():
    assert camera_fault(eyes(2), eyes(3) | SAW) == ""
    assert camera_fault(eyes(0), eyes(0) | SAW) == ""
    assert camera_fault({}, {}) == ""
    assert "the lateral camera did not see the LED" in camera_fault(eyes(2), eyes(2) | SAW)
    assert "the lateral camera's clock jumped, or disagrees" in camera_fault(eyes(2), eyes(3, jumps=1) | SAW)
    assert camera_fault(eyes(2, 1), eyes(3, 1) | SAW) == ""  # in an earlier trial
    moved = camera_fault(eyes(2), eyes(3, moved_px=9.96) | SAW)
    assert moved == "the lateral camera moved by 10.0 px during the trial (moved_px)"


@pytest.mark.parametrize(
    ("dorsal", "lateral", "blind"),
    [
        ((400, 400), (400, 0), "dorsal"),
        ((400, 0), (400, 800), "lateral"),
        ((400, 399), (400, 799), ""),
        ((400, 0), (400, 400), ""),  # one of its two was hidden
        ((0, 0), (0, 0), ""),
    ],
)
def test_a_camera_that_never_shows_the_robot_is_named(dorsal, lateral, blind):
    """Two cameras whose names were exchanged: tracking lost, it said, without a centre of mass."""
    before = {"dorsal_frames": "70", "dorsal_missing": "70", "lateral_frames": "70", "lateral_missing": "140"}
    grown = zip(before, (*dorsal, *lateral), strict=True)
    after = {name: str(int(before[name]) + more) for name, more in grown}
    said = camera_fault(before, after)
    assert said.startswith(f"the {blind} camera shows no marker in any frame") if blind else not said


@pytest.mark.parametrize(
    ("clock", "frames", "said"),
    [("unknown", "400", True), ("as stamped", "400", False), ("by the LED", "400", False), ("unknown", "70", False)],
)
def test_frames_of_unknown_time_are_named_with_their_camera_and_delay(clock, frames, said):
    """Frames 1.5 s late: tracking lost, it said."""
    after = {"lateral_clock": clock, "lateral_frames": frames, "lateral_behind_robot_ms": "1503"}
    fault = camera_fault({"lateral_frames": "70"}, after)
    late = "the lateral camera's frames arrive 1.5 s late, or its clock is off by that"
    assert fault.startswith(late) if said else not fault
    ahead = camera_fault({"lateral_frames": "70"}, after | {"lateral_behind_robot_ms": "-1503"})
    assert ahead.startswith("the lateral camera's clock is 1.5 s ahead of the robot's and ") if said else not ahead


@pytest.mark.parametrize("odd", ["", "abc", "nan", "0", "1.5", "-3", "1" * 5000])
def test_what_a_tracker_says_that_is_no_number_ends_no_campaign(odd):
    before, after = eyes(2), eyes(3) | SAW
    for name in after:
        assert isinstance(camera_fault(before, after | {name: odd}), str)


@pytest.mark.parametrize(
    ("name", "reports", "said"),
    [
        ("tracker", [(-0.1, eyes(0)), (2.0, eyes(1) | SAW), (4.1, eyes(1) | SAW)], "ok"),
        ("tracker", [(-0.1, eyes(0, 2)), (2.0, eyes(1, 3) | SAW)], "the lateral camera's clock jumped"),
        ("tracker", [(-0.1, eyes(0)), (2.0, eyes(1, 0, 9.9) | SAW)], "the lateral camera moved by 9.9 px"),
        ("tracker", [(-0.2, eyes(0, 2)), (-0.1, eyes(0, 3)), (2.0, eyes(1, 3) | SAW)], "ok"),
        ("tracker", [(2.0, eyes(1, 3)), (3.0, eyes(1, 4))], "ok"),  # what was before is not known
        ("tracker2", [(-0.1, eyes(0, 2)), (2.0, eyes(1, 3) | SAW)], "ok"),
    ],
)
def test_a_bag_that_no_campaign_recorded_is_judged_alike(tmp_path, name, reports, said):
    """As of `record` by hand, or of frames that were tracked again: such a row was ok, its speed 17 % too high."""
    told = [(topics.DIAGNOSTICS, t_s, messages.diagnostics(0, name, values)) for t_s, values in reports]
    assert row_from_bag(bags.trial_bag(tmp_path / "b", more=told)).status.startswith(said)


def test_the_last_words_of_a_tracker_that_ends_are_no_report(tmp_path):
    told = [
        (topics.DIAGNOSTICS, t_s, messages.diagnostics(0, "tracker", values, level=level, text=text))
        for t_s, values, level, text in [
            (-0.1, eyes(2), 0, "ok"),
            (2.0, eyes(3) | SAW, 0, "ok"),
            (4.1, {}, 2, "ended: SIGINT"),
        ]
    ]
    assert row_from_bag(bags.trial_bag(tmp_path / "b", more=told)).status == "ok"
