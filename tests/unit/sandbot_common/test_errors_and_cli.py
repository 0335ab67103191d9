import argparse
import errno
import os
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

import pytest

from sandbot_common.cli import BAD_INPUT, INTERRUPTED, Outlet, Parser, output, run, with_ros
from sandbot_common.errors import InputError


def raising(error):
    def command(_):
        raise error

    return command


def test_bad_input_is_one_line_and_exit_2(capsys):
    assert run(raising(InputError("a.csv: row 3: phi: 'x' is not a number")), []) == BAD_INPUT == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.endswith(": error: a.csv: row 3: phi: 'x' is not a number\n")
    assert err.count("\n") == 1


def test_ctrl_c_is_130(capsys):
    assert run(raising(KeyboardInterrupt()), []) == INTERRUPTED == 130
    assert "interrupted" in capsys.readouterr().err


@pytest.mark.parametrize(("result", "code"), [(None, 0), (0, 0), (3, 3)])
def test_the_commands_own_code(result, code):
    assert run(lambda _: result, []) == code


def test_a_fault_of_ours_is_not_hidden():
    with pytest.raises(ZeroDivisionError):
        run(raising(ZeroDivisionError()), [])
    with pytest.raises(FileNotFoundError):
        run(raising(FileNotFoundError(errno.ENOENT, "No such file", "report.css")), [])


@pytest.mark.parametrize("number", [errno.EACCES, errno.EIO, errno.ESTALE])
def test_a_file_out_of_reach_is_one_line(capsys, number):
    assert run(raising(OSError(number, os.strerror(number), "week/tri\nals")), []) == BAD_INPUT
    err = capsys.readouterr().err
    assert err.endswith(f": error: week/tri als: {os.strerror(number)}\n")
    assert err.count("\n") == 1
    with pytest.raises(OSError, match=os.strerror(number)):  # of no file that is known
        run(raising(OSError(number, os.strerror(number))), [])


def test_a_name_too_long_for_a_file_is_one_short_line(capsys):
    assert run(lambda _: int(Path("x" * 300).exists()), []) == BAD_INPUT
    err = capsys.readouterr().err
    assert err.endswith(f": error: {'x' * 30}…{'x' * 30}: File name too long\n")
    assert err.count("\n") == 1


def test_parser_complains_in_one_line():
    parser = Parser(prog="table")
    parser.add_argument("--rate", type=float)
    with pytest.raises(InputError, match=r"invalid float value: 'fast' \(see table --help\)"):
        parser.parse_args(["--rate", "fast"])


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        (["--effct", "x"], "no option --effct, did you mean '--effect'?"),
        (["--effect-from=x"], "no option --effect-from, did you mean '--effects-from'?"),
        (["--zzz"], "no option --zzz; known: --help, --effect, --effects-from"),
        (["more"], "'more' is one argument too many"),
    ],
)
def test_a_strange_option_is_answered_with_the_one_that_may_be_meant(typed, said):
    parser = Parser(prog="explore")
    parser.add_argument("--effect")
    parser.add_argument("--effects-from")
    with pytest.raises(InputError) as complaint:
        parser.parse_args(typed)
    assert str(complaint.value) == f"{said} (see explore --help)"
    assert parser.parse_args(["--effect", "x"]).effects_from is None


def test_an_option_is_never_read_as_a_longer_one():
    parser = Parser(prog="explore")
    parser.add_argument("--effects-from")
    with pytest.raises(InputError, match="no option --effect, did you mean '--effects-from'"):
        parser.parse_args(["--effect", "x"])


def wrote(*words):
    parser = Parser(prog="compare")
    parser.add_argument("data", type=Path, nargs="+", metavar="DATA")
    parser.add_argument("--title")
    for name in ("--json", "--html"):
        parser.add_argument(name, type=output)
    return parser.parse_args([*words])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("a.csv t.csv --json t.csv", "--json t.csv: would replace DATA t.csv; give another name"),
        ("t.csv --json ./there/../t.csv", "--json there/../t.csv: would replace DATA t.csv"),
        ("t.csv --json link.csv", "--json link.csv: would replace DATA t.csv"),
        ("t.csv --json hard.csv", "--json hard.csv: would replace DATA t.csv"),
        ("t.csv --json new.json --html new.json", "--json new.json: would replace --html new.json"),
    ],
)
def test_no_output_replaces_what_it_is_made_from_nor_another(tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    Path("t.csv").write_text("phi")
    Path("there").mkdir()
    Path("link.csv").symlink_to("t.csv")
    Path("hard.csv").hardlink_to("t.csv")
    with pytest.raises(InputError) as refused:
        wrote(*words.split())
    assert str(refused.value).startswith(said)


@pytest.mark.parametrize(
    "words",
    [
        "t.csv --json new.json --html new.html",
        "t.csv --json t.json --title t.json",
        "t.csv --json /dev/null --html /dev/null",
    ],
)
def test_other_outputs_are_taken(tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    Path("t.csv").write_text("phi")
    assert wrote(*words.split()).json is not None


def test_a_line_is_seen_through_a_pipe_when_it_is_said():
    code = "from sandbot_common import cli; cli.run(lambda _: print('said') or input() and 0, [])"
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    with subprocess.Popen(
        [sys.executable, "-c", code], env=environment, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout.readline() == "said\n"
        process.communicate("done\n", timeout=10)


@pytest.mark.parametrize("stream", ["stdout", "stderr"])
@pytest.mark.parametrize("reads", [True, False])
def test_a_reader_that_leaves_does_not_end_the_work(tmp_path, reads, stream):
    """As in ``compare DATA --html OUT | head -1`` and ``campaign PLAN 2>&1 | head``: the file is still written."""
    wrote = tmp_path / "out.txt"
    code = (
        "import sys; from pathlib import Path; from sandbot_common import cli\n"
        "def work(_):\n"
        "    input(); out = getattr(sys, sys.argv[2]); print('one', file=out)\n"
        "    print('two', file=out, flush=True); Path(sys.argv[1]).write_text('whole')\n"
        "sys.exit(cli.run(work, []))"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(wrote), stream], text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:  # fmt: skip
        said, other = (getattr(process, name) for name in sorted(("stdout", "stderr"), key=lambda one: one != stream))
        if not reads:
            said.close()
        process.stdin.write("\n")
        process.stdin.flush()
        if reads:
            assert said.read() == "one\ntwo\n"
        assert (other.read(), process.wait(60)) == ("", 0)
    assert wrote.read_text() == "whole"


@pytest.mark.parametrize(("how", "said"), [(">&- 2>&-", ""), ("", "? 0.6")])
def test_outputs_that_are_closed_or_know_no_greek_do_not_end_the_work(tmp_path, how, said):
    code = (
        "import sys; from pathlib import Path; from sandbot_common import cli\n"
        "def work(_): print('φ 0.6', sys.stdout.isatty() or ''); Path(sys.argv[1]).write_text('whole')\n"
        "sys.exit(cli.run(work, []))"
    )
    words = ["sh", "-c", f'"$@" {how}', "sh", sys.executable, "-c", code, str(tmp_path / "out.txt")]
    ascii_only = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = subprocess.run(words, env=ascii_only, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, said, "")
    assert (tmp_path / "out.txt").read_text() == "whole"


def test_output_lost_on_a_full_disk_is_an_error_after_the_work_is_done(tmp_path):
    """As in ``compare DATA --html OUT > /on/a/full/disk``."""
    code = (
        "import sys; from pathlib import Path; from sandbot_common import cli\n"
        "def work(_):\n"
        "    for _ in range(9): print('line', flush=True)\n"
        "    Path(sys.argv[1]).write_text('whole')\n"
        "sys.exit(cli.run(work, []))"
    )
    words = ["sh", "-c", '"$@" >/dev/full', "sh", sys.executable, "-c", code, str(tmp_path / "out.txt")]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == BAD_INPUT
    assert done.stderr == "-c: error: output: No space left on device; files written by the command are complete\n"
    assert (tmp_path / "out.txt").read_text() == "whole"


def test_a_stream_that_falls_silent_keeps_one_file_open():
    full = Outlet(open("/dev/full", "wb", buffering=0), line_buffering=True)  # noqa: SIM115
    before = os.listdir("/proc/self/fd")
    full.write("lost\n")
    assert full.lost is not None
    assert len(os.listdir("/proc/self/fd")) == len(before)
    full.write("discarded\n")
    full.close()


@pytest.mark.parametrize(
    ("name", "known"), [("use_sim_time", True), ("start_type_description_service", True), ("rate", False)]
)
def test_a_command_with_options_takes_what_every_node_has(name, known):
    words = ["--ros-args", "-p", f"{name}:=false"]
    with nullcontext() if known else pytest.raises(InputError, match="set by options of its own"):
        assert with_ros(Parser("one"), words)[1] == words


def test_standard_output_has_a_name_and_a_file_called_minus_another(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(argparse.ArgumentTypeError, match="standard output is /dev/stdout"):
        output("-")
    assert (output("./-"), output("/dev/stdout")) == (Path("-"), Path("/dev/stdout"))
