"""The virtual lab in the place of robot, bed, cameras and force cell, as a node."""
