"""A campaign that was killed is started again at once: DDS still knows the dead one, for whose sake none is refused."""

import os
import signal

import pytest

from sandbot_common import topics
from sandbot_common.ros import endpoints

# Of this, which takes most of a minute, tests/faults/test_live_leases.py has the lease's part.
pytestmark = [
    *(pytest.mark.ros, pytest.mark.whole, pytest.mark.timeout(300)),
    pytest.mark.usefixtures("nodes_of_a_trial"),
]


def test_it_goes_on_at_once(tmp_path, start, plan_of_one, beside):
    states = []
    endpoints.subscription(beside.node, topics.LEG_STATES, states.append)
    run = ("ros2", "run", "sandbot_bringup", "campaign", plan_of_one(), "--silence", "5", "--out", tmp_path / "live")

    def walks():
        return bool(states) and any(states[-1].velocity)

    first = start(*run)
    beside.until(walks, 120.0)
    os.kill(first.pid, signal.SIGKILL)
    first.wait(30)
    again = start(*run)
    beside.until(lambda: not walks())
    # Killed and known no more for 20 s, of which none is waited for: the bed is prepared in three.
    beside.until(lambda: walks() or any("failed" in line for line in again.lines) or again.ended, 120.0)
    said = "\n".join(again.lines)
    assert not any(refusal in said for refusal in ("both command", "one commander")), said
    assert again.wait(120) in (0, 1), said  # 1: what a busy machine spoilt
