"""When a recorder is over: at once where it was killed, with its last words where it ended."""

import contextlib
import os
import signal
from types import SimpleNamespace

import pytest

from sandbot_bringup import recorder_process
from sandbot_bringup.recorder_process import RecorderProcess
from sandbot_common.cli import with_ros
from sandbot_record.tools import record

SCRIPT = """#!/bin/sh
sleep 60 &
echo $!
{end}
"""
"""A recorder whose words are still under way when it is gone: somebody holds the other end of its output."""


@pytest.mark.parametrize(("end", "over"), [("kill -9 $$", True), ("exit 1", False)])
def test_who_was_killed_has_no_last_words_to_wait_for(end, over, tmp_path, monkeypatch):
    script = tmp_path / "python"
    script.write_text(SCRIPT.format(end=end))
    script.chmod(0o755)
    monkeypatch.setattr(recorder_process.sys, "executable", str(script))
    recorder = RecorderProcess(tmp_path / "bag", "none", [])
    try:
        recorder._process.wait(60)
        while not recorder.last_line:
            recorder._reader.join(0.01)
        assert recorder.ended is over
        assert not over or recorder.why_ended == "killed by SIGKILL"
    finally:
        with contextlib.suppress(ValueError, ProcessLookupError):
            os.kill(int(recorder.last_line), signal.SIGKILL)
        recorder._reader.join(60)
    assert recorder.ended


def test_of_a_recorder_that_we_killed_the_reason_is_ours(tmp_path, monkeypatch):
    script = tmp_path / "python"
    script.write_text("#!/bin/sh\nexec sleep 60\n")
    script.chmod(0o755)
    monkeypatch.setattr(recorder_process.sys, "executable", str(script))
    recorder = RecorderProcess(tmp_path / "bag", "none", [])
    assert not recorder.awaits_disk
    recorder.kill("its bag was not closed within 30 s")
    recorder._reader.join(60)
    assert recorder.why_ended == "its bag was not closed within 30 s"


@pytest.mark.parametrize("images", ["none", "jpeg"])
def test_the_recorder_takes_what_it_is_told(images, tmp_path, monkeypatch):
    told = []
    monkeypatch.setattr(recorder_process.subprocess, "Popen", lambda command, **_: told.extend(command))
    monkeypatch.setattr(recorder_process.threading, "Thread", lambda **_: SimpleNamespace(start=lambda: None))
    RecorderProcess(tmp_path / "bag", images, [tmp_path / "campaign.yaml"])
    options, _ = with_ros(record._parser(), told[3:])
    record._check(options)
    assert options.pause_images is (images != "none")
