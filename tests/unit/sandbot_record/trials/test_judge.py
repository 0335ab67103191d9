"""A trial in which something was lost is told from one in which nothing was."""

from array import array

import bags
import numpy as np
import pytest
from rclpy.serialization import deserialize_message

from sandbot_clock.gait import PRESETS, Gait
from sandbot_clock.phase_clock import PhaseClock
from sandbot_common import messages, topics
from sandbot_record.bags.writer import add_metadata
from sandbot_record.trials.from_bags import row_from_bag

RATE_HZ, END_S = 200, 4.0


def setpoints(lost=lambda t_s: False):
    """Legs told to turn at OMEGA for four seconds, then to rest."""
    sent = []
    for index in range(round(END_S * RATE_HZ) + 1):
        t_s = index / RATE_HZ
        rate = np.full(6, bags.OMEGA if t_s < END_S else 0.0)
        stamp = bags.T0 + 300_000_000 + round(t_s * 1e9)
        message = messages.joint_state(stamp, topics.LEGS, np.full(6, bags.OMEGA * t_s), rate, np.zeros(6))
        if not lost(t_s):
            sent.append((topics.LEG_SETPOINTS, t_s, message))
    return sent


def heights(before_m, after_m):
    return [
        (topics.BED_HEIGHT, t_s, messages.range_(0, before_m if t_s < 0 else after_m, 0.0, 1.0, "bed"))
        for t_s in np.arange(-0.28, END_S, 0.02)
    ]


def status(tmp_path, **changed):
    return row_from_bag(bags.trial_bag(tmp_path / "b", **changed)).status


def within(topic, start_s, end_s):
    """All messages but those of a topic in a span of time."""
    return lambda one, t_s: one != topic or not start_s < t_s < end_s


def test_a_whole_trial_is_ok_with_or_without_what_others_do_not_record(tmp_path):
    assert status(tmp_path, more=setpoints() + heights(0.1, 0.1)) == "ok"
    assert row_from_bag(bags.trial_bag(tmp_path / "other")).status == "ok"


@pytest.mark.parametrize(
    ("topic", "start_s", "end_s", "said"),
    [
        (topics.COM, 1.0, 9.0, "tracking lost: no centre of mass for 3."),
        (topics.COM, 1.005, 1.295, "tracking lost: no centre of mass for 0.30 s at t = 1.00 s"),
        (topics.LEG_STATES, 2.0, 2.4, "robot: no leg states for 0.4"),
    ],
)
def test_what_falls_silent_is_named_with_its_time(tmp_path, topic, start_s, end_s, said):
    assert status(tmp_path, kept=within(topic, start_s, end_s), more=setpoints()).startswith(said)
    assert (
        row_from_bag(bags.trial_bag(tmp_path / "short", kept=within(topic, 1.0, 1.1), more=setpoints())).status == "ok"
    )  # a few frames hidden are no loss


def test_legs_that_fall_silent_are_named_without_set_points_too(tmp_path):
    assert status(tmp_path, kept=within(topics.LEG_STATES, 2.0, 2.4)).startswith("robot: no leg states for 0.4")


def test_a_landmark_that_is_not_a_number_is_not_seen(tmp_path):
    stamps = [bags.T0 + 300_000_000 + round(t_s * 1e9) for t_s in (1.1, 1.2, 1.3)]
    unseen = [(topics.COM, 1.0, messages.point(stamp, (np.nan,) * 3)) for stamp in stamps]
    said = status(tmp_path, kept=within(topics.COM, 1.005, 1.395), more=setpoints() + unseen)
    assert said == "tracking lost: no centre of mass for 0.40 s at t = 1.00 s, last seen at x = 0.30 m"


@pytest.mark.parametrize(
    ("lost", "said"),
    [
        (lambda t_s: 1.0 < t_s < 1.3, "clock: no set-point for 0.30 s at t = 1.00 s"),
        (lambda t_s: 1.0 < t_s < 1.0549, "clock: no set-point for 0.06 s at t = 1.00 s"),
        (lambda t_s: 1.0 < t_s < 1.0499, "ok"),  # ten periods, of which no leg hears but as one longer step
        (lambda t_s: round(t_s * RATE_HZ) % 16 == 3, "clock: 50 of 800 set-points missing"),
    ],
)
def test_a_clock_that_jumped_is_told(tmp_path, lost, said):
    assert status(tmp_path, more=setpoints(lost)) == said


def test_set_points_without_time_stamps_are_told(tmp_path):
    told = [(topic, t_s, messages.joint_state(0, message.name, message.position, message.velocity, message.effort))
            for topic, t_s, message in setpoints()]  # fmt: skip
    assert status(tmp_path, more=told) == "clock: set-points with equal time stamps"


@pytest.mark.parametrize(
    ("before_m", "after_m", "said"),
    [
        (0.1, 0.0, "bed: only 0 of 100 height readings while the legs moved are finite and above 0"),
        (0.1, np.nan, "bed: only 0 of 100 height readings while the legs moved are finite and above 0"),
        (np.inf, 0.1, "bed: only 0 of 14 height readings before the legs moved are finite and above 0"),
        (0.1, 0.1, "ok"),
    ],
)
def test_a_height_sensor_that_measures_nothing_is_told(tmp_path, before_m, after_m, said):
    assert status(tmp_path, more=setpoints() + heights(before_m, after_m)) == said


def test_heights_that_are_missing_now_and_then_are_ok(tmp_path):
    zeros = [(topic, t_s + 0.01, messages.range_(0, 0.0, 0.0, 1.0, "bed")) for topic, t_s, _ in heights(0.1, 0.1)[::3]]
    assert status(tmp_path, more=setpoints() + heights(0.1, 0.1) + zeros) == "ok"


@pytest.mark.parametrize(("part", "follows"), [(0.0, False), (0.4, False), (0.7, True)])
def test_legs_that_do_not_follow(tmp_path, part, follows):
    states = []
    for _, t_s, told in setpoints():
        stamp, angle = messages.nanoseconds(told.header.stamp), part * np.array(told.position)
        legs = messages.joint_state(stamp, topics.LEGS, angle, part * np.array(told.velocity), np.zeros(6))
        states.append((topics.LEG_STATES, t_s, legs))
    said = status(tmp_path, without=(topics.LEG_STATES.name,), more=setpoints() + states)
    assert said.startswith("robot: legs turned") is not follows


@pytest.mark.parametrize(
    ("legs", "stand_s", "said"),
    [
        ([2], (0.0, 9.0), "robot: rear_left turned 0.0 rad of a turn commanded from t = 0.00 s on"),  # a dead motor
        (range(6), (3.0, 9.0), "robot: front_left turned 3.1 rad of a turn commanded from t = 2.61 s on"),  # a reset
        (range(6), (2.0, 2.5), "robot: front_left turned 3.1 rad of a turn commanded from t = 1.61 s on"),
        (range(6), (2.0, 2.3), "ok"),  # weak motors for a moment
        ([], (0.0, 9.0), "ok"),
    ],
)
def test_a_leg_that_stands_and_legs_that_stand_for_a_while(tmp_path, legs, stand_s, said):
    states = []
    for _, t_s, told in setpoints():
        standing_s = min(max(t_s - stand_s[0], 0.0), stand_s[1] - stand_s[0])
        angles = np.array(told.position)
        angles[list(legs)] -= bags.OMEGA * standing_s
        order = [3, 1, 2, 0, 4, 5]  # as another maker's driver may report them
        names, rates = [topics.LEGS[leg] for leg in order], np.array(told.velocity)
        stamp = messages.nanoseconds(told.header.stamp)
        states.append((topics.LEG_STATES, t_s, messages.joint_state(stamp, names, angles[order], rates, np.zeros(6))))
    assert status(tmp_path, without=(topics.LEG_STATES.name,), more=setpoints() + states) == said


def test_legs_without_names_are_judged_together(tmp_path):
    nameless = []
    for _, t_s, told in setpoints():
        told.name = []
        nameless += [(topic, t_s, told) for topic in (topics.LEG_SETPOINTS, topics.LEG_STATES)]
    assert status(tmp_path, without=(topics.LEG_STATES.name,), more=nameless) == "ok"


def test_the_bed_must_stay_as_it_was_prepared(tmp_path):
    assert status(tmp_path, more=setpoints() + heights(0.1, 0.099)) == "bed: φ drifted by +0.0063 during the trial"
    air = [(topics.BED_BLOWER, 1.0, messages.float64(0.3))]
    said = row_from_bag(bags.trial_bag(tmp_path / "air", more=setpoints() + air)).status
    assert said == "bed: air was on while the legs moved"
    before = [(topics.BED_BLOWER, -0.2, messages.float64(1.0)), (topics.BED_BLOWER, -0.1, messages.float64(0.0))]
    assert row_from_bag(bags.trial_bag(tmp_path / "before", more=setpoints() + before)).status == "ok"


@pytest.mark.parametrize(
    ("topic", "counts", "said"),
    [
        (topics.COM, "written 380, lost 15, dropped 6", "recorder: 21 of 401 messages on /landmarks/com lost"),
        (topics.COM, "written 380, lost 15, dropped 5", "ok"),
        (topics.SYNC_LED, "written 0, lost 1, dropped 0", "recorder: 1 of 1 messages on /sync_led lost"),
        (topics.DORSAL_IMAGE, "written 10, lost 300, dropped 0", "ok"),  # a row is made of what was tracked live
        (topics.COM, "not recorded: no such type", "ok"),
    ],
)
def test_what_the_recorder_lost_is_told_where_a_row_is_made_of_it(tmp_path, topic, counts, said):
    bag = bags.trial_bag(tmp_path / "b", more=setpoints())
    add_metadata(bag, "recording", {"exit_status": "ok", topic.name: counts})
    assert row_from_bag(bag).status == said


@pytest.mark.parametrize(
    ("from_s", "to_s", "said"),
    [
        (2.0, None, "recorder: paused at t = 2.00 s"),  # the trial was cut off, and looks whole
        (2.0, 2.5, "recorder: paused at t = 2.00 s"),
        (2.0, END_S + 1, "recorder: paused at t = 2.00 s"),
        (-0.2, 0.1, "recorder: paused at t = 0.00 s"),
        (-0.2, -0.1, "ok"),  # before the legs began
        (END_S + 0.1, None, "ok"),  # after their rest
    ],
)
def test_a_pause_while_the_legs_moved_is_told(tmp_path, from_s, to_s, said):
    def at(t_s):
        return "end" if t_s is None else str(bags.T0 + 300_000_000 + round(t_s * 1e9))

    cut = (lambda t_s: t_s > from_s) if to_s is None and from_s < END_S else (lambda t_s: False)
    bag = bags.trial_bag(tmp_path / "b", more=setpoints(cut), kept=lambda topic, t_s: not cut(t_s))
    add_metadata(bag, "recording", {"exit_status": "ok", "paused": f"{at(from_s)} to {at(to_s)}"})
    assert row_from_bag(bag).status == said
    if cut(END_S):  # what was judged before
        whole = bags.trial_bag(tmp_path / "unsaid", more=setpoints(cut), kept=lambda topic, t_s: not cut(t_s))
        assert row_from_bag(whole).status == "ok"


@pytest.mark.parametrize(
    ("steps", "said"),
    [
        ("+15.000000", "clock: the host's clock was set by +15.00 s"),
        ("+0.002000, -0.500000", "clock: the host's clock was set by -0.50 s"),
        ("-0.002000", "ok"),  # less than a frame
    ],
)
def test_a_host_clock_that_was_set_during_the_recording_is_told(tmp_path, steps, said):
    bag = bags.trial_bag(tmp_path / "b", more=setpoints())
    add_metadata(bag, "recording", {"exit_status": "ok", "clock_set_s": steps})
    assert row_from_bag(bag).status == said


@pytest.mark.parametrize(
    ("behind_s", "said"),
    [
        (0.0, "ok"),
        (15.0, "robot: stamps of /leg_states are 15.0 s behind those of /leg_setpoints"),
        (-3600.0, "robot: stamps of /leg_states are 3600.0 s ahead of those of /leg_setpoints"),
    ],
)
def test_leg_states_by_another_clock_are_told_from_legs_that_fell_silent(tmp_path, behind_s, said):
    states = []
    for _, t_s, told in setpoints():
        stamp = messages.nanoseconds(told.header.stamp) - round(behind_s * 1e9)
        legs = messages.joint_state(stamp, topics.LEGS, told.position, told.velocity, np.zeros(6))
        states.append((topics.LEG_STATES, t_s, legs))
    more = setpoints() + states
    assert status(tmp_path, kept=lambda topic, t_s: topic != topics.LEG_STATES, more=more) == said


def told_by_the_clock(
    gait="SGCS", change=lambda clock, t_s: clock, at_s=2.0, kept=lambda index: True, omega=bags.OMEGA
):
    """Set-points as the clock sends them, with what was changed at ``at_s``."""
    clock, sent = PhaseClock(PRESETS[gait], omega).started(0.0), []
    for index in range(round(END_S * RATE_HZ) + 1):
        t_s = index / RATE_HZ
        if index == round(at_s * RATE_HZ):
            clock = change(clock, t_s)
        if index == round(END_S * RATE_HZ):
            clock = clock.stopped(t_s)
        stamp = bags.T0 + 300_000_000 + round(t_s * 1e9)
        if kept(index):
            told = messages.joint_state(stamp, topics.LEGS, *clock.at(t_s), np.zeros(6))
            sent.append((topics.LEG_SETPOINTS, t_s, told))
    return sent


@pytest.mark.parametrize("gait", PRESETS)
@pytest.mark.parametrize("kept", [lambda index: True, lambda index: index % 25 != 7, lambda index: not 60 < index < 70])
def test_set_points_that_were_not_changed_are_ok(tmp_path, gait, kept):
    assert status(tmp_path, more=told_by_the_clock(gait, kept=kept)) == "ok"


@pytest.mark.parametrize(
    ("change", "from_s", "to_s"),
    [
        (lambda clock, t_s: clock.with_omega(t_s, 1.5 * bags.OMEGA), 2.0, 2.1),
        (lambda clock, t_s: clock.with_omega(t_s, 1.03 * bags.OMEGA), 2.0, 3.0),
        (lambda clock, t_s: clock.with_gait(t_s, PRESETS["HGCS"]), 2.0, 2.8),
        (lambda clock, t_s: clock.with_gait(t_s, Gait(1.1, -0.3, 0.45)), 2.0, 2.8),  # as fast as before, elsewhere
    ],
)
def test_a_set_point_that_was_changed_while_the_legs_walked_is_told(tmp_path, change, from_s, to_s):
    said = status(tmp_path, more=told_by_the_clock(change=change))
    assert said.startswith("clock: ω or gait was changed, not 8 rad/s throughout, seen at t = ")
    assert from_s <= float(said.split()[-2]) <= to_s


def test_legs_that_walked_at_another_rate_than_planned_from_the_start_are_told(tmp_path):
    assert status(tmp_path, more=told_by_the_clock(omega=1.1 * bags.OMEGA)).startswith("clock: ω or gait was changed")


def spoilt(topic, spoil, start_s, end_s):
    """A topic's messages in a span of time, each spoilt, and what to keep of the others."""
    said = []
    for t_ns, one, cdr in bags.walk(0.2, tuple(enumerate(topics.LEGS))):
        if one == topic and start_s <= (t_s := (t_ns - bags.START) * 1e-9) <= end_s:
            message = deserialize_message(cdr, messages.message_class(topic.type))
            spoil(message)
            said.append((topic, t_s, message))
    return {"more": setpoints() + said, "kept": lambda one, t_s: one != topic or not start_s <= t_s <= end_s}


@pytest.mark.parametrize("angle", [np.nan, np.inf, 1e300])
@pytest.mark.parametrize("legs", [1, 6])
def test_a_robot_that_does_not_say_where_its_legs_are_is_a_silent_one(tmp_path, angle, legs):
    """Half a trial of NaN was a row that is ok."""

    def spoil(message):
        message.position[:legs] = array("d", [angle] * legs)

    said = status(tmp_path, **spoilt(topics.LEG_STATES, spoil, 2.0, 9.0))
    assert said.startswith("robot: no leg states for 2.0")
    short = row_from_bag(bags.trial_bag(tmp_path / "short", **spoilt(topics.LEG_STATES, spoil, 2.0, 2.1)))
    assert (short.status, short.speed_m_s) == ("ok", pytest.approx(0.2))


def test_joint_states_of_fewer_angles_than_names_are_told(tmp_path):
    """It was a traceback, of a table of many bags."""

    def spoil(message):
        message.position = message.position[:3]

    said = status(tmp_path, **spoilt(topics.LEG_STATES, spoil, -1.0, 9.0))
    assert said == "/leg_states: 3 values for 6 joints"


@pytest.mark.parametrize(
    ("topic", "axis", "m", "until_s", "said"),
    [
        (topics.COM, "x", 900.0, 2.0049, "tracking: the centre of mass leaps in x from 0.498 to 900 m at t = 2.00 s"),
        (topics.COM, "x", 1e300, 2.0049, "ok"),  # one frame in which it is not seen
        (topics.COM, "x", -5.0, 9.0, "tracking: the centre of mass leaps in x from 0.498 to -5 m at t = 2.00 s"),
        (topics.FRONT_AXLE, "z", -5.0, 2.1, "tracking: the front axle leaps in z from 0.02"),
        (topics.REAR_AXLE, "z", 0.2, 9.0, "tracking: the rear axle leaps in z from 0.02"),
        (topics.COM, "x", 0.54, 2.0049, "ok"),
        (topics.COM, "z", 1e300, 9.0, "ok"),  # of what no row is computed
    ],
)
def test_a_landmark_that_is_where_no_robot_gets_is_told(tmp_path, topic, axis, m, until_s, said):
    """Speeds of 3e299 m/s were ok."""
    given = spoilt(topic, lambda message: setattr(message.point, axis, m), 1.9951, until_s)
    assert status(tmp_path, **given).startswith(said)


def test_a_landmark_beyond_every_trackway_is_not_seen(tmp_path):
    given = spoilt(topics.COM, lambda message: setattr(message.point, "x", 1e300), -1.0, 9.0)
    assert status(tmp_path, **given).startswith("tracking lost: no centre of mass for 4.00 s")


@pytest.mark.parametrize(("phi", "said"), [(1e300, "1e+300"), (-5.0, "-5"), (1.0, "1"), (0.62, "")])
def test_what_is_no_volume_fraction_is_no_row(tmp_path, phi, said):
    given = [(topics.BED_PHI, -0.3, messages.float64(phi))]
    found = status(tmp_path, without=(topics.BED_PHI.name,), more=setpoints() + given)
    assert found == (f"bed: φ = {said} in /bed/volume_fraction is no volume fraction" if said else "ok")


@pytest.mark.parametrize(("level", "on"), [(np.nan, True), (0.3, True), (0.0, False), (-0.0, False)])
def test_air_that_may_be_on_while_legs_move_is_told(tmp_path, level, on):
    blown = [(topics.BED_BLOWER, 1.0, messages.float64(level))]
    assert (status(tmp_path, more=setpoints() + blown) == "bed: air was on while the legs moved") == on
