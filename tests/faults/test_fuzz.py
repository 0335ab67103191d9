"""A sample of `make fuzz`, every case that once failed, and whether a parser that fails would be caught."""

import json
import time

import fuzz
import pytest
from fuzz_parsers import PARSERS, Parser

from sandbot_common.errors import InputError

BY_NAME = {parser.name: parser for parser in PARSERS}
SLOW = {"bag": 60, "message": 20, "discovery": 20}
"""Cases of those that read much, or whose good files take seconds to make."""
SAMPLE = 150

ONCE_FAILED = {
    "world": [b"started: 2026-13-45\n", b"a: !!timestamp x\n", b"noise: {x: !!int ''}\n"],
    "plan": [
        b"name: a\nphi: [0.6]\nomega_rad_s: [8]\nreplicates: 1" + b"0" * 400 + b"\n",
        b"name: a\nphi: [0.6]\nomega_rad_s: [8]\nbed: {average_s: 50.0}\n",
    ],
    "robot": [b"mass_kg: 1" + b"0" * 400 + b"\n"],
    "cameras": [b"dorsal: {rotation: [[1" + b"0" * 400 + b", 0, 0], [0, 1, 0], [0, 0, 1]]}\n"],
    "formula": [
        b"late: clock: omega*where(phi > [], 1, 2)",
        b"late: clock: omega*minimum((), 1)",
        b"slip: speed: kept == 1 - d/R",
        b"slip: speed: kept*{1: 2}",
    ],
    "selection": [
        b"schema: sandbot.selection/1\n1: 2\nx: 3\ntrue: 4\n",
        b"schema: sandbot.selection/1\nformulas: [nan]\n",
        b"schema: sandbot.selection/1\nby_hand: {delta_t_s: 1" + b"0" * 400 + b"}\n",
    ],
    "address": [b"?" + b"against=?" * 2000],
    "discovery": [
        json.dumps({"model": "simple", "steps": [{"parameters": {}, "effects": [], "k_n_per_m": rows}]}).encode()
        for rows in ([{"phi": 0.6, "value": "x"}], [{"phi": [1], "value": 1}], [])
    ]
    + [
        b'{"schema": "sandbot.discovery/2", "verdict": {"status": "", "effects": [], "because": ""}, '
        b'"noise_floor_m_s": null, "steps": [{"effects": [], "cv_rmse_m_s": "x"}]}'
    ],
    "looks": [b"3\n", b"{}\n", b'{"look": 1, "planned": 1, "finished": 1, "text": "", "next": [{"phi": "x"}]}\n'],
    "message": [b"/trial\n\x00\x01\x00\x00\xff\xff\xff\xff", b"/leg_states\n", b"/bed/status\n\x00"],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fuzz")


@pytest.mark.slow
@pytest.mark.parametrize("parser", PARSERS, ids=lambda parser: parser.name)
def test_spoilt_files_are_read_or_refused_in_one_line(parser, folder):
    count = fuzz.Count()
    fuzz.cases(parser, range(SLOW.get(parser.name, SAMPLE)), folder, count)
    assert count.failures == []
    assert count.good + count.refused == count.cases > 0


@pytest.mark.slow
@pytest.mark.parametrize("parser", PARSERS, ids=lambda parser: parser.name)
def test_files_that_are_not_spoilt_are_read(parser, folder):
    (folder / parser.name).mkdir(exist_ok=True)
    path = folder / parser.name / parser.file
    assert fuzz.run(parser, path, parser.seeds(folder / parser.name)[0]) == "good"


@pytest.mark.slow
@pytest.mark.parametrize(("name", "content"), [(name, one) for name, all_ in ONCE_FAILED.items() for one in all_])
def test_what_once_failed_is_refused(name, content, folder):
    (folder / name).mkdir(exist_ok=True)
    ended = fuzz.run(BY_NAME[name], folder / name / BY_NAME[name].file, content)
    # A message that is none may leave a row whose status says so.
    assert ended == "refused" or (name, ended) == ("message", "good")


def refusing(path):
    raise InputError("line 1\nline 2")


def nameless(path):
    raise InputError("something is wrong")


def waiting(path):
    while True:
        time.sleep(0.01)


def working(path):
    while True:
        pass


@pytest.mark.slow
@pytest.mark.parametrize(
    ("read", "found"),
    [
        (lambda path: 1 / 0, "ZeroDivisionError"),
        (refusing, "several lines"),
        (nameless, "without the file's name"),
        (waiting, "HangError"),
        (working, "HangError"),
    ],
)
def test_a_parser_that_fails_is_caught(read, found, tmp_path, monkeypatch):
    monkeypatch.setattr(fuzz, "CPU_S", 0.1)
    monkeypatch.setattr(fuzz, "WALL_S", 1.0)
    parser, count = Parser("bad", "bad.txt", read, lambda _: [b"a: 1\n"]), fuzz.Count()
    fuzz.cases(parser, range(2), tmp_path, count)
    assert [one.partition(": ")[2].startswith(found) for one in count.failures] == [True, True]


def test_a_case_that_failed_is_run_again_and_counted_as_mended(tmp_path):
    bad, good = (Parser("one", "one.txt", read, lambda _: [b"a: 1\n"]) for read in (lambda path: 1 / 0, len_of))
    count = fuzz.Count()
    fuzz.cases(bad, range(3), tmp_path, count)
    fuzz.again_what_failed(bad, tmp_path, count)
    assert (len(count.failures), count.mended) == (3, 0)
    fuzz.again_what_failed(good, tmp_path, count)
    assert (count.failures, count.mended, count.good, count.cases) == ([], 3, 3, 3)


def len_of(path):
    return len(path.read_bytes())


def test_a_case_can_be_had_again():
    assert fuzz.spoilt([b"phi: 0.6\n"], 7, "plan") == fuzz.spoilt([b"phi: 0.6\n"], 7, "plan")
    assert len({fuzz.spoilt([b"phi: [0.6, 0.62]\nomega: 8\n"], number, "plan") for number in range(50)}) > 25
