import os
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from sandbot_common.node import use_large_segment

PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"


def test_shared_memory_holds_a_second_of_two_cameras(monkeypatch):
    monkeypatch.delenv(PROFILE, raising=False)
    monkeypatch.delenv("FASTDDS_DEFAULT_PROFILES_FILE", raising=False)
    use_large_segment()
    profile = Path(os.environ[PROFILE])
    monkeypatch.delenv(PROFILE)
    tree = ElementTree.parse(profile)
    space = {"": "http://www.eprosima.com"}
    (size,) = (int(one.text) for one in tree.iterfind(".//segment_size", space))
    assert size > 2 * 100 * 640 * 480
    # Discovery and other hosts go on as they are.
    (built_in,) = (one.text for one in tree.iterfind(".//useBuiltinTransports", space))
    assert built_in == "true"


def test_a_profile_of_the_users_own_stays(monkeypatch):
    monkeypatch.delenv(PROFILE, raising=False)
    monkeypatch.setenv("FASTDDS_DEFAULT_PROFILES_FILE", "mine.xml")
    use_large_segment()
    assert PROFILE not in os.environ
