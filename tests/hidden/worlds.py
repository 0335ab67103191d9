"""The hidden worlds of the benchmark by name, and the catalogue that is to explain them."""

import hidden
from hidden import PHI
from sandbot_lab.world import World
from sandbot_model.physics.catalogue import catalogue

BY_NAME = {world.name: world for world in (*hidden.WORLDS, hidden.NULL)}
EFFECTS = catalogue()

__all__ = ["BY_NAME", "EFFECTS", "PHI", "World", "hidden"]
