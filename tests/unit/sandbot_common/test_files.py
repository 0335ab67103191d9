import contextlib
import csv
import os
import re
import stat
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_common.delimited_text import read_csv
from sandbot_common.errors import InputError
from sandbot_common.files import (
    base_name,
    check_output,
    parse_json,
    read_json,
    read_text,
    whole_file,
    write_text,
    writing,
)
from sandbot_common.yaml_text import read_yaml


def test_writes_whole_and_makes_the_folder(tmp_path):
    path = tmp_path / "a" / "b.txt"
    write_text(path, "φ\n")
    assert path.read_text(encoding="utf-8") == "φ\n"
    assert os.listdir(path.parent) == ["b.txt"]


def test_the_name_of_data_is_the_folders_or_the_files_without_its_ending(tmp_path, monkeypatch):
    (folder := tmp_path / "2024.05.12").mkdir()
    (folder / "t.v2.csv").touch()
    (tmp_path / "latest.run").symlink_to(folder)
    monkeypatch.chdir(folder)
    names = {".": "2024.05.12", "..": tmp_path.name, "t.v2.csv": "t.v2", "../latest.run": "latest.run"}
    assert {path: base_name(Path(path)) for path in names} == names


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


@pytest.mark.parametrize("there", [True, False])
def test_a_link_goes_on_leading_to_the_file(tmp_path, there):
    (tmp_path / "disk").mkdir()
    file, link = tmp_path / "disk" / "b.txt", tmp_path / "b.txt"
    if there:
        file.write_text("old")
    link.symlink_to(file)
    write_text(check_output(link), "new")
    assert link.is_symlink()
    assert file.read_text() == "new"
    assert os.listdir(tmp_path / "disk") == ["b.txt"]


def test_a_pipe_is_written_into_and_stays_one(tmp_path):
    pipe = tmp_path / "b.txt"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDWR | os.O_NONBLOCK)
    write_text(check_output(pipe), "new")
    assert os.read(reader, 10) == b"new"
    os.close(reader)
    assert pipe.is_fifo()
    assert os.listdir(tmp_path) == ["b.txt"]


def test_a_link_that_leads_nowhere_is_answered(tmp_path):
    (tmp_path / "b.txt").symlink_to("b.txt")
    write_text(check_output(tmp_path / "b.txt"), "new")
    assert (tmp_path / "b.txt").read_text() == "new"


def test_results_are_for_colleagues_too(tmp_path, monkeypatch):
    path = tmp_path / "b.txt"
    umask = os.umask
    before = umask(0o022)
    # Another thread's file would be anybody's to write meanwhile.
    monkeypatch.setattr(os, "umask", lambda _: pytest.fail("the umask is changed for all threads"))
    try:
        write_text(path, "x")
    finally:
        umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o644


def test_reads_a_mapping(tmp_path):
    path = tmp_path / "c.yaml"
    path.write_text("a: 1\nb: [1, 2]\n")
    assert read_yaml(path) == {"a": 1, "b": [1, 2]}


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"- 1\n", "c.yaml: lines 'key: value' are needed"),
        (b"", "c.yaml: is empty; lines"),
        (b"a: [1\n", "not YAML: line 2, column 1: while parsing a flow sequence"),
        (b"a:\n  b: 1\n\tc: 2\n", "not YAML: line 3, column 1: a tab; indent by spaces"),
        (b"a: {b: c: d}\n", "not YAML: line 1, column "),
        (b"\xff\xfe\x00", r"not a text file \(UTF-8\); a YAML file is needed"),
        (b"PK\x03\x04\x14\x00\xff", r"of a spreadsheet \(.xlsx, .ods\) save the sheet as CSV"),
    ],
)
def test_refuses_what_is_no_mapping_in_one_line(tmp_path, content, complaint):
    path = tmp_path / "c.yaml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=complaint) as caught:
        read_yaml(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("phi: [0.6]\nseed: 1\nphi: [0.62]\n", "line 3: key 'phi'"),
        ("bed: {max_pulses: 8, max_pulses: 9}\n", "line 1: key 'max_pulses'"),
        ("all:\n- x: 1\n- y: 1\n  x: 2\n  y: 3\n", "line 5: key 'y'"),
    ],
)
def test_a_key_that_is_there_twice_is_refused(tmp_path, text, said):
    path = tmp_path / "c.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as refused:
        read_yaml(path)
    assert str(refused.value) == f"{path}: not YAML: {said} is there twice"


def test_merged_keys_may_be_overridden_and_merged_again(tmp_path):
    path = tmp_path / "c.yaml"
    path.write_text(
        "a: &a {x: 1, y: 2}\nb: [[&b {<<: *a, x: 3}]]\nc: {<<: *b, y: 4}\nd: {<<: [*b, *a]}\n1: x\n'1': y\n"
    )
    x3y2 = {"x": 3, "y": 2}
    assert read_yaml(path) == {
        "a": {"x": 1, "y": 2}, "b": [[x3y2]], "c": {"x": 3, "y": 4}, "d": x3y2, 1: "x", "1": "y"
    }  # fmt: skip


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
    with pytest.raises(InputError, match=r"^/trial: not JSON: [^\n]*; write it again$"):
        parse_json(text, "/trial", "; write it again")


def test_a_file_where_a_folder_is_needed_is_named(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("phi\n")
    with pytest.raises(InputError, match=r"a\.csv is a file, a folder is needed$"):
        read_text(path / "trials.csv")
    with pytest.raises(InputError, match=r"can't be written: .*a\.csv is a file, a folder is needed$"), writing(path):
        path.mkdir()
    with pytest.raises(InputError, match=r"b\.csv: no such file$"):
        read_text(tmp_path / "b.csv")


def test_reads_a_csv_by_column_with_the_number_of_each_row(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text('\ufeff phi , note\n0.6," a, b"\n\n , \n0.61, c\n', encoding="utf-8")
    header, rows = read_csv(path)
    assert header == ["phi", "note"]
    assert list(rows) == [(2, {"phi": "0.6", "note": "a, b"}), (5, {"phi": "0.61", "note": "c"})]


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("a,b\n1\n", "row 2: 1 value for 2 columns"),
        # An unquoted comma in each remark, as in one: the spaces after it separate nothing.
        ("a,b,remark\n1,2,ok, dry\n3,4,ok, dry\n", "row 2: 4 values for 3 columns"),
        ("a;b;remark\n5;2;ok; dry\n6;2;ok; dry\n", "row 2: 4 values for 3 columns"),
        ("a,b,remark\n1,2,ok\n3,4,ok, dry\n", "row 3: 4 values for 3 columns"),
        ("a,b,a\n1,2,3\n", "row 1: column a is there twice"),
        ('a,b\n"1,2\n', "not a CSV"),
        ("a\0,\0b\0\n", "has NUL bytes, as UTF-16 without a byte order mark: save it as UTF-8"),
        ('[{"a": 1, "b": 2}]', "is JSON, a CSV file is needed"),
        ("a,b\n1,2\nsecond day\n", "row 3: 1 value for 2 columns"),
    ],
)
def test_refuses_a_csv_whose_rows_do_not_fit(tmp_path, text, complaint):
    path = tmp_path / "t.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=complaint):
        list(read_csv(path)[1])


def test_comments_between_rows_are_skipped(tmp_path):
    """A row whose first value begins with # is one."""
    (tmp_path / "t.csv").write_text("a,b\n1,2\n# second day\n#3,4\n# third,,\n")
    assert [number for number, _ in read_csv(tmp_path / "t.csv")[1]] == [2, 4]


def rows_of(path, text):
    path.write_text(text, encoding="utf-8", newline="")
    header, rows = read_csv(path)
    return header, [(number, list(cells.values())) for number, cells in rows]


@pytest.mark.parametrize(
    ("text", "header", "rows"),
    [
        # What is quoted separates nothing, and breaks no line.
        ('a;b\n1;"x; y"\n', ["a", "b"], [(2, ["1", "x; y"])]),
        ('a;"b, c"\n1,5;x\n', ["a", "b, c"], [(2, ["1.5", "x"])]),
        ('a;"b\r\n[m]"\r\n1,5;2\r\n', ["a", "b [m]"], [(2, ["1.5", "2"])]),
        # Commas between the values, and other signs in each note.
        ("a,b\n1,x; y; z\n2,u; v; w\n", ["a", "b"], [(2, ["1", "x; y; z"]), (3, ["2", "u; v; w"])]),
        ("title\na,b\n1,x; y; z\n", ["a", "b"], [(3, ["1", "x; y; z"])]),
        ('a,b\n1,"x\ty"\n', ["a", "b"], [(2, ["1", "x\ty"])]),
        # A title of one word, above spaces.
        ("title,1\na b\n1,5 2\n", ["a", "b"], [(3, ["1.5", "2"])]),
        # A column of words keeps its points.
        ("a;b\n1,5;1.2\n2,5;two\n", ["a", "b"], [(2, ["1.5", "1.2"]), (3, ["2.5", "two"])]),
        ("a;b\n1.5;nan\n", ["a", "b"], [(2, ["1.5", "nan"])]),
    ],
)
def test_the_sign_that_gives_each_row_as_many_cells_separates(tmp_path, text, header, rows):
    assert rows_of(tmp_path / "t.csv", text) == (header, rows)


def test_a_line_is_a_title_only_where_names_that_matter_follow(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("Sand, 2026\na,b,c\n1,2,3\n")
    header, rows = read_csv(path, matters=lambda name: name in "ab")
    assert (header, list(rows)) == (["a", "b", "c"], [(3, {"a": "1", "b": "2", "c": "3"})])
    path.write_text("Sand,Robot,x\n1,2,3\n")
    assert read_csv(path, matters=lambda name: name in "ab")[0] == ["Sand", "Robot", "x"]
    assert read_csv(path)[0] == ["Sand", "Robot", "x"]


@pytest.mark.parametrize("first", ["sep=|", '"sep=|"', "SEP=|", "sep=|||"])
def test_a_first_line_may_name_the_sign(tmp_path, first):
    text = f"{first}\na,x|b\n1,5|2\n"
    assert rows_of(tmp_path / "t.csv", text) == (["a,x", "b"], [(3, ["1.5", "2"])])
    # Control: without it, or where it names none, the comma separates.
    assert rows_of(tmp_path / "t.csv", "a,x|b\n1,5|2\n")[0] == ["a", "x|b"]
    assert rows_of(tmp_path / "t.csv", "sep=a,b\n1,2\n")[0] == ["sep=a", "b"]


@pytest.mark.parametrize(
    ("text", "header"),
    [
        ("# a,b\n1,2\n", ["a", "b"]),
        ("# by hand\n#a, b\n\n1,2\n", ["a", "b"]),
        ("# on Monday, by hand\na,b\n1,2\n", ["a", "b"]),  # controls: another header, another width, no names
        ("# a,b,c\n1,2\n", ["1", "2"]),
        ("# 3,4\n1,2\n", ["1", "2"]),
        ("# a,b\n", []),
    ],
)
def test_a_remark_is_the_header_only_where_no_other_is(tmp_path, text, header):
    assert rows_of(tmp_path / "t.csv", text)[0] == header


@pytest.mark.parametrize("sign", ";\t")
def test_numbers_with_a_comma_and_with_a_point_are_refused_together(tmp_path, sign):
    path = tmp_path / "t.csv"
    complaint = r"row 3, column b: '1,200' has a comma, but row 2, column a: '0\.5' has a point"
    with pytest.raises(InputError, match=complaint):
        rows_of(path, "a;b\n0.5;7\n1;1,200\n".replace(";", sign))
    # Control: each alone is read.
    assert rows_of(path, "a;b\n0.5;7\n1;1.2\n".replace(";", sign))[1] == [(2, ["0.5", "7"]), (3, ["1", "1.2"])]
    assert rows_of(path, "a;b\n0,5;7\n1;1,2\n".replace(";", sign))[1] == [(2, ["0.5", "7"]), (3, ["1", "1.2"])]


@given(
    table=st.lists(
        # Remarks with a letter: the reader rightly takes ",1" for a number, and refuses 1.625 alone, which may be 1625.
        st.tuples(
            st.floats(-1e3, 1e3).filter(lambda number: not re.fullmatch(r"-?[1-9]\d{0,2}\.\d{3}", str(number))),
            st.just("") | st.text('abc;,\t"\n .1', max_size=6).map("{}a".format).map(str.strip),
        ),
        min_size=1,
        max_size=4,
    ),
    sign=st.sampled_from(",;\t"),
    comma=st.booleans(),
)
def test_what_a_spreadsheet_writes_is_read_as_it_was(tmp_path_factory, table, sign, comma):
    path = tmp_path_factory.getbasetemp() / "sheet.csv"
    with path.open("w", newline="") as file:
        writer = csv.writer(file, delimiter=sign)
        writer.writerow(["speed [m/s]", "remark, if any", "told"])
        for number, text in table:
            writer.writerow([str(number).replace(".", "," if comma and sign != "," else "."), text, "yes"])
    header, rows = read_csv(path)
    assert header == ["speed [m/s]", "remark, if any", "told"]
    cells = [list(row.values()) for _, row in rows]
    assert [(float(number), told) for number, _, told in cells] == [(number, "yes") for number, _ in table]


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


def test_a_folder_that_takes_no_file_is_refused():
    with pytest.raises(InputError, match="can't be written: no file can be made in /proc"):  # not even by root
        check_output(Path("/proc/new/t.csv"))


def test_a_disk_that_refuses_is_told_in_one_line(tmp_path):
    def full():
        with writing(tmp_path / "t.csv"):
            raise OSError(28, "No space left on device")

    with pytest.raises(InputError, match=r"t.csv: can't be written: No space left on device"):
        full()
