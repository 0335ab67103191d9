"""What a busy machine adds to a delay: a bound in seconds is the code's, and holds on top of it."""

import contextlib
from pathlib import Path


def starved_ns(*pids: int) -> int:
    """For how long threads of these processes were ready to run and got no CPU, so far."""
    waited = 0
    for task in (task for pid in pids for task in Path(f"/proc/{pid}/task").iterdir()):
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):  # a thread may end meanwhile
            waited += int((task / "schedstat").read_text().split()[1])
    return waited
