"""What a busy machine adds to a delay: a bound in seconds is the code's, and holds on top of it."""

import contextlib
from pathlib import Path


class Starved:
    """For how long threads of these processes have been ready to run and got no CPU since now."""

    def __init__(self, *pids: int) -> None:
        self._pids = pids
        self._before_ns = self._waited_ns()

    @property
    def ns(self) -> int:
        """Of the threads that still live: what one that ended has waited is gone, and must not count as less."""
        return sum(waited - self._before_ns.get(task, 0) for task, waited in self._waited_ns().items())

    @property
    def seconds(self) -> float:
        """The same in seconds."""
        return self.ns * 1e-9

    def _waited_ns(self) -> dict[Path, int]:
        waited = {}
        for task in (task for pid in self._pids for task in Path(f"/proc/{pid}/task").iterdir()):
            with contextlib.suppress(FileNotFoundError, ProcessLookupError):  # a thread may end meanwhile
                waited[task] = int((task / "schedstat").read_text().split()[1])
        return waited
