import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_hardware import lines
from sandbot_hardware.lines import Line, Reader

values = st.lists(st.integers(-(10**12), 10**12) | st.floats(-1e6, 1e6), max_size=18)
kinds = st.sampled_from("SLEBHW")
LINE = lines.encode("W", 1)


def test_a_line_is_what_the_protocol_says():
    assert lines.encode("B", 0.5) == b"B 0.50000 *69\n"
    assert lines.decode(b"B 0.50000 *69") == Line("B", (0.5,))


@given(kinds, values)
def test_a_line_reads_back_as_it_was(kind, given_values):
    (line,) = Reader().feed(lines.encode(kind, *given_values))
    assert line.kind == kind
    assert line.values == pytest.approx(tuple(given_values), abs=5e-6)


@given(st.lists(st.tuples(kinds, values), min_size=1, max_size=5), st.binary(max_size=2000), st.data())
def test_messages_come_whole_however_their_bytes_are_cut(messages, block, data):
    wire = b"".join(lines.encode(kind, *given_values) for kind, given_values in messages)
    wire += lines.encode_block("C", 12, block) + lines.encode("W", 1)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(wire)), max_size=6)))
    reader = Reader()
    found = [line for a, b in zip([0, *cuts], [*cuts, len(wire)], strict=True) for line in reader.feed(wire[a:b])]
    assert [line.kind for line in found] == [*(kind for kind, _ in messages), "C", "W"]
    assert found[-2].block == block
    assert reader.damaged == 0


@given(kinds, values, st.data())
def test_a_changed_byte_is_noticed_and_costs_its_line_only(kind, given_values, data):
    wire = bytearray(lines.encode(kind, *given_values))
    at = data.draw(st.integers(0, len(wire) - 2))
    wire[at] ^= 1 << data.draw(st.integers(0, 6))
    reader = Reader()
    found = list(reader.feed(bytes(wire) + b"\n" + lines.encode("W", 2)))
    assert found[-1] == Line("W", (2,))
    # The case of a checksum's digit says nothing.
    assert reader.damaged or found[0].kind == kind


@given(st.binary(max_size=5000))
def test_noise_is_never_an_error_and_is_not_kept(noise):
    reader = Reader()
    for line in reader.feed(noise):
        assert line.kind.isupper()
    assert list(reader.feed(b"\n" * 3)) is not None


def test_a_damaged_frame_is_dropped_and_the_next_one_comes():
    frame = bytearray(lines.encode_block("C", 1, b"x" * 100))
    frame[-1] ^= 1
    reader = Reader()
    (line,) = reader.feed(bytes(frame) + lines.encode_block("C", 2, b"y" * 100))
    assert (line.values[0], line.block, reader.damaged) == (2, b"y" * 100, 1)


frames = st.lists(st.binary(min_size=1, max_size=3000), min_size=2, max_size=5)


@given(st.binary(max_size=5000), frames, st.integers(1, 5000))
def test_a_reader_that_begins_anywhere_finds_the_next_frame(before, blocks, chunk):
    wire = before + b"".join(lines.encode_block("C", at, block) for at, block in enumerate(blocks))
    reader = Reader()
    found = [line for at in range(0, len(wire), chunk) for line in reader.feed(wire[at : at + chunk])]
    assert [line.block for line in found] == blocks
    assert reader.damaged <= 1


@given(frames, st.data())
def test_a_lost_byte_costs_one_frame(blocks, data):
    wire = bytearray(b"".join(lines.encode_block("C", at, block) for at, block in enumerate(blocks)) + LINE)
    del wire[data.draw(st.integers(0, len(wire) - len(LINE) - 1))]
    reader = Reader()
    *found, last = reader.feed(bytes(wire))
    assert len(found) == len(blocks) - 1
    assert {line.block for line in found} <= set(blocks)
    assert (last.kind, reader.damaged) == ("W", 1)


def test_damage_is_counted_once_until_the_next_message():
    reader = Reader()
    assert not list(reader.feed(b"noise\n" * 10))
    assert reader.damaged == 1
    assert len(list(reader.feed(LINE + b"noise\n" + LINE))) == 2
    assert reader.damaged == 2


def test_what_never_ends_a_line_is_damage_too():
    reader = Reader()
    assert not list(reader.feed(b"x" * 2 * lines._LONGEST_LINE))
    assert (reader.damaged, reader.in_step) == (1, False)


def test_an_empty_frame_with_a_wrong_checksum_is_damage():
    reader = Reader()
    assert [line.kind for line in reader.feed(lines.encode("C", 1, 0, 12345) + LINE)] == ["W"]
    assert reader.damaged == 1


def test_frames_whose_bytes_are_all_damaged_are_counted_one_by_one():
    reader, frame = Reader(), bytearray(lines.encode_block("C", 1, b"x" * 100))
    frame[-1] ^= 1
    assert not list(reader.feed(bytes(frame) * 5 + b"\n"))
    assert reader.damaged == 5


def test_what_is_taken_for_a_message_has_its_checksum():
    """Negative control: an end of a line that only looks like a message."""
    assert lines.decode(b"\xff\xd8A 5B 0.50000 *69") == Line("B", (0.5,))
    assert lines.decode(b"\xff\xd8A 5B 0.50000 *68") is None
    assert lines.decode(b"B 0.5.0 *%02X" % lines._checksum(b"B 0.5.0 ")) is None


def test_values_are_shared_among_the_legs():
    assert lines.split(range(6), 3) == [[0, 1, 2], [3, 4, 5]]
    with pytest.raises(ValueError, match="5 values for 3 legs"):
        lines.split(range(5), 3)
