import os
import stat

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_common.errors import InputError
from sandbot_common.files import read_yaml, whole_file, write_text


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
        (b"\xff\xfe\x00", "not a text file"),
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
    with pytest.raises(InputError, match="no such file"):
        read_yaml(tmp_path / "none.yaml")
    with pytest.raises(InputError, match="is a folder"):
        read_yaml(tmp_path)


@given(content=st.binary(max_size=60))
def test_any_bytes_give_a_mapping_or_an_input_error(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    path.write_bytes(content)
    try:
        result = read_yaml(path)
    except InputError as error:
        result = str(error)
    assert isinstance(result, dict) or "\n" not in result
