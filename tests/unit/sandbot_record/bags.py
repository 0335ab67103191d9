"""Bags for the tests, made of known messages."""

import functools
import json
import math
from pathlib import Path

import numpy as np

from sandbot_common import messages, topics
from sandbot_common.serialization import to_cdr
from sandbot_record.bags import interfaces
from sandbot_record.bags.writer import BagWriter

T0 = 1_700_000_000_000_000_000
START = T0 + 300_000_000
"""When legs start in a trial."""
OMEGA = 8.0
PLAN = {
    "trial_id": "t0001",
    "phi_target": 0.62,
    "omega_rad_s": OMEGA,
    "gait": "UNIFORM",
    "replicate": 2,
    "campaign": "c",
    "seed": 3,
    "start": "2026-01-01T00:00:00+00:00",
}


@functools.cache  # what strings are padded with in CDR is whatever was in memory: one message, one set of bytes
def joint_state(index: int, t_ns: int, names=topics.LEGS) -> bytes:
    angles = index + np.arange(len(names)) / 8
    return to_cdr(messages.joint_state(t_ns, names, angles, -angles, angles * 0))


def legs_bag(path: Path, count: int = 500, **options) -> Path:
    """``count`` joint states, 1 ms apart, position of leg k in message i is i + k / 8."""
    with BagWriter(path, **options) as writer:
        for index in range(count):
            t_ns = T0 + index * 1_000_000
            writer.write(topics.LEG_STATES, joint_state(index, t_ns), t_ns, t_ns - 7, index + 1)
    return path


def serialize(message, type_name: str) -> bytes:
    """CDR bytes of a rosbags message."""
    return bytes(interfaces.store().serialize_cdr(message, type_name))


@functools.cache  # 2150 messages, the same in most bags
def walk(speed: float, joints: tuple[tuple[int, str], ...]) -> list[tuple[int, topics.Topic, bytes]]:
    """What is tracked of a trial of constant speed, and its legs: place and name of each joint."""
    places, names = (list(one) for one in zip(*joints, strict=True))
    found = []
    for index in range(430):
        t_ns = T0 + index * 10_000_000
        t_s = max(0.0, (t_ns - START) * 1e-9)
        lift = 0.025 + 0.01 * abs(math.sin(OMEGA * t_s))
        for topic, point in (
            (topics.COM, (0.1 + speed * t_s, 0.0, math.nan)),
            (topics.FRONT_AXLE, (0.2 + speed * t_s, math.nan, lift)),
            (topics.REAR_AXLE, (0.0 + speed * t_s, math.nan, lift)),
        ):
            found.append((t_ns, topic, to_cdr(messages.point(t_ns, point))))
    for index in range(860):
        t_ns = T0 + index * 5_000_000
        t_s = max(0.0, (t_ns - START) * 1e-9)
        angles = (OMEGA * t_s - math.pi / 2 + np.array([0, 0, 0, 1, 1, 1]) * math.pi)[places]
        rest = np.zeros(len(angles))
        message = messages.joint_state(t_ns, names, angles, rest + OMEGA, rest)
        found.append((t_ns, topics.LEG_STATES, to_cdr(message)))
    return found


def trial_bag(
    path: Path,
    *,
    speed: float = 0.2,
    without: tuple[str, ...] = (),
    plan=None,
    exit_status="ok",
    kept=lambda topic, t_s: True,
    more=(),
    files=(),
    legs=None,
) -> Path:
    """A trial of constant speed: 0.3 s at rest, then 4 s of legs turning at OMEGA; lift is |sin| of 10 mm.

    ``kept(topic, t_s)``: which messages stay, t = 0 where legs start; ``more``: (topic, t_s, message) beside them;
    ``files``: text by name, attached; ``legs``: places and names of the joints, in the order they are recorded in.
    """
    said = [
        (T0, topics.TRIAL, to_cdr(messages.string(json.dumps(PLAN if plan is None else plan)))),
        (T0, topics.BED_PHI, to_cdr(messages.float64(0.6213))),
        (T0, topics.BED_STATUS, to_cdr(messages.diagnostics(T0, "bed", {"stage": "ready", "phi_sd": 0.0015}))),
        (START, topics.SYNC_LED, to_cdr(messages.header(START, "sync_led"))),
        *walk(speed, tuple((dict(enumerate(topics.LEGS)) if legs is None else legs).items())),
    ]
    given = [
        (t_ns, topic, cdr)
        for t_ns, topic, cdr in said
        if topic.name not in without and kept(topic, (t_ns - T0) * 1e-9 - 0.3)
    ]
    for topic, t_s, message in more:
        given.append((START + round(t_s * 1e9), topic, to_cdr(message)))
    with BagWriter(path) as writer:
        for t_ns, topic, cdr in sorted(given, key=lambda one: one[0]):
            writer.write(topic, cdr, t_ns)
        writer.metadata("trial", {"id": "t0001", "exit_status": exit_status})
        for name, text in dict(files).items():
            writer.attach(name, text.encode(), "application/yaml")
    return path
