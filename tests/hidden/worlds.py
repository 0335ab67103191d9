"""The hidden worlds of benchmarks/hidden.py, which is no package."""

import importlib.util
import sys
from pathlib import Path

from sandbot_lab.world import World
from sandbot_model.physics.catalogue import catalogue

PATH = Path(__file__).parents[2] / "benchmarks" / "hidden.py"
SPEC = importlib.util.spec_from_file_location("trackway_hidden_worlds", PATH)
hidden = importlib.util.module_from_spec(SPEC)
sys.modules[SPEC.name] = hidden
SPEC.loader.exec_module(hidden)

BY_NAME = {world.name: world for world in (*hidden.WORLDS, hidden.NULL)}
PHI = hidden.PHI
EFFECTS = catalogue()

__all__ = ["BY_NAME", "EFFECTS", "PHI", "World", "hidden"]
