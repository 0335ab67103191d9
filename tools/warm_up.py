"""Compile the numba kernels once, as part of the set-up, so that no first run waits a minute for them.

One short trial of the virtual lab goes through every compiled kernel: dynamics, drawing, tracking, folding.
"""

import sys
import tempfile
from pathlib import Path

from sandbot_bringup.tools import campaign

PLAN = """
name: warm_up
gait: UNIFORM
phi: [0.62]
omega_rad_s: [12]
replicates: 1
images: none
"""


def main() -> int:
    """Run the trial in a temporary folder."""
    with tempfile.TemporaryDirectory() as folder:
        plan = Path(folder) / "plan.yaml"
        plan.write_text(PLAN, encoding="utf-8")
        return campaign.main([str(plan), "--out", str(Path(folder) / "out"), "--batch", "--workers", "1"])


if __name__ == "__main__":
    sys.exit(main())
