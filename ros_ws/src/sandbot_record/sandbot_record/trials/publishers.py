"""Signs in a bag that a second node published what a row is computed from, or that the bag holds several trials.

A live campaign watches the publishers themselves; this finds the traces in bags of other recorders and versions.
"""

import math
from collections.abc import Sequence

import numpy as np

from sandbot_common import topics
from sandbot_record.bags.reader import FIELD_STAMP, Bag

PHI_AGREES = 1e-4
"""Largest difference of φ between two messages about one preparation: its fourth decimal."""
OLD_NS = 1_000_000_000
"""A landmark is from another trial if it is this much older than the start, after one of this trial; a camera's clock
is corrected by less when it sees the LED."""

Phis = Sequence[tuple[int, float]]
"""Log times [ns] and φ."""


def fault(bag: Bag, start_ns: int, ready: Phis) -> str:
    """Which messages contradict each other, in one phrase; empty if none do.

    ``start_ns``: the stamp of the LED's edge; ``ready``: φ in each /bed/status of a bed that is ready. Raises
    InputError for a message that can't be decoded.
    """
    led = bag.columns(topics.SYNC_LED.name).log_time_ns
    led_ns = int(led[0])
    return _trials(bag) or _edges(len(led)) or _phi(bag, ready, led_ns) or _landmarks(bag, start_ns, led_ns)


def _trials(bag: Bag) -> str:
    told = {message.decode().data for message in bag.messages([topics.TRIAL.name])}
    return f"{len(told)} different trials on {topics.TRIAL.name}" if len(told) > 1 else ""


def _edges(count: int) -> str:
    return f"{count} edges on {topics.SYNC_LED.name}, a trial has one" if count > 1 else ""


def _phi(bag: Bag, ready: Phis, led_ns: int) -> str:
    """Whether φ is the same in the last message of each topic before the start and in all since."""
    found = [
        (phi, topic)
        for topic, said in ((topics.BED_PHI.name, _measured(bag)), (topics.BED_STATUS.name, ready))
        for phi in [phi for t_ns, phi in said if t_ns <= led_ns][-1:] + [phi for t_ns, phi in said if t_ns > led_ns]
        if math.isfinite(phi)
    ]
    if not found or max(found)[0] - min(found)[0] <= PHI_AGREES:
        return ""
    (high, where), (low, elsewhere) = max(found), min(found)
    return f"bed: φ {high:.4f} in {where}, {low:.4f} in {elsewhere}"


def _measured(bag: Bag) -> Phis:
    if topics.BED_PHI.name not in bag.topics:
        return []
    phi = bag.columns(topics.BED_PHI.name, "data")
    return list(zip(phi.log_time_ns.tolist(), phi["data"].tolist(), strict=True))


def _landmarks(bag: Bag, start_ns: int, led_ns: int) -> str:
    """Whether landmarks of an earlier time come between those of this trial."""
    for topic in topics.LANDMARKS.values():
        if topic.name not in bag.topics:
            continue
        columns = bag.columns(topic.name, *FIELD_STAMP)
        stamps = columns.stamp_ns[np.argsort(columns.log_time_ns, kind="stable")]
        logged = np.sort(columns.log_time_ns)
        begun = np.logical_or.accumulate((logged > led_ns) & (stamps >= start_ns))
        if old := int(np.sum(begun & (stamps < start_ns - OLD_NS))):
            return f"tracking: {old} messages on {topic.name} are of an earlier time"
    return ""
