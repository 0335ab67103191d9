"""A lease: the right to move legs or blow air, which ends by itself if it is not renewed in time."""

import math
from dataclasses import dataclass


@dataclass
class Lease:
    """The commander renews it; obeying nodes check ``late`` before each step. Times [s] of any one monotonic clock."""

    limit_s: float
    renewed_s: float = -math.inf

    def renew(self, now_s: float) -> None:
        """A renewal was received at ``now_s``."""
        self.renewed_s = now_s

    def late(self, now_s: float) -> bool:
        """Whether more than ``limit_s`` have passed since the last renewal; also true before the first one."""
        return not now_s - self.renewed_s <= self.limit_s
