"""What `make soak` would call growth, and what not."""

import numpy as np
import pytest
import soak


def of(memory, files):
    return [
        {"minute": float(number), "lab": {"memory_mb": one, "threads": 16, "files": other}, "all": {"segments": 30}}
        for number, (one, other) in enumerate(zip(memory, files, strict=True))
    ]


STEADY = np.full(90, 23.0)


def test_what_stays_or_settles_is_no_growth():
    noise = np.random.default_rng(1).normal(0.0, 1.0, 90)
    settling = 150.0 - 50.0 * np.exp(-np.arange(90) / 4.0)
    assert soak.growths(soak.series(of(settling + noise, STEADY))) == []


@pytest.mark.parametrize(
    ("memory", "files", "grew"),
    [
        (150.0 + 0.3 * np.arange(90), STEADY, "lab: own memory [MB]"),
        (np.full(90, 150.0), 23 + np.arange(90) // 30, "lab: open files"),
    ],
)
def test_what_grows_is_named(memory, files, grew):
    assert soak.growths(soak.series(of(memory, files))) == [grew]


def test_processes_are_known_by_their_commands():
    assert soak.name_of(["python", "/x/lib/sandbot_bed/bed", "--ros-args"]) == "bed"
    assert soak.name_of(["python", "-m", "sandbot_record.tools.record", "/speed"]) == "recorder"
    assert soak.name_of(["python", "-c", "from multiprocessing.spawn import spawn_main"]) == ""
