import resource
import signal
from types import SimpleNamespace

import bags
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_bringup.folder import CampaignFolder
from sandbot_bringup.journal import KINDS, Journal, read_journal
from sandbot_bringup.nodes.live_node import _Campaign
from sandbot_bringup.plan import Plan, trials_of
from sandbot_bringup.queue import Queue
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


@pytest.mark.parametrize(
    ("earlier", "damaged", "noted"),
    [
        (["start"], False, True),
        (["start", "failed", "repeat", "start"], False, True),
        (["start"], True, False),
        (["start", "done"], False, False),
        ([], False, False),  # of a batch run
    ],
)
def test_a_trial_that_was_over_when_its_campaign_was_killed_is_noted_at_the_next_start(
    tmp_path, earlier, damaged, noted
):
    plan = Plan(name="one", phi=(0.605,), omega_rad_s=(12.0,), gait="UNIFORM", replicates=1)
    (trial,) = trials_of(plan)
    one, notes = object.__new__(_Campaign), []
    one._folder, one.queue = CampaignFolder(tmp_path), Queue(plan, [trial.trial_id])
    one._interface = SimpleNamespace(note=lambda do, **what: notes.append((do, what)))
    bag = bags.trial_bag(one._folder.bag(trial), plan=bags.PLAN | {"trial_id": trial.trial_id})
    if damaged:
        (bag / "metadata.yaml").write_text("not: [a bag")
        for file in bag.glob("*.mcap"):
            file.write_bytes(b"")
    one._note_kept([{"do": do, "trial_id": trial.trial_id} for do in earlier])
    assert len(notes) == noted
    if noted:
        ((do, what),) = notes
        assert (do, what["trial_id"]) == ("done", trial.trial_id)
        assert what["measured"] == one.queue.entries[trial.trial_id].measured
        assert what["measured"]["speed_m_s"] > 0
