import contextlib
import os
import stat

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_common.errors import InputError
from sandbot_common.files import (
    check_output,
    parse_json,
    read_csv,
    read_json,
    read_yaml,
    whole_file,
    write_text,
    writing,
)


def test_writes_whole_and_makes_the_folder(tmp_path):
    path = tmp_path / "a" / "b.txt"
    write_text(path, "φ\n")
    assert path.read_text(encoding="utf-8") == "φ\n"
    assert os.listdir(path.parent) == ["b.txt"]


def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "b.txt"
    write_text(path, "old")

    def fail():
        with whole_file(path) as temporary:
            temporary.write_text("half")
            raise RuntimeError("power cut")

    with pytest.raises(RuntimeError, match="power cut"):
        fail()
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["b.txt"]


def test_results_are_for_colleagues_too(tmp_path):
    path = tmp_path / "b.txt"
    before = os.umask(0o022)
    try:
        write_text(path, "x")
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o644


def test_reads_a_mapping(tmp_path):
    path = tmp_path / "c.yaml"
    path.write_text("a: 1\nb: [1, 2]\n")
    assert read_yaml(path) == {"a": 1, "b": [1, 2]}


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"- 1\n", "expected a mapping of keys to values at the top, got list"),
        (b"", "got NoneType"),
        (b"a: [1\n", "not YAML"),
        (b"\xff\xfe\x00", r"not a text file \(UTF-8\); a YAML file is needed"),
    ],
)
def test_refuses_what_is_no_mapping_in_one_line(tmp_path, content, complaint):
    path = tmp_path / "c.yaml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=complaint) as caught:
        read_yaml(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_refuses_what_is_not_there_or_a_folder(tmp_path):
    for read in (read_yaml, read_json, read_csv):
        with pytest.raises(InputError, match="no such file"):
            read(tmp_path / "none")
        with pytest.raises(InputError, match="is a folder"):
            read(tmp_path)


@given(content=st.binary(max_size=60))
def test_any_bytes_give_a_mapping_or_an_input_error(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    path.write_bytes(content)
    try:
        result = read_yaml(path)
    except InputError as error:
        result = str(error)
    assert isinstance(result, dict) or "\n" not in result


def test_a_missing_file_may_say_how_to_make_it(tmp_path):
    with pytest.raises(InputError, match="no such file; make it with: discover"):
        read_json(tmp_path / "none.json", remedy="; make it with: discover")


def test_reads_json_with_or_without_a_byte_order_mark(tmp_path):
    path = tmp_path / "c.json"
    for mark in ("", "\ufeff"):
        path.write_text(mark + '{"a": [1, 2.5]}', encoding="utf-8")
        assert read_json(path) == {"a": [1, 2.5]}


@pytest.mark.parametrize("text", ["{", "", "[" * 100_000, "1" * 5000])
def test_what_is_not_json_is_told_in_one_line(text):
    with pytest.raises(InputError, match=r"^/trial: not JSON: [^\n]*$"):
        parse_json(text, "/trial")


def test_reads_a_csv_by_column_with_the_number_of_each_row(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text('\ufeff phi , note\n0.6," a, b"\n\n , \n0.61, c\n', encoding="utf-8")
    header, rows = read_csv(path)
    assert header == ["phi", "note"]
    assert list(rows) == [(2, {"phi": "0.6", "note": "a, b"}), (5, {"phi": "0.61", "note": "c"})]


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("a,b\n1\n", "row 2: 1 values for 2 columns"),
        ("a,b,a\n1,2,3\n", "row 1: column a is there twice"),
        ('a,b\n"1,2\n', "not a CSV"),
    ],
)
def test_refuses_a_csv_whose_rows_do_not_fit(tmp_path, text, complaint):
    path = tmp_path / "t.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=complaint):
        list(read_csv(path)[1])


@given(content=st.binary(max_size=60))
def test_any_bytes_give_json_and_rows_or_an_input_error(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "any.txt"
    path.write_bytes(content)
    for read in (read_json, lambda path: list(read_csv(path)[1])):
        with contextlib.suppress(InputError):
            read(path)


def test_where_a_file_can_go_is_known_before_it_is_written(tmp_path):
    (tmp_path / "file").write_text("x")
    assert check_output(tmp_path / "new" / "t.csv") == tmp_path / "new" / "t.csv"
    assert check_output(tmp_path / "file") == tmp_path / "file"
    with pytest.raises(InputError, match="can't be written: it is a folder, a file is needed"):
        check_output(tmp_path)
    with pytest.raises(InputError, match=r"can't be written: .*file is not a folder"):
        check_output(tmp_path / "file" / "t.csv")
    assert os.listdir(tmp_path) == ["file"]


def test_a_folder_that_is_not_ours_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda *_: False)  # root may write anywhere
    with pytest.raises(InputError, match="can't be written: no permission to write in"):
        check_output(tmp_path / "t.csv")


def test_a_disk_that_refuses_is_told_in_one_line(tmp_path):
    def full():
        with writing(tmp_path / "t.csv"):
            raise OSError(28, "No space left on device")

    with pytest.raises(InputError, match=r"t.csv: can't be written: No space left on device"):
        full()
