"""A sample of the matrix of faults; `make faults` runs all of it. How fast is in docs/faults.md."""

import re
import subprocess
import sys
from pathlib import Path

import cells
import pytest

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.timeout(300)]

BUSY_S = 5.0
"""What a busy machine may take; that nothing goes on for ever is the claim here."""


ATTEMPTS = 3
"""On a busy machine the moment may be over before the fault comes: then there is nothing to stop."""


@pytest.mark.parametrize(
    ("target", "fault", "moment", "why"),
    [
        ("campaign", "KILL", "walking", "whoever ran the trial is gone"),
        pytest.param("tracker", "STOP", "walking", "tracker is frozen", marks=pytest.mark.whole),
        pytest.param("bed", "KILL", "blowing", "bed is gone", marks=pytest.mark.whole),
    ],
)
def test_all_stops_and_the_bag_says_why(target, fault, moment, why, tmp_path):
    row = row_of((target, fault, moment), tmp_path / "rows.jsonl")
    assert float(row["legs [s]" if moment == "walking" else "air [s]"]) <= BUSY_S
    status = row["exit_status"]
    # On a busy machine clock or bed may be the first to miss the campaign's lease, or the clock itself be held up.
    assert any(
        reason in status for reason in (why, "/operator/lease", "/leg_states", "the clock's process was held up")
    ), status
    assert (row["bag"], row["left running"]) == ("whole", "nothing")


@pytest.mark.whole
def test_a_full_disk_stops_the_legs_and_says_why(tmp_path):
    row = row_of(("recorder", "full disk", "walking"), tmp_path / "rows.jsonl")
    assert float(row["legs [s]"]) <= BUSY_S
    # Its own word, or its end, whichever is heard first.
    assert re.search(r"failed: the recorder (failed: File too large|ended)", row["campaign"]), row["campaign"]
    assert (row["bag"], row["left running"]) == ("torn, for recover", "nothing")


def row_of(cell, out):
    """In its own process: what killed nodes leave in shared memory can crash who opens it (Fast DDS issue 6501)."""
    path = Path(__file__).with_name("matrix.py")
    which = [word for pair in zip(("--targets", "--faults", "--moments"), cell, strict=True) for word in pair]
    command = [sys.executable, "-X", "faulthandler", path, *which, "--silence", "4", "--out", out]
    for _ in range(ATTEMPTS):
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
            try:
                said, _ = process.communicate()
            finally:
                process.terminate()  # by which it ends the nodes it has started
        if not cells.missing([cell], out):
            return cells.read(out)[cell]
    raise AssertionError(f"exit {process.returncode}\n{said}")
