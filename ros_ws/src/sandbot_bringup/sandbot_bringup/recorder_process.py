"""The recorder of one live trial, a separate process: it goes on recording whatever happens to the campaign."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

from sandbot_common import topics
from sandbot_common.process import awaits_disk

_FRAMES = {view.image for view in topics.VIEWS.values()}
_ENCODED = {view.jpeg for view in topics.VIEWS.values()}
"""Topics that the recorder itself makes from the frames."""


class RecorderProcess:
    """Records until ``tell`` gives it the exit status, or until this process is gone, which ends its standard input."""

    def __init__(self, bag: Path, images: str, attachments: Sequence[Path], namespace: str = "/") -> None:
        """``images``: none, jpeg, video or raw. ``namespace``: that of the trackway."""
        left_out = _ENCODED if images != "none" else _ENCODED | _FRAMES
        names = [topic.name for topic in topics.ALL if topic not in left_out]
        command = [sys.executable, "-m", "sandbot_record.tools.record", *names, "--images", images]
        command += ["--pause-images"] if images != "none" else []
        command += ["--fresh", "--end-with-stdin", "--out", str(bag), "--attach", *map(str, attachments)]
        command += ["--ros-args", "-r", f"__ns:={namespace}"]
        # In its own session: Ctrl-C and a closed terminal reach only us, and the legs are stopped while it records.
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        self.ready, self.last_line, self._killed = False, "", ""
        self._reader = threading.Thread(target=self._read, name="recorder", daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """Its process ID."""
        return self._process.pid

    @property
    def ended(self) -> bool:
        """Whether it is gone and its output has been read; if it was killed there is no last line to wait for."""
        code = self._process.poll()
        return code is not None and (code < 0 or not self._reader.is_alive())

    @property
    def frozen(self) -> bool:
        """Whether it has been stopped (SIGSTOP), which the system reports at once for a child process."""
        if self._process.poll() is not None:
            return False
        found = os.waitid(os.P_PID, self._process.pid, os.WSTOPPED | os.WNOHANG | os.WNOWAIT)
        return found is not None

    @property
    def awaits_disk(self) -> bool:
        """Whether it waits for a disk that does not answer."""
        return awaits_disk(self.pid)

    @property
    def code(self) -> int | None:
        """Its exit code, once it has ended."""
        return self._process.poll()

    @property
    def why_ended(self) -> str:
        """Its last line of output, or the signal that killed it, or why we did."""
        code = self.code or 0
        if self._killed:
            return self._killed
        return f"killed by {signal.Signals(-code).name}" if code < 0 else self.last_line

    def tell(self, exit_status: str) -> None:
        """Send the trial's exit status, one line, which ends the recording."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(" ".join(exit_status.split()) + "\n")
            self._process.stdin.close()
        except OSError:
            pass  # it has ended by itself

    def kill(self, why: str) -> None:
        """Kill it; `recover` can restore what was flushed."""
        self._killed = why
        self._process.kill()
        self._process.wait()

    def _read(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as lines:
            for line in lines:
                self.last_line = line.strip() or self.last_line
                self.ready = self.ready or line.startswith("recording to")
