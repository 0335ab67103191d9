"""Compile the numba kernels once, as part of the set-up, so that no first run waits a minute for them.

One short trial of the virtual lab goes through the compiled kernels: dynamics, drawing, tracking, folding. What no such
campaign uses is called by itself: the smoother of a video's track, the lab's other ground, a fit.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from sandbot_bringup.tools import campaign
from sandbot_lab.resistive import ResistiveGround
from sandbot_lab.robot import simulate
from sandbot_lab.world import World
from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting.fit import fit
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
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
    """Run the trial in a temporary folder, and the others."""
    t_s = 0.01 * np.arange(200)
    simulate(World(resistive=ResistiveGround()), 0.6, t_s[:2], np.zeros((2, 6)), np.zeros((2, 6)), seed=1)
    smooth(t_s, 0.2 * t_s + 1e-5 * np.sin(1e3 * t_s))
    trials = [Row(trial_id=str(i), phi=0.62, omega_rad_s=6.0 + i, speed_m_s=0.06 + 0.01 * i) for i in range(6)]
    fit(model_of("simple", (), catalogue()), cells_of(from_rows(trials)))
    with tempfile.TemporaryDirectory() as folder:
        plan = Path(folder) / "plan.yaml"
        plan.write_text(PLAN, encoding="utf-8")
        return campaign.main([str(plan), "--out", str(Path(folder) / "out"), "--batch", "--workers", "1"])


if __name__ == "__main__":
    sys.exit(main())
