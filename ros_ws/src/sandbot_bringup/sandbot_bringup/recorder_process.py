"""The recorder of one live trial, a process of its own: what goes on is recorded whatever becomes of the campaign."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

from sandbot_common import topics

_FRAMES = {view.image for view in topics.VIEWS.values()}
_ENCODED = {view.jpeg for view in topics.VIEWS.values()}
"""Written by the recorder itself, from the frames."""


class RecorderProcess:
    """Records until it is told how the trial ended, or until this process is gone: its standard input ends then."""

    def __init__(self, bag: Path, images: str, attachments: Sequence[Path], namespace: str = "/") -> None:
        """``images``: none, jpeg, video or raw. ``namespace``: that of the trackway."""
        bag.parent.mkdir(parents=True, exist_ok=True)
        left_out = _ENCODED if images != "none" else _ENCODED | _FRAMES
        names = [topic.name for topic in topics.ALL if topic not in left_out]
        command = [sys.executable, "-m", "sandbot_record.tools.record", *names, "--images", images]
        command += ["--pause-images"] if images != "none" else []
        command += ["--fresh", "--end-with-stdin", "--out", str(bag), "--attach", *map(str, attachments)]
        command += ["--ros-args", "-r", f"__ns:={namespace}"]
        # A session of its own: Ctrl-C and a closed terminal reach us first, and the legs are stopped while it records.
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        self.ready, self.last_line = False, ""
        self._reader = threading.Thread(target=self._read, name="recorder", daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """Its number on this host."""
        return self._process.pid

    @property
    def ended(self) -> bool:
        """Whether it is gone, and everything it said has been read; who was killed has no last words to wait for."""
        code = self._process.poll()
        return code is not None and (code < 0 or not self._reader.is_alive())

    @property
    def frozen(self) -> bool:
        """Whether it has been stopped (SIGSTOP): it is our child, so the system tells at once."""
        if self._process.poll() is not None:
            return False
        found = os.waitid(os.P_PID, self._process.pid, os.WSTOPPED | os.WNOHANG | os.WNOWAIT)
        return found is not None

    @property
    def code(self) -> int | None:
        """Its exit code, once it has ended."""
        return self._process.poll()

    @property
    def why_ended(self) -> str:
        """Its last words, or the signal that left it none."""
        code = self.code or 0
        return f"killed by {signal.Signals(-code).name}" if code < 0 else self.last_line

    def tell(self, exit_status: str) -> None:
        """How the trial ended: one line, and the recording ends."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(" ".join(exit_status.split()) + "\n")
            self._process.stdin.close()
        except OSError:
            pass  # it has ended by itself

    def kill(self) -> None:
        """End it by force; what was flushed is for `recover`."""
        self._process.kill()
        self._process.wait()

    def _read(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as lines:
            for line in lines:
                self.last_line = line.strip() or self.last_line
                self.ready = self.ready or line.startswith("recording to")
