"""Compile the numba kernels during set-up, so that the first run does not wait a minute for them.

One short trial of the virtual lab goes through the compiled kernels: dynamics, drawing, tracking, folding. What no such
campaign uses is called by itself: the smoother of a video's track, the lab's other ground, a search for effects.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from sandbot_bringup.tools import campaign
from sandbot_lab.direct import direct_trials
from sandbot_lab.resistive import ResistiveGround
from sandbot_lab.robot import simulate
from sandbot_lab.world import World
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.discover import discover
from sandbot_model.physics.catalogue import catalogue
from sandbot_record.trials.table import Row, from_rows
from sandbot_tracking.smooth import smooth

PLAN = """
name: warm_up
gait: UNIFORM
phi: [0.62]
omega_rad_s: [12]
replicates: 1
images: none
"""


def main() -> int:
    """Run a trial in a temporary folder, and the other kernels."""
    t_s = 0.01 * np.arange(200)
    simulate(World(resistive=ResistiveGround()), 0.6, t_s[:2], np.zeros((2, 6)), np.zeros((2, 6)), seed=1)
    smooth(t_s, 0.2 * t_s + 1e-5 * np.sin(1e3 * t_s))
    # On days of their own, so that readings are looked at that may be off; at its softest some walk and some swim.
    rows = direct_trials(World(), (0.58, 0.605, 0.633), (4.0, 12.0, 20.0, 28.0), replicates=3, batches="omega")
    few = {name: catalogue()[name] for name in ("stance_overlap", "disturbed_ground")}
    discover(cells_of(from_rows([Row(**row) for row in rows])), few, max_effects=1)
    with tempfile.TemporaryDirectory() as folder:
        plan = Path(folder) / "plan.yaml"
        plan.write_text(PLAN, encoding="utf-8")
        return campaign.main([str(plan), "--out", str(Path(folder) / "out"), "--batch", "--workers", "1"])


if __name__ == "__main__":
    sys.exit(main())
