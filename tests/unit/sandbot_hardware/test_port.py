"""A serial line at a pseudo-terminal: what is a cable that is out, and what only a busy machine."""

import contextlib
import math
import os
import pty
import termios
import time
import tty

import pytest
import serial

from sandbot_hardware import lines, port
from sandbot_hardware.port import Port

pytestmark = pytest.mark.timeout(60)
LINE = lines.encode("B", 0.5)


def until(condition):
    end = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.005)


@pytest.fixture
def device():
    """Both ends of a line: the device's, and the name of the host's."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave)
    for file in (master, slave):
        with contextlib.suppress(OSError):  # pulled out
            os.close(file)


@pytest.fixture
def opened(device):
    """A port on that line, and what it hears."""
    heard = []
    one = Port(device[1], 921600, lambda line, _: heard.append(line))
    until(lambda: not one.trouble)
    yield one, heard
    one.close()


def test_lines_go_both_ways(device, opened):
    one, heard = opened
    assert one.write(LINE)
    assert os.read(device[0], 100) == LINE
    os.write(device[0], LINE)
    until(lambda: heard)
    assert heard[0].values == (0.5,)


def test_a_process_that_is_held_up_while_it_writes_has_lost_no_device(device, opened, monkeypatch):
    """pyserial's own write says `Write timeout` then, though all has gone out."""
    one, _ = opened
    write = os.write

    def held_up(file, data):
        written = write(file, data)
        time.sleep(2 * port._WAIT_S)
        return written

    monkeypatch.setattr(os, "write", held_up)
    assert one.write(LINE)
    assert (one.trouble, one.opened) == ("", 1)
    assert os.read(device[0], 100) == LINE
    other = serial.Serial(device[1], write_timeout=port._WAIT_S)
    with other, pytest.raises(serial.SerialTimeoutException):
        other.write(LINE)


def test_a_device_that_takes_nothing_is_lost_and_tried_again(opened):
    one, _ = opened
    while one.write(LINE * 100):  # until the line is full
        pass
    assert "took nothing for 0.1 s" in one.trouble
    until(lambda: one.opened == 2)


def test_a_cable_that_is_pulled_is_said(device, opened):
    one, _ = opened
    os.close(device[0])
    until(lambda: one.trouble)
    assert one.trouble.startswith(device[1])
    assert not one.write(LINE)


@pytest.mark.parametrize("call", ["tcsetattr", "tcflush"])
def test_a_cable_that_is_pulled_while_its_line_is_set_up_is_tried_again(device, monkeypatch, call):
    """pyserial lets termios.error through, and that is no OSError: the line was dead for good."""
    done, is_out = getattr(termios, call), [True]

    def pulled(*given):
        if any(is_out):
            raise termios.error(5, "Input/output error")
        return done(*given)

    monkeypatch.setattr(termios, call, pulled)
    one = Port(device[1], 921600, lambda line, _: None)
    until(lambda: "Input/output error" in one.trouble)
    is_out.clear()
    until(lambda: one.opened == 1)
    assert not one.trouble
    one.close()


def test_each_change_is_logged_once(device, tmp_path, monkeypatch):
    monkeypatch.setattr(port, "RETRY_S", 0.01)
    path, logged = tmp_path / "line", []
    one = Port(str(path), 921600, lambda line, _: None, logged.append)
    until(lambda: logged)
    time.sleep(0.1)  # ten more attempts
    assert logged == [f"{path}: No such file or directory; tried again every 0.01 s"]
    path.symlink_to(device[1])
    until(lambda: one.opened)
    until(lambda: len(logged) > 1)
    assert logged[1:] == [f"{path}: open"]
    one.close()


def test_a_line_that_opens_at_once_is_not_logged(device):
    logged = []
    one = Port(device[1], 921600, lambda line, _: None, logged.append)
    until(lambda: one.opened)
    one.close()
    assert logged == []


def test_a_line_has_one_driver(device, opened):
    """Two would take each other's bytes, and both command the same legs."""
    one, _ = opened
    other = Port(device[1], 921600, lambda line, _: None)
    until(lambda: "another program has it open" in other.trouble)
    assert not other.write(LINE)
    assert one.write(LINE)
    one.close()
    until(lambda: other.write(LINE))
    other.close()


def test_a_line_that_checks_and_means_nothing_is_damaged(device):
    heard = []
    one = Port(device[1], 921600, lambda line, _: heard.append(int(line.values[0])))
    until(lambda: not one.trouble)
    os.write(device[0], lines.encode("E", math.nan) + lines.encode("E", math.inf) + lines.encode("E", 7))
    until(lambda: heard)
    assert (heard, one.damaged, one.health) == ([7], 2, (0, "ok"))
    one.close()


def test_a_fault_of_the_driver_itself_is_told_and_commands_nothing_more(device, capsys):
    told = []
    one = Port(device[1], 921600, lambda line, _: {}[line.kind], told.append)
    until(lambda: not one.trouble)
    os.write(device[0], LINE)
    until(lambda: "KeyError: 'B'; restart the driver" in one.trouble)
    assert one.health == (2, one.trouble)
    assert not one.write(LINE)
    one.close()
    assert told == [one.trouble]
    assert "Traceback" in capsys.readouterr().err


def test_what_came_before_the_cable_was_out_swallows_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(port, "RETRY_S", 0.01)
    path, heard = tmp_path / "line", []

    def plugged_in():
        master, slave = pty.openpty()
        tty.setraw(slave)
        path.unlink(missing_ok=True)
        path.symlink_to(os.ttyname(slave))
        return master, slave

    first = plugged_in()
    one = Port(str(path), 921600, lambda line, _: heard.append(line))
    until(lambda: one.opened)
    os.write(first[0], b"noise\n" + LINE + lines.encode_block("C", 1, b"x" * 1000)[:500])
    until(lambda: heard)
    second = plugged_in()
    for file in first:
        os.close(file)
    until(lambda: one.opened == 2)
    os.write(second[0], lines.encode_block("C", 2, b"y"))
    until(lambda: len(heard) == 2)
    assert (heard[1].block, one.damaged) == (b"y", 1)
    one.close()
    for file in second:
        os.close(file)


ECHO = lines.encode("S", 1, 0.5)


@pytest.mark.parametrize(
    ("comes", "reports", "lack"),
    [
        (b"\x80\xfe\n" * 20, "", "only noise for 0.05 s: wrong baud rate, or a bad cable?"),
        (b"\xff" * 2000, "B", "only noise for 0.05 s: wrong baud rate, or a bad cable?"),
        (b"", "B", "no message for 0.05 s: is the device on?"),
        (ECHO, "B", "only 'S' messages for 0.05 s: another device's line, or an echo?"),
        (ECHO + LINE, "B", ""),
        (ECHO, "", ""),
        (b"", "", ""),
        (LINE, "B", ""),
        (b"noise\n" + LINE + b"noise\n", "", ""),
        (lines.encode_block("C", 1, b"x" * 9000)[:-8000], "", ""),  # a frame that takes its time
    ],
)
def test_a_line_without_a_message_is_an_error_until_one_comes(device, monkeypatch, comes, reports, lack):
    limit_s = 0.05 if lack else 1.0 if reports else 0.2
    monkeypatch.setattr(port, "LACK_S", limit_s)
    logged = []
    one = Port(device[1], 921600, lambda line, _: None, logged.append, reports=reports)
    until(lambda: one.opened)
    begun_s = time.monotonic()
    while time.monotonic() < begun_s + (20.0 if lack else 1.5 * limit_s) and not one.lack:
        os.write(device[0], comes)
        comes = b"x" if comes[:1] == b"C" else comes
        time.sleep(0.01)
    said = f"{device[1]}: {lack}"
    assert one.health == ((2, said) if lack else (0, "ok"))
    os.write(device[0], b"\n" * bool(comes) + LINE)
    until(lambda: not one.lack)
    assert logged[:2] == ([said, f"{device[1]}: messages again"] if lack else [])
    one.close()
