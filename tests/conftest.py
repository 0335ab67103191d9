import os
import signal
import zlib

import pytest
from hypothesis import settings

# A run started in the background inherits an ignored Ctrl-C, and so would every process whose stopping is tested.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# How long an example takes is the machine's affair: a deadline fails on a busy one.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


@pytest.fixture
def domain(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    """A DDS domain of this test's own, set for its processes as well; above 101 its ports would be anybody's."""
    number = 1 + (os.getpid() * 7 + zlib.crc32(request.node.nodeid.encode())) % 100
    monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
    return number
