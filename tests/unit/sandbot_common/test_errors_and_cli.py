import os
import subprocess
import sys

import pytest

from sandbot_common.cli import BAD_INPUT, INTERRUPTED, Parser, run
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


def test_parser_complains_in_one_line():
    parser = Parser(prog="table")
    parser.add_argument("--rate", type=float)
    with pytest.raises(InputError, match=r"invalid float value: 'fast' \(see table --help\)"):
        parser.parse_args(["--rate", "fast"])


def test_a_line_is_seen_through_a_pipe_when_it_is_said():
    code = "from sandbot_common import cli; cli.run(lambda _: print('said') or input() and 0, [])"
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    with subprocess.Popen(
        [sys.executable, "-c", code], env=environment, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout.readline() == "said\n"
        process.communicate("done\n", timeout=10)
