import resource
import signal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_bringup.journal import KINDS, Journal, read_journal
from sandbot_common.errors import InputError


@pytest.fixture
def path(tmp_path):
    return tmp_path / "journal.jsonl"


@given(st.lists(st.tuples(st.sampled_from(KINDS), st.text())))
def test_what_was_written_is_read_again(tmp_path_factory, events):
    path = tmp_path_factory.mktemp("j") / "journal.jsonl"
    journal = Journal(path, lambda: 1.5)
    for do, reason in events:
        journal.add("operator", do, reason=reason)
    assert read_journal(path) == journal.events
    assert [(one["do"], one["reason"]) for one in Journal(path, lambda: 2.0).earlier] == events


def test_half_a_character_is_written_and_read_again(path):
    Journal(path, lambda: 0.0).add("operator", "skip", reason="\\φ\ud800")
    (event,) = read_journal(path)
    assert event["reason"] == "\\φ\ud800"


def test_a_line_torn_by_a_kill_is_lost_alone(path):
    journal = Journal(path, lambda: 0.0)
    journal.add("campaign", "begin")
    with path.open("a") as file:
        file.write('{"at": "2026')
    after = Journal(path, lambda: 1.0)
    after.add("campaign", "end")
    assert [one["do"] for one in read_journal(path)] == ["begin", "end"]
    assert after.earlier[0]["at"] == "1970-01-01T00:00:00.000+00:00"


@pytest.fixture
def full_disk():
    """Nothing can be written any more, as far as this process goes."""
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    signal.signal(signal.SIGXFSZ, before)


def test_a_full_disk_costs_no_event_that_is_kept(path, request):
    path.write_text('{"do": "begin"}\n{"do": "skip"}\n{"at": "2026')
    request.getfixturevalue("full_disk")
    journal = Journal(path, lambda: 1.0)
    assert [one["do"] for one in journal.earlier] == ["begin", "skip"]
    with pytest.raises(InputError, match=r"journal\.jsonl: can't be written: File too large"):
        journal.add("campaign", "end")
    assert path.read_text() == '{"do": "begin"}\n{"do": "skip"}\n'


@pytest.mark.parametrize("line", ["no json", "[1]", '{"who": "me"}', '{"do": "dance"}'])
def test_a_line_that_is_no_event_is_named(path, line):
    path.write_text('{"do": "begin"}\n' + line + "\n")
    with pytest.raises(InputError, match=r"journal\.jsonl: line 2 is not an event"):
        Journal(path, lambda: 0.0)


def test_an_event_nobody_could_read_again_is_not_written(path):
    with pytest.raises(ValueError, match="dance"):
        Journal(path, lambda: 0.0).add("me", "dance")
    assert not path.exists()
