import bags
import pytest
from mcap.reader import make_reader

from sandbot_common.errors import InputError
from sandbot_record.bags.reader import Bag
from sandbot_record.bags.writer import BagWriter, Split, add_metadata
from sandbot_record.trials.from_bags import row_from_bag


def content(bag):
    return [(message.topic, message.log_time_ns, bytes(message.data)) for message in bag.messages()]


@pytest.mark.parametrize("options", [{}, {"compression": "zstd"}, {"split": Split(size=20_000)}])
def test_what_is_added_counts_and_all_else_stays(tmp_path, options):
    path = bags.legs_bag(tmp_path / "b", **options)
    with BagWriter(tmp_path / "other", **options) as writer:
        writer.metadata("trial", {"id": "t1", "exit_status": "ok"})
        writer.attach("robot.yaml", b"{}", "application/yaml")
    before = Bag.open(path)
    add_metadata(path, "trial", {"exit_status": "no legs"})
    add_metadata(path, "trial", {"exit_status": "no legs at all"})
    after = Bag.open(path)
    assert after.provenance["trial"] == {"exit_status": "no legs at all"}
    assert content(after) == content(before)
    assert (after.start_ns, after.end_ns, after.count) == (before.start_ns, before.end_ns, before.count)
    last = max(path.glob("*.mcap"), key=lambda file: file.stat().st_mtime_ns)
    with last.open("rb") as file:  # by the reader of others: its indexes are right, CRCs and all
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_summary().statistics.metadata_count == 2
        assert [one.metadata["exit_status"] for one in reader.iter_metadata()] == ["no legs", "no legs at all"]
        assert sum(1 for _ in reader.iter_messages()) == reader.get_summary().statistics.message_count
    add_metadata(tmp_path / "other", "trial", {"id": "t1", "exit_status": "lost"})
    other = Bag.open(tmp_path / "other")
    assert (other.provenance["trial"]["exit_status"], other.attachments) == ("lost", {"robot.yaml": b"{}"})


def test_a_trial_marked_so_is_judged_so(tmp_path):
    path = bags.trial_bag(tmp_path / "b")
    assert row_from_bag(path).status == "ok"
    add_metadata(path, "trial", {**Bag.open(path).provenance.get("trial", {}), "exit_status": "tracking lost"})
    assert row_from_bag(path).status == "tracking lost"


def test_a_copy_that_lies_beside_it_is_left_alone(tmp_path):
    path = bags.legs_bag(tmp_path / "b")
    copy = path / "backup.mcap"
    copy.write_bytes((path / "b_0.mcap").read_bytes())  # the younger one
    add_metadata(path, "trial", {"exit_status": "no legs"})
    assert Bag.open(path).provenance["trial"] == {"exit_status": "no legs"}
    assert not Bag.open(copy).provenance


def test_a_torn_bag_and_none_are_refused_untouched(tmp_path):
    path = bags.legs_bag(tmp_path / "b")
    (file,) = path.glob("*.mcap")
    file.write_bytes(torn := file.read_bytes()[:-100])
    with pytest.raises(InputError, match="not complete"):
        add_metadata(path, "trial", {})
    assert file.read_bytes() == torn
    with pytest.raises(InputError, match="no bag"):
        add_metadata(tmp_path, "trial", {})
