"""What is compiled runs wherever it is installed, whoever runs it, and with a full disk."""

import os
import subprocess
import sys

import pytest

from sandbot_common.compiled import compiled

MODULE = """
from sandbot_common.compiled import compiled

@compiled
def double(x):
    return 2 * x

@compiled(fastmath=True)
def half(x):
    return x / 2

print(double(21), half(84.0), sum(double.stats.cache_hits.values()))
"""


@pytest.fixture
def run(tmp_path):
    (tmp_path / "module.py").write_text(MODULE)

    def once(before="", **environment):
        code = f"{before}\nimport runpy; runpy.run_path('module.py')"
        command = [sys.executable, "-c", code]
        done = subprocess.run(
            command, capture_output=True, text=True, cwd=tmp_path, env={**os.environ, **environment}, timeout=120
        )
        assert done.returncode == 0, done.stderr
        return done.stdout.split()

    return once


def test_it_is_compiled_once_where_there_is_a_cache(run, tmp_path):
    cache = str(tmp_path / "cache")
    assert [run(NUMBA_CACHE_DIR=cache)[2] for _ in range(2)] == ["0", "1"]


NO_PLACE = """
from numba.core import caching
caching.FunctionCache._impl_class._locator_classes = []
"""
FULL = """
import builtins, errno
real = builtins.open
def full(file, mode="r", *rest, **more):
    if str(file).startswith("cache") and "w" in mode:
        raise OSError(errno.ENOSPC, "No space left on device", file)
    return real(file, mode, *rest, **more)
builtins.open = full
"""


@pytest.mark.parametrize("before", [NO_PLACE, FULL])
def test_without_a_place_or_room_for_a_cache_it_is_compiled_all_the_same(run, before):
    assert run(before, NUMBA_CACHE_DIR="cache") == ["42", "42.0", "0"]


def test_a_fault_in_what_is_compiled_is_told():
    @compiled
    def wrong(x):
        return x.nothing

    with pytest.raises(Exception, match="nothing"):
        wrong(1)


CALLEE = """
from sandbot_common.compiled import compiled

TIMES = 2

@compiled
def times(x):
    return TIMES * x
"""
CALLER = """
from sandbot_common.compiled import compiled
import callee
from callee import times

@compiled
def called(x):
    return {call}(x) + 1

print(called(20), sum(called.stats.cache_hits.values()))
"""


@pytest.mark.parametrize("call", ["times", "callee.times"])
def test_a_change_of_what_is_compiled_into_a_function_is_not_missed(run, tmp_path, call):
    (tmp_path / "module.py").write_text(CALLER.replace("{call}", call))
    for times, expected in ((2, ["41", "0"]), (2, ["41", "1"]), (3, ["61", "0"]), (3, ["61", "1"])):
        (tmp_path / "callee.py").write_text(CALLEE.replace("= 2", f"= {times}"))
        assert run("import sys; sys.path.insert(0, '')", PYTHONDONTWRITEBYTECODE="1") == expected
