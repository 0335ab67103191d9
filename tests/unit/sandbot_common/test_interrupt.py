"""Ctrl-C is raised once, and not within an import, a lock or a compiled call."""

import signal
import subprocess
import sys
import threading

import pytest

from sandbot_common.interrupt import PATIENCE_S, ctrl_c_where_safe


@pytest.fixture(autouse=True)
def handlers():
    """The handlers of this process are the usual ones, before a test and after it."""
    before = signal.getsignal(signal.SIGALRM), signal.getsignal(signal.SIGINT)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    after = signal.getsignal(signal.SIGALRM), signal.getsignal(signal.SIGINT)
    signal.signal(signal.SIGINT, before[1])
    assert after == (before[0], signal.default_int_handler)


def interrupted(function, *arguments):
    """What a function has appended to a list when Ctrl-C ends it."""
    seen = []
    with pytest.raises(KeyboardInterrupt), ctrl_c_where_safe():
        function(seen, *arguments)
    return seen


def within(seen, package):
    """Ctrl-C comes in the middle of a call of a package."""
    code = "signal.raise_signal(signal.SIGINT); seen.append('the call ended')"
    exec(code, {"__name__": f"{package}.inner", "signal": signal, "seen": seen})


def within_and_after(seen, package):
    within(seen, package)
    signal.sigtimedwait([], 60)
    seen.append("and so did what follows")


def waiting(seen):
    threading.Timer(0.05, signal.pthread_kill, (threading.get_ident(), signal.SIGINT)).start()
    threading.Event().wait(60)
    seen.append("waited to the end")


def cleaning_up(seen):
    try:
        signal.raise_signal(signal.SIGINT)
    finally:
        signal.raise_signal(signal.SIGINT)
        seen.append("clean")


def test_ctrl_c_in_ones_own_code_is_raised_at_once():
    assert interrupted(within, "sandbot_model") == []


@pytest.mark.parametrize("package", PATIENCE_S)
def test_ctrl_c_is_held_back_until_a_call_that_would_not_bear_it_has_ended(package):
    assert interrupted(within_and_after, package) == ["the call ended"]


def test_an_interrupt_still_held_back_at_the_end_is_not_lost():
    assert interrupted(within, "numba") == ["the call ended"]


def test_who_waits_in_a_lock_is_interrupted():
    assert interrupted(waiting) == []


def test_cleaning_up_is_not_interrupted_again():
    assert interrupted(cleaning_up) == ["clean"]


def test_a_handler_of_somebody_else_is_left_alone():
    heard = []
    signal.signal(signal.SIGINT, lambda *_: heard.append("heard"))
    try:
        with ctrl_c_where_safe():
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    assert heard == ["heard"]


LAST = """
import atexit, signal, sys
from sandbot_common import cli

signal.signal(signal.SIGINT, signal.default_int_handler)
atexit.register(signal.raise_signal, signal.SIGINT)
sys.exit(cli.run(lambda _: signal.raise_signal(signal.SIGINT), []))
"""


def test_ctrl_c_typed_again_does_not_spoil_the_exit_of_a_command():
    done = subprocess.run([sys.executable, "-c", LAST], text=True, capture_output=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (130, "-c: interrupted; what was finished is kept\n")
