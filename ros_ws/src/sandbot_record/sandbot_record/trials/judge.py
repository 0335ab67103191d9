"""Checks a trial's bag: commands as planned, robot and cameras present from start to end, the bed as prepared.

Only the recorded data are judged, whether live or in batch, here or elsewhere; topics missing from the bag are not.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sandbot_common import topics
from sandbot_common.errors import InputError
from sandbot_common.legs import FARTHEST_RAD
from sandbot_record.bags.reader import FIELD_STAMP, Bag, Columns
from sandbot_record.bags.recording import CLOCK_SET, PAUSED, PAUSED_TO_THE_END
from sandbot_record.trials import camera_reports
from sandbot_record.trials.legs import in_leg_order, joint_names
from sandbot_record.trials.setting import attached_cameras

CLOCK_GAP = 10
"""Longest gap between set-points, in periods; beyond it the legs lag, and meet the ground at another place."""
MAX_LOST = 0.05
"""Largest fraction of set-points that may be missing: the clock keeps the phase, but the legs turn less evenly. The
same for the other topics that a row is computed from, where the recorder counted its losses."""
PHASE_TOLERANCE_RAD = 0.05
"""Largest difference between a set-point and that of a whole number of turns earlier."""
ROBOT_GAP_S = 0.25
CLOCK_STEP_S = 0.01
"""Largest step of the host's clock during a recording: a period of the cameras."""
MIN_FOLLOWED = 0.5
"""Smallest fraction of the commanded angle that the legs must turn, and of their usual one that each must turn in every
commanded turn; weak motors may fall behind, which is physics."""
TRACKING_GAP_S = 0.15
"""Longest time for which a landmark may be out of sight."""
LEAP_M, LEAP_M_S = 0.05, 10.0
"""The farthest that a landmark moves between two frames: by the first at once, and at the second speed. Beyond, two
different things were taken for it."""
FAR_M = 1000.0
"""No trackway is longer: a landmark beyond is not seen."""
PHI_DRIFT = 0.003
"""Largest change of φ between the end of the preparation and that of the trial; three times its tolerance."""

_MIN_HEIGHTS = 5
_LANDMARKS = {
    topics.COM.name: "centre of mass",
    topics.FRONT_AXLE.name: "front axle",
    topics.REAR_AXLE.name: "rear axle",
}
_OTHERS = (topics.LEG_SETPOINTS, topics.LEG_STATES, topics.SYNC_LED, topics.BED_PHI)
_ROW_TOPICS = (*_LANDMARKS, *(topic.name for topic in _OTHERS))
_COUNTS = re.compile(r"written (\d+), lost (\d+), dropped (\d+)")
"""Format of ``Recording.summary``."""
_PAUSES = re.compile(rf"(\d+) to (\d+|{PAUSED_TO_THE_END})")

Times = NDArray[np.int64]


def fault(bag: Bag, start_ns: int, omega_rad_s: float = math.nan) -> str:
    """What went wrong between the start and the stop of the legs, in one phrase; empty if nothing did.

    ``omega_rad_s``: the planned ω; NaN if unknown.
    """
    moving = _moving(bag, topics.LEG_SETPOINTS.name)
    if moving is None:
        moving = _moving(bag, topics.LEG_STATES.name)
    if moving is None or not moving.size:
        return ""
    end_ns = int(moving[-1])
    return (
        _clock_set(bag)
        or _paused(bag, start_ns, end_ns)
        or _commands(bag, moving)
        or _periodic(bag, moving, omega_rad_s)
        or _robot(bag, start_ns, end_ns)
        or camera_reports.fault(bag)
        or _tracking(bag, start_ns, end_ns)
        or _bed(bag, start_ns, end_ns)
        or _recording(bag)
    )


def _clock_set(bag: Bag) -> str:
    """Whether the recorder saw the host's clock set: stamps from before and after don't fit together."""
    steps = [float(step) for step in bag.provenance.get("recording", {}).get(CLOCK_SET, "0").split(",")]
    largest_s = max(steps, key=abs)
    return f"clock: the host's clock was set by {largest_s:+.2f} s" if abs(largest_s) > CLOCK_STEP_S else ""


def _paused(bag: Bag, start_ns: int, end_ns: int) -> str:
    """Whether the recorder was paused while the legs moved, or before the bag shows them at rest again."""
    pauses = _PAUSES.findall(bag.provenance.get("recording", {}).get(PAUSED, ""))
    rest_ns = _rest_ns(bag, end_ns) if pauses else math.inf
    for begun, ended in pauses:
        if int(begun) < rest_ns and (ended == PAUSED_TO_THE_END or int(ended) > start_ns):
            return f"recorder: paused at t = {max(int(begun) - start_ns, 0) * 1e-9:.2f} s"
    return ""


def _rest_ns(bag: Bag, end_ns: int) -> float:
    """When the bag first shows the legs at rest after their last motion [ns]; infinite if it does not."""
    topic = next(topic.name for topic in (topics.LEG_SETPOINTS, topics.LEG_STATES) if _has(bag, topic.name))
    stamps = bag.columns(topic, *FIELD_STAMP).stamp_ns
    return min(stamps[stamps > end_ns].tolist(), default=math.inf)


def _recording(bag: Bag) -> str:
    """Losses counted by the recorder on the topics that a row is computed from."""
    for topic in _ROW_TOPICS:
        if (counts := _COUNTS.fullmatch(bag.provenance.get("recording", {}).get(topic, ""))) is None:
            continue
        written, *missing = map(int, counts.groups())
        if (lost := sum(missing)) > MAX_LOST * (written + lost):
            return f"recorder: {lost} of {written + lost} messages on {topic} lost"
    return ""


def _has(bag: Bag, topic: str) -> bool:
    return topic in bag.topics and bag.topics[topic].count > 0


def _moving(bag: Bag, topic: str) -> Times | None:
    """Stamps [ns] of the messages in which a leg moves; None if the bag has no such topic."""
    if not _has(bag, topic):
        return None
    legs = bag.columns(topic, "velocity", *FIELD_STAMP)
    return np.sort(legs.stamp_ns[(legs["velocity"] != 0.0).any(axis=1)])


def _commands(bag: Bag, moving: Times) -> str:
    steps = np.diff(moving)
    if not _has(bag, topics.LEG_SETPOINTS.name) or not steps.size:
        return ""
    worst, typical = int(np.argmax(steps)), np.median(steps)
    if not typical > 0:
        return "clock: set-points with equal time stamps"
    if steps[worst] > (CLOCK_GAP + 0.5) * typical:
        at_s = (moving[worst] - moving[0]) * 1e-9
        return f"clock: no set-point for {steps[worst] * 1e-9:.2f} s at t = {at_s:.2f} s"
    lost = int(np.sum(np.rint(steps / typical) - 1))
    if lost > MAX_LOST * (len(moving) + lost):
        return f"clock: {lost} of {len(moving) + lost} set-points missing"
    return ""


def _periodic(bag: Bag, moving: Times, omega_rad_s: float) -> str:
    """Whether set-points repeat with the planned period: ω or the gait may be changed while the legs walk."""
    if not (_has(bag, topics.LEG_SETPOINTS.name) and omega_rad_s > 0):
        return ""
    legs = bag.columns(topics.LEG_SETPOINTS.name, "position", *FIELD_STAMP)
    stamps, first = np.unique(legs.stamp_ns, return_index=True)
    walking = np.isin(stamps, moving)
    t_s, angles = (stamps[walking] - moving[0]) * 1e-9, legs["position"][first][walking]
    period_s = 2 * np.pi / omega_rad_s
    shown = int(np.searchsorted(t_s, period_s)) + 1
    if shown > len(t_s):
        return ""
    turns = np.floor(t_s / period_s)
    pattern = np.unwrap(angles[:shown], axis=0)
    expected = np.column_stack([np.interp(t_s - turns * period_s, t_s[:shown], leg) for leg in pattern.T])
    error = np.abs((angles - expected + np.pi) % (2 * np.pi) - np.pi).max(axis=1)
    # The interpolation misses kinks of the gait between two set-points.
    allowed = PHASE_TOLERANCE_RAD + np.abs(np.diff(pattern, axis=0)).max() / 2
    if not (wrong := error > allowed).any():
        return ""
    return f"clock: ω or gait was changed, not {omega_rad_s:g} rad/s throughout, seen at t = {t_s[wrong][0]:.2f} s"


def _robot(bag: Bag, start_ns: int, end_ns: int) -> str:
    states = _angles_only(bag.columns(topics.LEG_STATES.name, "position", *FIELD_STAMP))
    if gap := _gap(states.stamp_ns, start_ns, end_ns, ROBOT_GAP_S):
        return _behind(bag) or f"robot: no leg states for {gap}"
    if not _has(bag, topics.LEG_SETPOINTS.name):
        return ""
    commanded = bag.columns(topics.LEG_SETPOINTS.name, "position", *FIELD_STAMP)
    wanted, turned = (_turned(legs.stamp_ns, legs["position"], start_ns, end_ns) for legs in (commanded, states))
    if turned < MIN_FOLLOWED * wanted:
        return f"robot: legs turned {turned:.1f} rad of {wanted:.1f} rad commanded"
    return _each_leg(bag, commanded, states, start_ns, end_ns)


def _angles_only(states: Columns) -> Columns:
    """The leg states in which every leg has an angle; NaN says nothing of a leg."""
    said = (np.abs(states["position"]) <= FARTHEST_RAD).all(axis=1)
    fields = {name: values[said] for name, values in states.fields.items()}
    return replace(
        states, log_time_ns=states.log_time_ns[said], publish_time_ns=states.publish_time_ns[said], fields=fields
    )


def _each_leg(bag: Bag, commanded: Columns, states: Columns, start_ns: int, end_ns: int) -> str:
    """Whether a single leg stood, or all did for a while, as after a reset of their controller."""
    names = joint_names(bag, topics.LEG_SETPOINTS.name) or joint_names(bag, topics.LEG_STATES.name)
    if not names:
        return ""
    try:
        commanded = in_leg_order(bag, topics.LEG_SETPOINTS.name, commanded, names)
        states = in_leg_order(bag, topics.LEG_STATES.name, states, names)
    except InputError:
        return ""  # the robot has other joints than are commanded
    within = (states.stamp_ns >= start_ns) & (states.stamp_ns <= end_ns)
    stamps, turned = states.stamp_ns[within], np.unwrap(states["position"][within], axis=0)
    position = np.unwrap(commanded["position"], axis=0)
    wanted = [np.interp(stamps, commanded.stamp_ns, leg) for leg in position.T[: len(names)]]
    starts, turns = zip(*(_turns(*pair) for pair in zip(wanted, turned.T, strict=True)), strict=True)
    least = MIN_FOLLOWED * np.median(np.concatenate(turns)) if any(map(len, turns)) else 0.0
    for name, start, made in zip(names, starts, turns, strict=True):
        if (stood := made < least).any():
            first = int(np.argmax(stood))
            at_s = (stamps[start[first]] - start_ns) * 1e-9
            return f"robot: {name} turned {made[first]:.1f} rad of a turn commanded from t = {at_s:.2f} s on"
    return ""


def _turns(wanted: NDArray[np.float64], turned: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """From each sample on after which a leg is commanded to turn once: its index, and the angle that the leg turned."""
    ends = np.searchsorted(np.maximum.accumulate(wanted), wanted + 2 * np.pi)
    whole = np.flatnonzero(ends < len(wanted))
    return whole, turned[ends[whole]] - turned[whole]


def _behind(bag: Bag) -> str:
    """Whether leg states are stamped by another clock than set-points: their least delays until recorded differ."""
    if not _has(bag, topics.LEG_SETPOINTS.name):
        return ""
    states, commanded = (bag.columns(topic.name, *FIELD_STAMP) for topic in (topics.LEG_STATES, topics.LEG_SETPOINTS))
    least_ns = [int((legs.log_time_ns - legs.stamp_ns).min()) for legs in (states, commanded)]
    behind_s = (least_ns[0] - least_ns[1]) * 1e-9
    if abs(behind_s) <= ROBOT_GAP_S:
        return ""
    side = "behind" if behind_s > 0 else "ahead of"
    names = topics.LEG_STATES.name, topics.LEG_SETPOINTS.name
    return f"robot: stamps of {names[0]} are {abs(behind_s):.1f} s {side} those of {names[1]}"


def _turned(stamps: Times, angles: NDArray[np.float64], start_ns: int, end_ns: int) -> float:
    """Mean angle through which the legs turned [rad]."""
    within = (stamps >= start_ns) & (stamps <= end_ns)
    if within.sum() < 2:
        return 0.0
    turned = np.unwrap(angles[within], axis=0)
    return float(np.mean(turned[-1] - turned[0]))


def _tracking(bag: Bag, start_ns: int, end_ns: int) -> str:
    lateral = _has_lateral_camera(bag)
    for topic, name in _LANDMARKS.items():
        needed = lateral or topic == topics.COM.name
        if not _has(bag, topic):
            if needed:
                return f"tracking lost: no {name}"
            continue
        used = "point.x" if topic == topics.COM.name else "point.z"
        columns = bag.columns(topic, *{"point.x", used}, *FIELD_STAMP)
        if why := needed and _unseen(columns, start_ns, end_ns):
            return f"tracking lost: no {name} for {why}"
        if leap := _leap(columns.stamp_ns, columns[used], start_ns, end_ns):
            return f"tracking: the {name} leaps in {used[-1]} {leap}"
    return ""


def _unseen(columns: Columns, start_ns: int, end_ns: int) -> str:
    """For how long a landmark was out of sight, if too long, and where it was last."""
    seen = np.abs(columns["point.x"]) <= FAR_M
    stamps, x_m = columns.stamp_ns[seen], columns["point.x"][seen]
    if not (gap := _gap(stamps, start_ns, end_ns, TRACKING_GAP_S)):
        return ""
    # The last position distinguishes a hidden marker from a robot that walked out of the picture.
    before = stamps <= start_ns + round(gap.at_s * 1e9)
    return f"{gap}, last seen at x = {x_m[before][-1]:.2f} m" if before.any() else str(gap)


def _leap(stamps: Times, values_m: NDArray[np.float64], start_ns: int, end_ns: int) -> str:
    """The first step between two frames that no robot makes; empty if there is none."""
    within = (stamps >= start_ns) & (stamps <= end_ns) & (np.abs(values_m) <= FAR_M)
    order = np.argsort(stamps[within], kind="stable")
    t_s, at_m = (stamps[within][order] - start_ns) * 1e-9, values_m[within][order]
    far = np.abs(np.diff(at_m)) > LEAP_M + LEAP_M_S * np.diff(t_s)
    if not far.any():
        return ""
    after = int(np.argmax(far)) + 1
    return f"from {at_m[after - 1]:.3g} to {at_m[after]:.3g} m at t = {t_s[after]:.2f} s"


def _has_lateral_camera(bag: Bag) -> bool:
    """Whether the trackway has a lateral camera; without it the axles are not tracked."""
    cameras = attached_cameras(bag)
    return "lateral" in cameras if isinstance(cameras, Mapping) else _has(bag, topics.LATERAL_INFO.name)


class _Gap(NamedTuple):
    """A time without messages; ``at_s`` is counted from the start of the trial."""

    length_s: float
    at_s: float

    def __str__(self) -> str:
        return f"{self.length_s:.2f} s at t = {self.at_s:.2f} s"


def _gap(stamps: Times, start_ns: int, end_ns: int, allowed_s: float) -> _Gap | None:
    """The longest gap between stamps, start and end, if longer than allowed."""
    inside = np.sort(stamps[(stamps > start_ns) & (stamps < end_ns)])
    edges = np.concatenate([[start_ns], inside, [end_ns]])
    worst = int(np.argmax(np.diff(edges)))
    gap = _Gap((edges[worst + 1] - edges[worst]) * 1e-9, (edges[worst] - start_ns) * 1e-9)
    return gap if gap.length_s > allowed_s else None


def _bed(bag: Bag, start_ns: int, end_ns: int) -> str:
    if _has(bag, topics.BED_BLOWER.name):
        blower = bag.columns(topics.BED_BLOWER.name, "data")
        during = (blower.log_time_ns > start_ns) & (blower.log_time_ns < end_ns)
        if not (blower["data"][during] <= 0).all():  # NaN may be on
            return "bed: air was on while the legs moved"
    if not _has(bag, topics.BED_PHI.name):
        return ""
    phi = bag.columns(topics.BED_PHI.name, "data")
    if not 0 < phi["data"][-1] < 1:
        return f"bed: φ = {phi['data'][-1]:.4g} in {topics.BED_PHI.name} is no volume fraction"
    if not _has(bag, topics.BED_HEIGHT.name):
        return ""
    height = bag.columns(topics.BED_HEIGHT.name, "range")
    prepared = (height.log_time_ns > phi.log_time_ns[-1]) & (height.log_time_ns < start_ns)
    trodden = height.log_time_ns > (start_ns + end_ns) // 2
    if prepared.sum() < _MIN_HEIGHTS or trodden.sum() < _MIN_HEIGHTS:
        return ""
    measured = np.isfinite(height["range"]) & (height["range"] > 0)
    for when, span in (("before", prepared), ("while", trodden)):
        if (count := (span & measured).sum()) < _MIN_HEIGHTS:
            return f"bed: only {count} of {span.sum()} height readings {when} the legs moved are finite and above 0"
    before, after = (float(np.median(height["range"][span & measured])) for span in (prepared, trodden))
    drift = float(phi["data"][-1]) * (before / after - 1)  # φ ∝ 1/height
    return f"bed: φ drifted by {drift:+.4f} during the trial" if abs(drift) > PHI_DRIFT else ""
